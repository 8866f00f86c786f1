"""The beam: extends, solves, ranks and keeps hypotheses action by action.

A hypothesis is one local optimum: which face was touched, which way the object is
turned, how it was pushed.  Each new action extends every hypothesis kept by a few
guesses; the most promising are solved by the quasi-static page, the best distinct ones
are kept.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace

import numpy as np

from formulations import quasi_static

from . import guess as guessing
from .nlp import Problem
from .reduce import reduce
from .solve import SolverOptions, solve_levels

TOLERANCE = 1e-4  # of the search's solves; the page that follows is solved tighter
COARSE = 40.0  # [nats] a start that costs less than this skips the coarse level
SAME = 1e-3  # [m] hypotheses whose corners agree this well are one
HOPELESS = 60.0  # [nats] behind the best start or hypothesis: not followed up


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One local optimum: theta (n,) [m], x (unknowns, T) planar poses, objective [nats].

    path: the guess it came from, one word an action.
    """

    theta: np.ndarray
    x: np.ndarray
    objective: float
    path: tuple[str, ...]
    iterations: int = 0

    def at(self, samples: int) -> Hypothesis:
        """Return the hypothesis of the first samples only."""
        return replace(self, x=self.x[:, :samples])


@dataclass(frozen=True, eq=False)
class Job:
    """What a solve needs to know, picklable: the data so far and how to read them."""

    data: object
    scene: object
    shape: object
    precision: object
    reductions: object
    deadline: float


def beam(job: Job, kept: list[Hypothesis], width: int, solves: int, executor=None):
    """Return the best distinct hypotheses (at most `width`) for all actions of a job.

    kept: hypotheses of the first actions to carry on, if any.
    """
    done = kept[0].x.shape[1] if kept else 0
    for action in np.unique(job.data.action):
        last = int(np.nonzero(job.data.action == action)[0][-1]) + 1
        if last <= done or not (job.data.contact & job.data.valid)[:last].any():
            continue
        if kept and time.monotonic() > job.deadline:
            break
        part = replace(job, data=job.data.select(np.unique(job.data.action[:last])))
        starts = _most_promising(part, extensions(part, kept), solves)
        kept = distinct(job.shape, _solve_all(part, starts, executor), width)
    return kept


def extensions(job: Job, kept: list[Hypothesis]) -> list[Hypothesis]:
    """Return unsolved hypotheses: guesses of how the last action continues each one."""
    data, shape = job.data, job.shape
    window = reduce(data, job.scene, shape, job.precision, job.reductions)
    new = np.nonzero(data.action == data.action[-1])[0]
    if not kept:
        return _first(data, window, shape)
    out = []
    for h in kept:
        now = h.x[:, -1]
        variations = [("on", h.theta, now)]
        variations += guessing.realigned(
            data, window, shape, h.theta, now, data.action[-1]
        )
        for name, theta, x in variations:
            past = guessing.carried(h.x, now, x)
            tail = guessing.follow(data, window, shape, theta, x, new)
            path = (*h.path, name)
            out.append(Hypothesis(theta, np.hstack([past, tail]), np.inf, path))
    return out


def _first(data, window, shape) -> list[Hypothesis]:
    """Return the guesses of the first touch, at rest before it."""
    t = int(np.argwhere((data.contact & data.valid).any(axis=1))[0, 0])
    out = []
    for name, theta, x in guessing.first_guesses(data, shape):
        tail = guessing.follow(
            data, window, shape, theta, x, range(t, len(data.time))
        )
        path = np.hstack([np.repeat(x[:, None], t, axis=1), tail])
        out.append(Hypothesis(theta, path, np.inf, (name,)))
    return out


def _most_promising(job: Job, starts, count: int) -> list[Hypothesis]:
    """Return the cheapest distinct starts by the quasi-static page's own cost."""
    problem, window = _problem(job, None)
    data, costed = problem.data(), []
    for h in starts:
        x = problem.pack({"theta": h.theta, "x": h.x[:, window.last]})
        cost = sum(float(problem.value(n, x, data).sum()) for n in problem.costs)
        costed.append(replace(h, objective=cost))
    return distinct(job.shape, costed, count)


def _solve_all(job: Job, starts, executor) -> list[Hypothesis]:
    """Solve every start, in order; spread over the executor in chunks."""
    if executor is None:
        return _solve_chunk(job, starts)
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    chunks = [starts[i::workers] for i in range(workers) if starts[i::workers]]
    solved = list(executor.map(_solve_chunk, [job] * len(chunks), chunks))
    out = [None] * len(starts)
    for i, chunk in enumerate(solved):
        out[i::workers] = chunk
    return out


def _solve_chunk(job: Job, starts) -> list[Hypothesis]:
    guess = starts[0]
    problem, window = _problem(job, guess)
    solvers, out = {}, []
    for h in starts:
        left = max(0.05, job.deadline - time.monotonic())
        options = SolverOptions(tolerance=TOLERANCE, time_limit=left)
        levels = quasi_static.LEVELS
        levels = levels if h.objective > COARSE else levels[-1:]
        start = {"theta": h.theta, "x": h.x[:, window.last]}
        s = solve_levels(problem, levels, start, options, solvers)
        theta, x = s.values["theta"][:, 0], s.values["x"][:, window.knot]
        out.append(Hypothesis(theta, x, s.objective, h.path, s.iterations))
    return out


def _problem(job: Job, guess):
    del guess
    window = reduce(job.data, job.scene, job.shape, job.precision, job.reductions)
    problem = Problem()
    quasi_static.build(problem, window, job.scene, job.shape)
    return problem, window


def distinct(shape, found, count: int) -> list[Hypothesis]:
    """Return the best `count` hypotheses of which no two are the same body."""
    kept = []
    for h in sorted(found, key=lambda h: h.objective):
        if kept and h.objective > kept[0].objective + HOPELESS:
            break
        if len(kept) < count and not any(same(shape, h, k) for k in kept):
            kept.append(h)
    return kept


def same(shape, a: Hypothesis, b: Hypothesis) -> bool:
    """Tell whether two hypotheses are one: corners agree at the first and last pose."""
    for k in (0, -1):
        corners = [guessing.corners(shape, h.theta, h.x[:, k]) for h in (a, b)]
        apart = np.linalg.norm(corners[0][:, None] - corners[1][None], axis=2)
        if max(apart.min(axis=0).max(), apart.min(axis=1).max()) > SAME:
            return False
    return True
