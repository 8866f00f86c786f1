"""Free what a page holds fixed where the data ask for it: selection of nested models.

By default fingertips are rigid and a body on the ground slides flat.  Where the
likelihood costs more than the noise explains, the page is solved again from the optimum
with that assumption given up: compliant fingertips, six unknowns a pose.  The larger
model is kept where it lowers the objective by REASON nats or more; its Laplace evidence
is lower by the logarithm of prior over posterior deviations, about as much.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from ..data.sensor_noise import variance_left
from ..information.goodness_of_fit import Misfit, misfits
from ..problem.certificates import Skipped
from ..problem.reductions import flat, insisted
from ..search.local_solve import (
    CLOSE,
    REASON,
    Solved,
    best_first,
    let_tilt,
    opened,
    settings_of,
    solved_from,
)

log = logging.getLogger("tactilenlp")

POOR = 3.0  # [spreads] of excess beyond which a fit is poor whatever noise there was


def misfit_of(job, solved: Solved) -> Misfit:
    """Return what touches and free samples cost at a solution, and should cost."""
    problem, solution = solved.problem, solved.solution
    x, data = problem.pack(solution.values), problem.data(solution.parameters)
    left = variance_left(job.data, job.precision)
    found = misfits(problem, x, data, solved.window, job.data, left)
    return sum(found.values(), start=Misfit(0.0, 0.0, 0.0))


def with_soft_fingertips(job, page, solved, options, solve) -> tuple:
    """Return job and solves, best first; the compliance is free where data ask for it.

    solved: with rigid fingertips, best first; solve(job): solves the page of a job from
    all starts of the search.
    """
    best = solved[0]
    if not (may_be_soft(job, page) and best.solution.success):
        return job, solved
    misfit = misfit_of(job, best)
    if misfit.excess < REASON:
        return job, [declined(best, RIGID, misfit.excess, "at most "), *solved[1:]]
    soft = replace(job, reductions=replace(job.reductions, rigid=False))
    levels = opened(page.LEVELS, final=True) if job.reductions.planar else None
    tried = [solved_from(soft, page, best.at, options, levels=levels)]
    gain = _gain(best, tried[0])
    if gain < REASON and misfit.excess > POOR * misfit.spread + REASON:
        tried += solve(soft)
        gain = max(_gain(best, one) for one in tried)
    elif gain >= REASON:
        tried += solve(soft)
    if gain < REASON:
        return job, [declined(best, RIGID, gain), *solved[1:]]
    log.info("fingertips are soft: the objective falls by %.1f nats", gain)
    return soft, best_first(tried)


def with_tilt(job, page, best: Solved, options) -> Solved:
    """Return the page in free motion where data ask for it, or the flat solve."""
    if not (may_tilt(job, page) and best.solution.success):
        return best
    misfit = misfit_of(job, best)
    if misfit.excess < REASON:
        return best
    free = replace(job, reductions=replace(job.reductions, planar=False))
    tilted = let_tilt(free, page, best, settings_of(free, options), CLOSE)
    gain = _gain(best, tilted)
    if gain < REASON:
        return best
    log.info("the body rocks: the objective falls by %.1f nats", gain)
    return replace(tilted, declined=best.declined)


def may_be_soft(job, page) -> bool:
    """Tell whether fingertips are rigid by assumption, and a page can free them."""
    unknown = job.scene.compliance is None and job.reductions.rigid
    return unknown and getattr(page, "COMPLIANT", False)


def may_tilt(job, page) -> bool:
    """Tell whether a body slides flat by assumption, and a page can let it tilt."""
    made = insisted(page, job.reductions)
    return job.scene.ground is not None and made.planar and not flat(page)


RIGID = ("rigid", "compliance of the fingertips", "they are rigid unless data say so")


def declined(solved: Solved, model, gain: float, bound: str = "") -> Solved:
    """Return a solve with the certificate that a larger model explains no more."""
    name, dropped, reason = model
    check = f"freeing it would lower the objective by {bound}[nats]"
    skipped = Skipped(name, dropped, reason, check, gain, REASON, gain < REASON)
    return replace(solved, declined=(*solved.declined, skipped))


def _gain(fixed: Solved, freed: Solved) -> float:
    """Return by how many nats a larger model lowers the objective; none if it fails."""
    if not freed.solution.success:
        return 0.0
    return fixed.solution.objective - freed.solution.objective
