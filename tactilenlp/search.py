"""The beam: extends, solves, ranks and keeps hypotheses action by action.

Each new action extends every hypothesis kept by a few guesses.  The first actions leave
much open: guesses are solved by the quasi-static page for all actions so far, and where
a page with physics is given, that ranks them.  What is known then is a Gaussian, and
that page searches each further action alone (`local.py`).
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from formulations import quasi_static

from .extend import WEAK, before, continuations, extensions, first_touches, pasts_of
from .hypothesis import Hypothesis, Job, distinct, same
from .local import BEHIND, continued, settled
from .trial import ROUGH, opened, page_named, posed, spread, tried

__all__ = ["Hypothesis", "Job", "beam", "distinct", "extensions", "rank", "same"]

TOLERANCE = 1e-4  # of the search's solves; the page that follows is solved tighter
COARSE = 40.0  # [nats] a start that costs less than this skips the coarse level
RIVAL = 15.0  # [nats] of least motion behind the best: physics is not asked
EARLY = 2  # actions in which sizes are free: twice as many hypotheses


def beam(job: Job, kept, width: int, solves: int, executor=None, page=None):
    """Return the best distinct hypotheses for all actions of a job.

    kept: hypotheses of the first actions to carry on, if any; page: ranks them, else
    least motion does.  `width` are kept of `solves` that are solved by least motion,
    twice as many in the first actions, and guesses that least motion has not moved.
    """
    done = kept[0].x.shape[1] if kept else 0
    for i, action in enumerate(np.unique(job.data.action)):
        last = int(np.nonzero(job.data.action == action)[0][-1]) + 1
        if last <= done or not (job.data.contact & job.data.valid)[:last].any():
            continue
        part = replace(job, data=job.data.select(np.unique(job.data.action[:last])))
        ends = last == len(job.data.time)  # who asked solves the page from what is left
        kept = _further(part, kept, width, solves, executor, page, i < EARLY, ends)
    return kept


def _further(job, kept, width, solves, executor, page, early, ends) -> list[Hypothesis]:
    """Return the hypotheses of a job from those before its last action."""
    found = pasts_of(before(job), kept, page) if kept else []
    pasts = [past for past, _ in found]
    solved = [k for k, (_, by_page) in enumerate(found) if by_page]
    late = time.monotonic() > job.deadline
    if solved and not early and not late:
        known = [kept[k] for k in solved], [pasts[k] for k in solved]
        kept = continued(job, page, *known, width, executor)
        return kept if ends else settled(job, page, kept, width)
    more = 2 if early else 1
    starts = [h for _, h in continuations(job, kept, pasts)] if kept else None
    starts = _most_promising(job, starts or first_touches(job), solves * more)
    if time.monotonic() > job.deadline:  # what is left is guessed, not solved
        return starts[:width]
    found = spread(_solve_chunk, job, starts, executor)
    found += starts if early else []
    kept = distinct(job.shape, found, width * more)
    kept += [] if early else starts[:1]
    if page is None or ends:
        return kept
    return settled(job, page, rank(job, page, kept, width, executor), width)


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
        x = problem.pack({"theta": h.theta, "x": h.x[:, window.last]})
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
