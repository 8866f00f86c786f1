"""Beam search over actions: hypotheses are extended, solved, ranked and selected.

Each new action extends every hypothesis kept by a few proposals; the most promising are
solved by the quasi-static page, and the best distinct ones are kept.  Least motion
draws a touch to the nearest edge, so that it proposes well and ranks badly: a page with
physics, if given, ranks the hypotheses of the first actions (`rank`).
"""

from __future__ import annotations

import logging
import os
import time
from dataclasses import replace

import numpy as np

from formulations import quasi_static

from ..common.progress import progress
from ..problem.pages import page_named
from .hypothesis import Hypothesis, Job, distinct, same
from .local_solve import (
    RANKING_TOLERANCE,
    freed_levels,
    problem_for,
    solved_roughly,
    start_values,
)
from .margins import COARSE_LEVEL, LEAST_MOTION_BEHIND, PHYSICS_BEHIND
from .plane_slam import SEARCH_TOLERANCE
from .proposals import WEAK_MOTION, extensions, followed

log = logging.getLogger("tactilenlp")
RANKED_ACTIONS = 2  # actions after which a page with physics ranks
FOLLOW_TIME = 5e-4  # [s] a sample that is followed without a search
EARLY_ACTIONS = 2  # actions in which sizes are free: twice as many hypotheses


def beam(
    job: Job, kept, width: int, solves: int, executor=None, page=None, so_far=None
):
    """Return the best distinct hypotheses for all actions of a job, by least motion.

    kept: hypotheses of the first actions to continue, if any; width: how many are kept,
    twice as many in the first actions, besides proposals as they were; solves: how many
    are solved an action; page: ranks those of the first RANKED_ACTIONS, while its
    problem is small; so_far: a list that holds them after each action, for Ctrl-C.
    When the time for an action as long as the last one is over, the remaining actions
    are followed by a filter, not searched.
    """
    done = kept[0].x.shape[1] if kept else 0
    actions, physical = np.unique(job.data.action), bool(kept)
    began, lasted = time.monotonic(), 0.0
    for i, action in enumerate(progress(actions, "search")):
        last = int(np.nonzero(job.data.action == action)[0][-1]) + 1
        if last <= done or not (job.data.contact & job.data.valid)[:last].any():
            continue
        needed = lasted + FOLLOW_TIME * (job.data.samples - done)
        if kept and job.deadline.passed(f"a search from action {i + 1} on", needed):
            return [followed(job, kept[0])]
        part = replace(job, data=job.data.select(np.unique(job.data.action[:last])))
        more = 2 if i < EARLY_ACTIONS else 1
        starts = _most_promising(part, extensions(part, kept), solves * more)
        early = i < EARLY_ACTIONS
        kept = _selected(part, starts, width * more, executor, early, physical)
        physical = False
        if page is not None and i < RANKED_ACTIONS and last < len(job.data.time):
            kept = rank(part, page, kept, width, executor)
        if so_far is not None:
            so_far[:] = kept
        done, before = last, began
        began = time.monotonic()
        lasted = began - before
        words = "searched %d of %d actions: %d hypotheses, the best of %.1f nats"
        log.info(words, i + 1, len(actions), len(kept), kept[0].objective)
    return kept


def _selected(job: Job, starts, width: int, executor, early: bool, physical: bool):
    """Return the best distinct solves of the starts, by least motion.

    early: the starts compete too; physical: the starts continue solves by physics, so
    that the best of them is kept as it was.
    """
    found = _distributed(_solve_chunk, job, starts, executor)
    found += starts if early else []
    kept = distinct(job.shape, found, width)
    if early:
        return kept
    twin = any(same(job.shape, starts[0], h) for h in kept)
    return kept if twin and not physical else [*kept, starts[0]]


def rank(job, page, kept, width, executor=None) -> list[Hypothesis]:
    """Return the best distinct hypotheses by a page's first levels, solved roughly."""
    limit = min(h.objective for h in kept) + LEAST_MOTION_BEHIND
    promising = [h for h in kept if h.objective <= limit]
    if executor is not None:
        page = page.__name__  # a module is sent to other processes by its name
    found = _distributed(_rank_chunk, job, promising, executor, page)
    return distinct(job.shape, found, width, PHYSICS_BEHIND)


def _distributed(solve_chunk, job: Job, starts, executor, *args) -> list:
    """Solve every start, in order; in chunks over the executor if there is one."""
    if executor is None:
        return solve_chunk(job, starts, *args)
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    chunks = [starts[i::workers] for i in range(workers) if starts[i::workers]]
    futures = [executor.submit(solve_chunk, job, chunk, *args) for chunk in chunks]
    out = [None] * len(starts)
    try:
        for i, future in enumerate(futures):
            out[i::workers] = future.result()
    finally:  # after an error or Ctrl-C, pending chunks are cancelled
        for future in futures:
            future.cancel()
    return out


def _rank_chunk(job: Job, kept, page) -> list[Hypothesis]:
    """Return the hypotheses by a page's first levels, solved roughly."""
    page = page_named(page)
    problem, window = problem_for(job, page, (kept[0].theta, kept[0].x))
    levels, solvers = freed_levels(page.LEVELS, final=False), {}
    return [
        solved_roughly(job, problem, window, levels, h, RANKING_TOLERANCE, solvers)
        for h in kept
    ]


def _most_promising(job: Job, starts, count: int) -> list[Hypothesis]:
    """Return the cheapest distinct starts by the quasi-static page's own cost."""
    problem, window = problem_for(job, quasi_static)
    data, costed = problem.data(WEAK_MOTION), []
    for h in starts:
        x = problem.pack(start_values(problem, window, h))
        cost = sum(float(problem.value(n, x, data).sum()) for n in problem.costs)
        costed.append(replace(h, objective=cost))
    return distinct(job.shape, costed, count)


def _solve_chunk(job: Job, starts) -> list[Hypothesis]:
    problem, window = problem_for(job, quasi_static)
    weak = [
        replace(v, parameters=v.parameters | WEAK_MOTION) for v in quasi_static.LEVELS
    ]
    solvers, out = {}, []
    given = job, problem, window
    for h in starts:
        levels = weak if h.objective > COARSE_LEVEL else weak[-1:]
        out.append(solved_roughly(*given, levels, h, SEARCH_TOLERANCE, solvers))
    return out
