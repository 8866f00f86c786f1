"""Solve a page from what the search found: race it, challenge it, let it tilt.

What a scene lets slide or tilt is solved as if it slid, first: there the past can be
followed and asked again, and the optimum of free motion lies beside.
"""

from __future__ import annotations

import time
from dataclasses import replace

from ..geometry.transforms import is_planar
from ..problem.certificates import planar_certificate
from ..problem.pages import is_polytope
from ..problem.reductions import Reductions, required_reductions
from ..search.alternatives import still_explained, with_alternatives
from ..search.hypothesis import distinct
from ..search.local_solve import (
    RESTART_MU,
    Solved,
    best_first,
    freed_levels,
    freed_to_tilt,
    settings_of,
    solved_from,
)
from ..search.margins import CLOSE_OPTIMUM, LEAST_MOTION_BEHIND, RAN_AWAY
from ..search.multistart import multistart
from .incremental_polytope import repaired


def refined(job, page, kept, options, solved, start=None) -> list[Solved]:
    """Return the page solved from hypotheses and from their rivals, best first.

    solved: an empty list to leave in, for whoever interrupts, what there is before
    rivals; start: an estimate that this one carries on, if its rivals were asked for.
    """
    hull, lean = (
        is_polytope(job.shape),
        required_reductions(page, Reductions()),
    )  # as a search is
    lying = job.scene.ground is not None and all(is_planar(h.x) for h in kept)
    if lying and lean.planar and not job.reductions.planar:
        flat = replace(job, reductions=lean)
        found = refined(flat, page, kept, options, solved, start)
        found = repaired(flat, page, found, options)
        if hull or planar_certificate(flat, page, found[0]).holds:
            return _in_free_motion(job, page, found[:1] if hull else found, options)
    start = None if hull else start
    found = _multistart(job, page, kept, options, solved, start)
    if options.rivals and not hull:
        found = with_alternatives(job, page, found, options, start)
    return found


def _in_free_motion(job, page, slid, options) -> list[Solved]:
    """Return the page in free motion from where it slides, close rivals too."""
    ends, settings = [s.at for s in slid], settings_of(job, options)
    near = distinct(job.shape, ends, len(ends), CLOSE_OPTIMUM)
    slid = [s for s, end in zip(slid, ends, strict=True) if end in near]
    return best_first(freed_to_tilt(job, page, s, settings, RESTART_MU) for s in slid)


def _multistart(job, page, kept, options, solved, start) -> list[Solved]:
    """Return the page solved from the best hypotheses, best first.

    Of those that carry on the path of `start` the first is enough where it is settled.
    """
    limit = min(h.objective for h in kept) + LEAST_MOTION_BEHIND
    own = page.LEVELS
    levels = freed_levels(own, final=True) if job.reductions.planar else own
    if job.scene.ground is None:  # these poses lie in a plane that the object leaves
        levels = getattr(page, "ROUGH", own)
    promising = [h for h in kept if h.objective <= limit]
    first = promising[: None if start is None else 1]
    solved = multistart(job, page, first, options, levels, solved=solved)
    if len(first) < len(promising) and not still_explained(solved[0], start):
        others = multistart(job, page, promising[1:], options, levels, known=solved)
        solved = best_first([*solved, *others])
    good = [s for s in solved if s.solution.success]
    bound = min(h.objective for h in kept) + RAN_AWAY * job.data.actions
    lost = not good or good[0].solution.objective > bound
    if lost and levels is not own and time.monotonic() < job.deadline:
        # The slower way, poses held first, as the page says.
        good = [*good, solved_from(job, page, solved[0].hypothesis, options)]
    return best_first(good or solved)
