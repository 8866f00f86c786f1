"""Free what a page holds fixed where the data ask for it: selection of nested models.

By default fingertips are rigid, the centre of mass is the centroid, and a body on the
ground slides flat.  Where touches cost more than the noise explains, the page is solved
again with one of these given up, then the next: compliance or centre of mass as
unknowns, six unknowns a pose.  The larger model is kept where it lowers the objective
by more than its Laplace evidence loses (Occam's factor: the log of prior over posterior
deviations of what was freed) and the spread of the likelihood: from another start noise
alone is fitted better by about as much.  LARGER_MODEL stands for the factor of tilt.

Classes of shapes are not nested: the one of the largest evidence is the estimate.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from formulations.centre_of_mass import NAME as CENTRE
from formulations.indentation import NAME as COMPLIANCE
from formulations.names import TOUCH_TERM
from formulations.page_contract import contract_of
from formulations.rigid_body import PLANAR
from formulations.shape import Shape

from ..common.deadline import Deadline
from ..data.sensor_noise import variance_left
from ..errors import OptionError, TactileError
from ..information.error_budget_terms import ANY_ROTATION, REACHED, positive_part
from ..information.goodness_of_fit import NOTHING, misfits
from ..information.information import optimum_of
from ..information.mixture import (
    distinct_modes,
    laplace_mixture,
    log_evidence,
    occam_of,
    odds_of,
)
from ..interface.result import Estimate
from ..problem.certificates import Skipped
from ..problem.pages import shape_of
from ..problem.reductions import required_reductions
from ..search.local_solve import (
    RESTART_MU,
    Solved,
    freed_to_tilt,
    settings_of,
    solved_from,
    warm_started,
)
from ..search.margins import CLOSE_OPTIMUM, LARGER_MODEL, LEAST_MOTION_BEHIND, UNCHANGED
from ..search.multistart import FREED_MU

AUTO = (  # the classes of shape="auto"
    *("cuboid", "cylinder", "ellipsoid"),
    *("prism of 3 sides", "prism of 6 sides", "polytope"),
)
MIN_CLASS_TIME = 1.0  # [s] of a class
log = logging.getLogger("tactilenlp")


class Nuisance(NamedTuple):
    """An unknown that is fixed, and why.

    searched: whether poses found while it is fixed are too far off to start from.
    """

    unknown: str
    dropped: str
    reason: str
    searched: bool


NUISANCES = {  # by reduction, in the order in which they are freed
    "rigid": Nuisance(
        COMPLIANCE, "compliance of the fingertips",
        "they are rigid unless data say so", True,
    ),
    "central": Nuisance(
        CENTRE, "offset of the centre of mass",
        "it is the centroid unless data say so", False,
    ),
}  # fmt: skip


def excess_of(job, solved: Solved) -> tuple[float, float]:
    """Return the excess of the touches over their expected cost, and its spread.

    Both in nats; no larger model can gain much more than the excess.
    """
    problem, solution = solved.problem, solved.solution
    x, data = problem.pack(solution.values), problem.data(solution.parameters)
    left = variance_left(job.data, job.precision)
    found = misfits(problem, x, data, solved.window, job.data, left)
    touches = found.get(TOUCH_TERM, NOTHING)
    return touches.excess, touches.spread


def with_nuisance_parameters(job, page, solved, options, solve) -> tuple:
    """Return job and solves, best first; what NUISANCES names is free where data ask.

    solved: with all of it fixed, best first; solve(job, hypothesis, alone): the same of
    another job, from a hypothesis, and if not alone from all starts of the search.
    """
    for name, nuisance in NUISANCES.items():
        if fixes(job, page, name) and solved[0].solution.success:
            job, solved = _with(name, nuisance, job, page, solved, options, solve)
    return job, solved


def _with(name, nuisance, job, page, solved, options, solve) -> tuple:
    """Return job and solves, one nuisance parameter free if the data ask for it."""
    best, *others = solved
    excess, spread = excess_of(job, best)
    from_guesses = bool(contract_of(page).rough)  # else a solve costs several seconds
    if excess < (needed := (UNCHANGED if from_guesses else LARGER_MODEL) + spread):
        return job, [declined(best, name, excess, needed, "at most "), *others]
    if job.deadline.passed(nuisance.dropped):
        return job, solved
    larger = replace(job, reductions=replace(job.reductions, **{name: False}))
    if nuisance.searched:
        alone = not from_guesses or excess < LARGER_MODEL + spread
        freed = solve(larger, best.at, alone)
        if from_guesses and alone and freed and _gain(best, freed[0]) > needed:
            freed = solve(larger, best.at, False)
    else:
        settings = settings_of(larger, options)
        freed = [warm_started(larger, page, best, settings, FREED_MU)]
    if not freed:
        return job, solved
    to, gain, needed = freed[0], _gain(best, freed[0]), spread
    if gain > spread:
        needed += occam_of(to.problem, to.solution, nuisance.unknown)
    if gain <= needed:
        return job, [declined(best, name, gain, needed), *others]
    log.info("%s is free: the objective falls by %.1f nats", nuisance.dropped, gain)
    return larger, [replace(to, declined=best.declined), *freed[1:], *solved]


def most_probable_first(job, solved) -> list[Solved]:
    """Return solves, first that of the largest evidence, not of the least objective.

    A narrow optimum that is lower by a fraction of a nat is not what is believed.
    """
    best = solved[0]
    motion = best.window.motion
    comparable = [s for s in solved if s.solution.success and s.window.motion is motion]
    if job.shape.parameters != "sizes" or len(comparable) < 2:
        return solved
    R_wg = np.eye(3) if job.scene.ground is None else job.scene.ground.rotation.T
    optima = [
        (*optimum_of(s.problem, s.solution, s.window, job.shape, R_wg), s)
        for s in comparable
    ]
    turning = 1 if motion is PLANAR else 3
    optima = distinct_modes(job.shape, turning, optima)
    modes = laplace_mixture(job.shape, turning, optima)
    first = optima[int(np.argmax(modes.weights))][-1]
    return [first, *(s for s in solved if s is not first)]


def with_tilt(job, page, best: Solved, options) -> Solved:
    """Return the page in free motion where data ask for it, or the flat solve."""
    if not (may_tilt(job, page) and best.solution.success):
        return best
    excess, spread = excess_of(job, best)
    needed = LARGER_MODEL + spread
    if excess < needed or job.deadline.passed("tilt"):
        return best
    free = replace(job, reductions=replace(job.reductions, planar=False))
    if rough := contract_of(page).rough:  # touches taken for outliers pull again
        tilted = solved_from(free, page, best.at, options, levels=rough)
    else:
        settings = settings_of(free, options)
        tilted = freed_to_tilt(free, page, best, settings, RESTART_MU)
    gain = _gain(best, tilted)
    if gain < needed:
        return best
    log.info("the body rocks: the objective falls by %.1f nats", gain)
    return replace(tilted, declined=best.declined)


def fixes(job, page, name: str) -> bool:
    """Tell whether a nuisance parameter is fixed by assumption, and a page frees it."""
    unknown = {
        "rigid": job.scene.compliance is None,
        "central": job.scene.sigma_centre > 0,
    }
    freed = name in contract_of(page).freed
    return unknown[name] and getattr(job.reductions, name) and freed


def may_tilt(job, page) -> bool:
    """Tell whether a body slides flat by assumption, and a page can let it tilt."""
    made = required_reductions(page, job.reductions).planar
    return made and job.scene.ground is not None and "planar" in contract_of(page).freed


def declined(solved: Solved, name, gain, needed, bound: str = "") -> Solved:
    """Return a solve with the certificate that a larger model explains no more."""
    _, dropped, reason, _ = NUISANCES[name]
    check = f"freeing it would lower the objective by {bound}[nats]"
    skipped = Skipped(name, dropped, reason, check, gain, needed, gain < needed)
    return replace(solved, declined=(*solved.declined, skipped))


def _gain(fixed: Solved, freed: Solved) -> float:
    """Return by how many nats a larger model lowers the objective; none if it fails."""
    less = fixed.solution.objective - freed.solution.objective
    return less if freed.solution.success else 0.0


def classes_of(shape) -> list[Shape]:
    """Return the Shapes that are to be compared; none for one shape alone."""
    if isinstance(shape, str) and shape == "auto":
        return [shape_of(one) for one in AUTO]
    if isinstance(shape, (str, Shape)) or not isinstance(shape, Sequence):
        return []
    if not shape:
        expected = "shapes to compare, or one"
        raise OptionError("no class", where="shape", got=shape, expected=expected)
    return [shape_of(one) for one in shape]


def likeliest_class(classes, solve, start, options) -> Estimate:
    """Return the estimate of the class with the largest evidence, and its table.

    classes: Shapes; solve(shape=, start=, options=) -> Estimate, or raises
    TactileError; the time limit is shared by the classes that are left; start: of the
    class that it is an estimate of.  Raises the error of the first class if none has an
    estimate.  The poses of the likeliest class are a second start of the others.
    """
    deadline, found, errors = Deadline.within(options.time_limit), {}, {}
    for i, shape in enumerate(classes):
        share = deadline.left / (len(classes) - i)
        left = replace(options, time_limit=max(MIN_CLASS_TIME, share))
        try:
            known = start if getattr(start, "shape", "") == shape.name else None
            estimate = solve(shape=shape, start=known, options=left)
            found[shape.name] = evidence_of(estimate, shape), estimate
        except TactileError as error:
            errors[shape.name] = error
    if not found:
        raise next(iter(errors.values()))
    _start_from_best(classes, solve, options, deadline, found)
    errors = {name: error for name, error in errors.items() if name not in found}
    _, best = max(found.values(), key=lambda one: one[0])
    return replace(best, classes=odds_of(found.values(), errors))


def _start_from_best(classes, solve, options, deadline, found) -> None:
    """Solve classes that explain the data worse from the poses of the likeliest one.

    found: evidence and Estimate by class, where what is likelier replaces its own.
    """
    told, best = max(found.values(), key=lambda one: one[0])
    for shape in classes:
        own, estimate = found.get(shape.name, (-np.inf, None))
        cost = np.inf if estimate is None else estimate.objective
        if not np.isfinite(told) or cost <= best.objective + CLOSE_OPTIMUM:
            continue
        if deadline.passed(f"a {shape.name} from the poses of a {best.shape}"):
            return
        left = replace(options, time_limit=max(MIN_CLASS_TIME, deadline.left))
        most = min(cost, best.objective + LEAST_MOTION_BEHIND)
        try:
            again = solve(shape=shape, start=None, options=left, poses=best, most=most)
        except TactileError as error:
            log.info("%s from the poses of a %s: %s", shape.name, best.shape, error)
            continue
        if again is not None and (more := evidence_of(again, shape)) > own:
            found[shape.name] = more, again


def evidence_of(estimate, shape) -> float:
    """Return the log evidence of an estimate; -inf where its solve failed.

    The prior: the deviations of the sizes, a position within REACHED, any rotation.  As
    many optima are alike as there are relabellings of the body's axes.
    """
    if not estimate.success:
        return -np.inf
    information = estimate.information
    k, alike = len(information.names), 1
    known = np.full(k, 1 / REACHED**2)
    if shape.parameters == "sizes":
        n, turning = shape.theta, (k - shape.theta) // 2  # 1 of 3 planar, 3 of 6
        known[:n] = 1 / np.broadcast_to(shape.size_prior[1], n) ** 2
        known[k - turning :] = 1 / ANY_ROTATION**2
        up = [R[2][2] > 0.5 or turning == 3 for _, R in shape.symmetries]
        alike, prior = max(1, sum(up)), np.diag(known)
    else:
        prior = np.diag(known) + positive_part(information.part("prior"))
    covariance = information.of_hessian().spread
    return log_evidence(estimate.objective, covariance, prior) + np.log(alike)
