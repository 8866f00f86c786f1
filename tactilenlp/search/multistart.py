"""Solve a page from several hypotheses: rough levels tell which are worth the rest.

Hypotheses that differ by where least motion left them often end in one optimum.  The
levels before the last one, solved from each, bring these together; of those that are
one body by then only the best is solved to the end, and none that is far behind.
"""

from __future__ import annotations

import time
from dataclasses import replace

from ..common.interrupt import interruptible
from ..common.progress import progress
from ..problem.pages import is_polytope
from .beam import RIVAL
from .hypothesis import same
from .local_solve import Solved, best_first, solved_from

UNSURE = 100.0  # [nats] behind the best, at a rough level that stopped early: dropped


def raced(job, page, hypotheses, options, levels, known=(), solved=None) -> list:
    """Return the page solved from hypotheses, the best first, each optimum once.

    levels: of the page, the last one decides; known: solved already, what is found
    competes with them; solved: an empty list to leave results in, for whoever
    interrupts, rough ones until there are others.
    """
    solved, rough = [] if solved is None else solved, []
    try:
        with interruptible():
            _race(job, page, hypotheses, options, levels, known, solved, rough)
    except KeyboardInterrupt:
        solved += [] if solved else rough
        raise
    return best_first(solved)


def _race(job, page, hypotheses, options, levels, known, solved, rough) -> None:
    """Fill `rough` with hypotheses before the last level, `solved` with those after."""
    shared = {}
    hull = is_polytope(job.shape)  # its window follows from where it starts
    apart = len(levels) == 1 or levels[-2].fixed or levels[-1].rebuild
    apart = apart or not job.reductions.planar
    for h in progress(hypotheses, "solve"):
        if (known or solved or rough) and time.monotonic() > job.deadline:
            break
        shared = {} if hull else shared
        if apart:  # nothing comes together where poses are held, or tilt
            solved.append(solved_from(job, page, h, options, shared, levels))
        else:
            rough.append(solved_from(job, page, h, options, shared, levels[:-1]))
    ends = [end for s in known for end in (s.at, s.rough) if end is not None]
    for s in sorted(rough, key=lambda s: s.at.rank):
        if (known or solved) and time.monotonic() > job.deadline:
            break
        if any(same(job.shape, s.at, end) for end in ends):
            continue
        if _behind(s, [*known, *solved]):
            continue
        given = s.hypothesis, options, shared, levels[-1:], s.solution
        solved.append(replace(solved_from(job, page, *given), rough=s.at))
        ends.append(s.at)


def _behind(rough: Solved, solved) -> bool:
    """Tell whether a rough solution is too far behind the best one to end before it."""
    good = [s.solution.objective for s in solved if s.solution.success]
    margin = RIVAL if rough.solution.success else UNSURE
    return bool(good) and rough.solution.objective > min(good) + margin
