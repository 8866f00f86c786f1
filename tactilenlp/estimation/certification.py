"""Certificates of a solved page, and the solves that they ask for.

What the reductions dropped is checked at the solution; what was needed is restored and
the page solved again.  Where sliding on the ground is refuted, the object tumbled.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from ..problem.certificates import certify, without
from ..problem.outliers import evidence_against_planar
from ..problem.pages import is_polytope
from ..problem.reductions import states_planar_motion
from ..search.local_solve import (
    RESTART_MU,
    Solved,
    settings_of,
    solved_from,
    warm_started,
)
from ..search.margins import RESTORED
from ..search.proposals_tumble import recovered
from .profile_likelihood import profiled

log = logging.getLogger("tactilenlp")
MAX_RESTORED = 2  # times that a problem is solved again with what it needs after all
MAX_TUMBLE_SOLVES = 3  # guesses of a tumble at most that are solved in free motion


def checked(job, page, solved, options, executor=None) -> Solved:
    """Return a solved page with certificates, or what they ask for instead.

    An object that did not only slide is solved in free motion; else, with
    options.rivals, the profile likelihoods are added.
    """
    best = certified(job, page, solved, options)
    fell = "planar" in best.certificates.broken and not states_planar_motion(page)
    if fell and not is_polytope(job.shape):
        return _tumbled(job, page, best, options, executor)
    if options.rivals and best.solution.success:
        return _profiled(job, page, best, options)
    return best


def certified(job, page, solved, options) -> Solved:
    """Check what was dropped; put back what was needed and solve again.

    Still spans are cut first where they would move, and dropped if that was not enough.
    """
    found = certify(job, page, solved)
    for _ in range(MAX_RESTORED):
        back = [name for name in found.broken if name != "planar"]
        if not back:
            break
        log.info("needed after all: %s", ", ".join(back))
        more = {*found.cuts, *job.cuts}
        if found.cuts and (not job.cuts or is_polytope(job.shape)):
            job = replace(job, cuts=tuple(sorted(more)))
            back.remove("still")
        job = replace(job, reductions=without(job.reductions, back))
        again = _solved_again(job, page, solved, options)
        if again.solution.objective > solved.solution.objective + RESTORED:
            break  # another optimum, which is worse: what does not hold is said
        solved, found = again, certify(job, page, again)
    return replace(solved, certificates=found)


def _solved_again(job, page, solved, options) -> Solved:
    """Solve again, with less left out, from where a solve ended."""
    again = warm_started(job, page, solved, settings_of(job, options), RESTART_MU)
    if again.solution.success:
        return again
    return solved_from(job, page, solved.at, options)


def _profiled(job, page, best, options) -> Solved:
    """Return the best with the profile of its sizes; or a better one that is met."""
    profile, better = profiled(job, page, best, options)
    if better is not None:
        again = solved_from(job, page, better, options, levels=page.LEVELS[-1:])
        again = certified(job, page, again, options)
        if again.rank < best.rank:
            best = again
            profile, _ = profiled(job, page, best, options)
    return replace(best, profile=profile)


def _tumbled(job, page, flat, options, executor) -> Solved:
    """Solve in free motion from guesses of a tumble; keep the best, or the flat one."""
    evidence = evidence_against_planar(job, flat.window, flat.solution.values)
    found = recovered(job, evidence, *options.widths(precise=False), executor)
    free = replace(job, reductions=without(job.reductions, ["planar"]))
    levels = getattr(page, "ROUGH", page.LEVELS)
    solved = [
        solved_from(free, page, h, options, levels=levels)
        for h in found[:MAX_TUMBLE_SOLVES]
    ]
    better = [
        s for s in solved
        if s.solution.success and s.solution.objective < flat.solution.objective
    ]  # fmt: skip
    if not better:
        return flat
    best = min(better, key=lambda s: s.solution.objective)
    return replace(best, certificates=certify(free, page, best))
