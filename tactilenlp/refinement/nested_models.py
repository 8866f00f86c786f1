"""Free what a page holds fixed where evidence favours it: selection of nested models.

By default sensors are aligned, fingertips are rigid, the centre of mass is the
centroid, and a body on the ground slides flat.  Where touches cost more than the noise
explains, the page is solved again with one of these given up, then the next: turns of
the normals, compliance or centre of mass as unknowns; last of all the body may tilt
(rocking_body.py).  The larger model is kept where it lowers the objective by more than
its Laplace evidence loses (Occam's factor: the log of prior over posterior deviations
of what was freed) and the spread of the likelihood (`needed_gain`).  Of tilt that
factor is not computed.  What was freed before a tilt is fixed again where that costs
less.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from formulations.names import CENTRE_OF_MASS, COMPLIANCE, FINGER_TURN, TOUCH_TERM

from ..information.goodness_of_fit import NOTHING, Misfit
from ..information.linearisation import kkt_residual
from ..information.mixture import occam_of
from ..local.levels import FREED_MU
from ..local.local_solve import built_page, transfer_solution, warm_started
from ..local.margins import DECISIVE, UNCHANGED
from ..local.solved import Solved
from ..nlp.kkt import gradient, kkt_system_of
from ..problem.skipped import Skipped

log = logging.getLogger("tactilenlp")


class Nuisance(NamedTuple):
    """An unknown that is fixed, and why.

    from_all_starts: whether poses found while it is fixed are too far off to start
    from; screen(job, solved, unknown): by how many nats it lowers the objective as far
    as can be told without a solve, which must be enough before one; None: nothing can.
    """

    unknown: str
    dropped: str
    reason: str
    from_all_starts: bool
    screen: Callable | None


def lost_by_compliance(job, best: Solved) -> bool:
    """Tell whether a search may have lost a polytope for want of a compliance.

    It took fingertips for rigid that a solve found soft.
    """
    soft = job.reductions.rigid and not best.job.reductions.rigid
    return soft and job.shape.of_vertices and job.search.hypothesis is None


def misfit_of(solved: Solved) -> Misfit:
    """Return what the touches cost, and should cost [nats].

    No larger model can gain much more than the excess.
    """
    fit = solved.fit
    return NOTHING if fit is None else fit.terms.get(TOUCH_TERM, NOTHING)


def needed_gain(spread: float, occam: float = DECISIVE) -> float:
    """Return by how many nats a larger model must lower the objective to be kept.

    spread: of the likelihood, since from another start noise alone is fitted better by
    about as much; occam: what the evidence loses by what was freed (0.7 to 3.1 nats by
    compliance in 24 recordings, more by turns): before it is known, DECISIVE.
    """
    return max(spread, UNCHANGED) + occam


def free_nuisance_parameters(solves, solve) -> list[Solved]:
    """Return solves, best first; what NUISANCES names is free if evidence favours it.

    solves: with all of it fixed, best first; solve(job, hypothesis, alone): the same of
    another job, from a hypothesis, and if not alone from all starts of the search.
    """
    for name, nuisance in NUISANCES.items():
        if solves[0].job.fixes(name) and solves[0].solution.success:
            solves = _free_nuisance(name, nuisance, solves, solve)
    return solves


def _free_nuisance(name, nuisance, solves, solve) -> list[Solved]:
    """Return solves, one nuisance parameter free if evidence favours it."""
    best, *others = solves
    job, touches = best.job, misfit_of(best)
    if touches.excess < (needed := needed_gain(touches.spread)):
        most = max(touches.excess, 0.0)
        return [declined(best, name, most, needed, "at most "), *others]
    if job.deadline.passed(nuisance.dropped):
        return solves
    larger = job.with_reductions(**{name: False})
    if nuisance.screen is not None:
        gain = nuisance.screen(larger, best, nuisance.unknown)
        if gain < needed:
            return [declined(best, name, gain, needed), *others]
    if nuisance.from_all_starts:  # a page without rough levels takes seconds for each
        freed = solve(larger, best.at, not job.contract.rough)
    else:
        freed = [warm_started(larger, best, FREED_MU)]
    if not freed:
        return solves
    gain, needed = _gain_and_need(best, freed[0], nuisance, touches.spread)
    if gain <= needed:
        bound = "" if freed[0].solution.success else "at least "  # its solve failed
        return [declined(best, name, gain, needed, bound), *others]
    log.info("%s is free: the objective falls by %.1f nats", nuisance.dropped, gain)
    first = fix_needless(replace(freed[0], declined=best.declined))
    return [first, *freed[1:], *solves]


def fix_needless(solved: Solved) -> Solved:
    """Return a solve with what data had freed fixed again, where that costs little.

    Freed while a body slid, it may have stood for a tilt; solved from other starts, it
    may have met a better optimum, which does not need it.
    """
    for name, nuisance in NUISANCES.items():
        job, reductions = solved.job, solved.job.reductions
        fixed = job.with_reductions(**{name: True})
        by_data = getattr(job.options.reductions, name) > getattr(reductions, name)
        if not (by_data and fixed.fixes(name)):
            continue
        if job.deadline.passed(f"a fixed {nuisance.dropped}"):
            break
        spread = misfit_of(solved).spread
        if wald(solved, nuisance.unknown) > _needed(solved, nuisance, spread):
            continue
        smaller = warm_started(fixed, solved, FREED_MU)
        gain, needed = _gain_and_need(smaller, solved, nuisance, spread)
        if smaller.solution.success and gain <= needed:
            log.info("%s is needless: %.1f nats", nuisance.dropped, gain)
            solved = declined(smaller, name, gain, needed)
    return solved


def _gain_and_need(smaller, larger, nuisance: Nuisance, spread: float) -> tuple:
    """Return what a larger model gains, and what it must: both in nats."""
    gain, needed = gain_of(smaller, larger), needed_gain(spread, occam=0.0)
    if gain > needed:
        needed = _needed(larger, nuisance, spread)
    return gain, needed


def _needed(larger: Solved, nuisance: Nuisance, spread: float) -> float:
    """Return what a larger model must gain [nats]."""
    return needed_gain(spread, occam_of(larger.kkt, nuisance.unknown))


def gain_with_others_held(job, solved: Solved, unknown: str) -> float:
    """Return by how many nats one more unknown alone lowers the objective.

    All others are held where they were found: a lower bound of what it may gain.  The
    largest gain by the deviations of any level counts: by the page's own ones, touches
    that are far off are outliers, which cost the same wherever they are.
    """
    built = built_page(job, solved.hypothesis)
    problem, values = built.problem, transfer_solution(solved, built).values
    x, variable = problem.pack(values), problem.variables[unknown]
    own = np.arange(problem.size)[variable.span]
    costs = [n for n in problem.costs if np.isin(problem.terms[n].unknowns, own).any()]
    scale, gains = np.tile(variable.scale, variable.columns), []
    for level in (*job.contract.rough, job.page.LEVELS[-1]):
        data = problem.data(solved.solution.parameters | level.parameters)

        def cost(change, data=data):
            x[own] = scale * change
            value = sum(problem.value(name, x, data).sum() for name in costs)
            return value, scale * gradient(problem, x, data, costs)[own]

        start = np.zeros(len(scale))
        least = minimize(cost, start, jac=True, method="BFGS").fun
        gains.append(cost(start)[0] - least)
    return float(max(gains))


def score(job, solved: Solved, unknown: str) -> float:
    """Return by how many nats a Newton step on one more unknown lowers the objective.

    All others move with it: half of Rao's score statistic (1948).  Where the Hessian is
    indefinite, such a step may raise it: none is gained.
    """
    built = built_page(job, solved.hypothesis)
    problem, start = built.problem, transfer_solution(solved, built)
    kkt = kkt_system_of(problem, start)
    slope = kkt_residual(problem, kkt)[0][problem.variables[unknown].span]
    return max(0.0, float(slope @ kkt.marginal(unknown) @ slope / 2))


def wald(solved: Solved, unknown: str) -> float:
    """Return by how many nats the objective would rise were one unknown zero.

    By its Hessian: half of Wald's statistic (1943).  Of compliance, whose objective
    rises ever faster towards zero, it is the least; at its bound it is zero already.
    """
    kkt = solved.kkt
    if kkt.active[f"bounds of {unknown}"]:
        return 0.0
    value = kkt.x[solved.problem.variables[unknown].span]
    return float(value @ np.linalg.solve(kkt.marginal(unknown), value) / 2)


NUISANCES = {  # by reduction, in the order in which they are freed
    "aligned": Nuisance(
        FINGER_TURN, "turn of the fingers' normals",
        "sensors are assumed to be aligned", True, gain_with_others_held,
    ),
    "rigid": Nuisance(
        COMPLIANCE, "compliance of the fingertips",
        "they are assumed to be rigid", True, None,
    ),
    "central": Nuisance(
        CENTRE_OF_MASS, "offset of the centre of mass",
        "it is assumed to be the centroid", False, score,
    ),
}  # fmt: skip


def declined(solved: Solved, name, gain, needed, bound: str = "") -> Solved:
    """Return a solve with the certificate that a larger model explains no more."""
    _, dropped, reason, *_ = NUISANCES[name]
    check = f"freeing it would lower the objective by {bound}[nats]"
    if gain < 0:  # the solve with it free ended in a worse optimum
        higher = f"its solve ended {-gain:.2g} nats higher"
        check, gain = f"freeing it did not lower the objective ({higher}) [nats]", 0.0
    skipped = Skipped(name, dropped, reason, check, gain, needed, gain < needed)
    return replace(solved, declined=(*solved.declined, skipped))


def gain_of(fixed: Solved, freed: Solved) -> float:
    """Return by how many nats a larger model lowers the objective; none if it fails."""
    less = fixed.solution.objective - freed.solution.objective
    return less if freed.solution.success else 0.0
