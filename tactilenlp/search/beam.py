"""The beam: extends, solves, ranks and keeps hypotheses action by action.

Each new action extends every hypothesis kept by a few guesses; the most promising are
solved by the quasi-static page, and the best distinct ones are kept.  Least motion
drags a touch to the nearest edge, so it proposes well and ranks badly: where a page
with physics is given, that ranks the first ones (`rank`).
"""

from __future__ import annotations

import logging
import time
from dataclasses import replace

import numpy as np

from formulations import quasi_static

from ..common.progress import progress
from ..problem.pages import page_named
from .hypothesis import Hypothesis, Job, distinct, same
from .local_solve import ROUGH, opened, posed, spread, started, tried
from .proposals import WEAK, extensions

__all__ = ["Hypothesis", "Job", "beam", "distinct", "extensions", "rank", "same"]
log = logging.getLogger("tactilenlp")
TOLERANCE = 1e-4  # of the search's solves; the page that follows is solved tighter
COARSE = 40.0  # [nats] a start that costs less than this skips the coarse level
RIVAL = 15.0  # [nats] of least motion behind the best: physics is not asked
BEHIND = 30.0  # [nats] of physics behind the best: dropped
RANKED = 2  # actions after which a page ranks
EARLY = 2  # actions in which sizes are free: twice as many hypotheses


def beam(
    job: Job, kept, width: int, solves: int, executor=None, page=None, so_far=None
):
    """Return the best distinct hypotheses for all actions of a job, by least motion.

    kept: hypotheses of the first actions to carry on, if any; page: ranks those of
    the first RANKED actions, while its problem is small.  `width` are kept,
    twice as many in the first actions, and guesses that least motion has not moved.
    so_far: a list to leave them in after each action, for whoever interrupts.
    """
    done = kept[0].x.shape[1] if kept else 0
    actions, physical = np.unique(job.data.action), bool(kept)
    for i, action in enumerate(progress(actions, "search")):
        last = int(np.nonzero(job.data.action == action)[0][-1]) + 1
        if last <= done or not (job.data.contact & job.data.valid)[:last].any():
            continue
        part = replace(job, data=job.data.select(np.unique(job.data.action[:last])))
        more = 2 if i < EARLY else 1
        starts = _most_promising(part, extensions(part, kept), solves * more)
        if time.monotonic() > job.deadline:  # what is left is guessed, not solved
            kept = starts[:width]
            continue
        found = spread(_solve_chunk, part, starts, executor)
        found += starts if i < EARLY else []
        kept = distinct(job.shape, found, width * more)
        if i >= EARLY:  # as it was: its past may be one that physics found
            twin = any(same(job.shape, starts[0], h) for h in kept)
            kept = kept if twin and not physical else [*kept, starts[0]]
        physical = False
        if page is not None and i < RANKED and last < len(job.data.time):
            kept = rank(part, page, kept, width, executor)
        if so_far is not None:
            so_far[:] = kept
        words = "searched %d of %d actions: %d hypotheses, the best of %.1f nats"
        log.info(words, i + 1, len(actions), len(kept), kept[0].objective)
    return kept


def rank(job, page, kept, width, executor=None) -> list[Hypothesis]:
    """Return the best distinct hypotheses by a page's first levels, solved roughly."""
    limit = min(h.objective for h in kept) + RIVAL
    rivals = [h for h in kept if h.objective <= limit]
    if executor is not None:
        page = page.__name__  # a module travels by its name
    found = spread(_rank_chunk, job, rivals, executor, page)
    return distinct(job.shape, found, width, BEHIND)


def _rank_chunk(job: Job, kept, page) -> list[Hypothesis]:
    page = page_named(page)
    problem, window = posed(job, page, (kept[0].theta, kept[0].x))
    levels, solvers = opened(page.LEVELS, final=False), {}
    return [tried(job, problem, window, levels, h, ROUGH, solvers) for h in kept]


def _most_promising(job: Job, starts, count: int) -> list[Hypothesis]:
    """Return the cheapest distinct starts by the quasi-static page's own cost."""
    problem, window = posed(job, quasi_static)
    data, costed = problem.data(WEAK), []
    for h in starts:
        x = problem.pack(started(problem, window, h))
        cost = sum(float(problem.value(n, x, data).sum()) for n in problem.costs)
        costed.append(replace(h, objective=cost))
    return distinct(job.shape, costed, count)


def _solve_chunk(job: Job, starts) -> list[Hypothesis]:
    problem, window = posed(job, quasi_static)
    weak = [replace(v, parameters=v.parameters | WEAK) for v in quasi_static.LEVELS]
    solvers, out = {}, []
    for h in starts:
        levels = weak if h.objective > COARSE else weak[-1:]
        out.append(tried(job, problem, window, levels, h, TOLERANCE, solvers))
    return out
