"""Least motion: trajectories solved by the quasi-static page, over processes if asked.

The page fits what was felt with as little motion as possible, without forces.  Its
optimum is a second start beside each track: where the pushing model erred by a
millimetre, physics finds another pattern of sticking and sliding from there.  By its
Hessian the posterior of what was solved is a Gaussian mixture (`from_posterior`).
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from formulations import quasi_static

from ..common.threads import on_one_thread
from ..local.comparison import same_body
from ..local.local_solve import built_page
from ..local.margins import LEAST_MOTION_BEHIND
from ..local.solved import LEVEL_TIME
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..solvers.options import SolverOptions
from ..tracking.geometry import geometry_of

log = logging.getLogger("tactilenlp")
WEAK_MOTION = {"motion weight": 100.0}  # [nats/m] a third of the page's own
TOLERANCE = 1e-3  # [-] of these solves: they are starts
UNSEEN = 0.5  # expected optima that are not sought: their number rounds to none
# [m, rad] deviations of a posterior, at most and at least:
SIGMA_MAX = 0.02, 0.03, 0.5  # of sizes, place, yaw
SIGMA_MIN = 1e-3, 1e-3, 0.03
UNSEEN_INFORMATION = 1e-4  # [1 / scaled unknown^2] of an unobserved direction
ROUND = 8  # tracks at a time over an executor: the fewest that show one optimum alone


class Executor(Protocol):
    """What spreads work over processes: any executor of concurrent.futures, or Dask.

    Functions and arguments are sent by pickle, so that the functions of a Shape of
    one's own are in a file that the other processes can import.  A page is not sent.
    """

    def submit(self, function, /, *arguments) -> Any:
        """Call function(*arguments) elsewhere; return a Future: result(), cancel()."""


def least_motion(
    job: Job, tracks, executor: Executor | None, cache: dict
) -> list[Hypothesis]:
    """Return for the first tracks, in order, the optimum of least motion from there.

    It ends where hardly an optimum is left to be seen (`unseen_optima`).  executor:
    over which tracks are solved, several at a time; cache: optima by track, extended.
    """
    ends, optima, left = [], [], [h for h in tracks if h not in cache]
    new = _optima(job, left) if executor is None else _optima_over(job, left, executor)
    for track in tracks:
        if track not in cache:
            cache[track] = next(new)
        h = cache[track]
        ends.append(h)
        if not any(same_body(job.shape, h, other) for other in optima):
            optima.append(h)
        limit = min(h.objective for h in ends) + LEAST_MOTION_BEHIND
        starts, seen = (sum(h.objective <= limit for h in k) for k in (ends, optima))
        if unseen_optima(starts, seen) < UNSEEN:
            words = "least motion: %d optima from %d starts, others are not expected"
            log.info(words, seen, starts)
            break
    return ends


def unseen_optima(starts: int, seen: int) -> float:
    """Return how many optima are expected besides those seen from so many starts.

    The posterior mean of Boender and Rinnooy Kan (Math. Program. 37, 1987), if any
    number of optima and any sizes of their basins are as probable.  Starts of a search
    are far from each other, so that they see more than random ones do.
    """
    left = starts - seen - 2
    return seen * (seen + 1) / left if left > 0 else np.inf


def _optima_over(job: Job, tracks, executor) -> Iterator[Hypothesis]:
    """Solve rounds of tracks over an executor, each in a chunk for every worker."""
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    for begin in range(0, len(tracks), ROUND):
        some = tracks[begin : begin + ROUND]
        chunks = [some[i::workers] for i in range(workers) if some[i::workers]]
        futures = [executor.submit(_optima_here, job, chunk) for chunk in chunks]
        out = [None] * len(some)
        try:
            for i, future in enumerate(futures):
                out[i::workers] = future.result()
        finally:  # after an error or Ctrl-C, pending chunks are cancelled
            for future in futures:
                future.cancel()
        yield from out


@on_one_thread
def _optima_here(job: Job, tracks) -> list[Hypothesis]:
    """Return the optima of least motion from tracks, in a process of its own."""
    return list(_optima(job, tracks))


def _optima(job: Job, tracks) -> Iterator[Hypothesis]:
    """Yield the optimum of the quasi-static page from each track; late ones as is."""
    built = built_page(replace(job, page=quasi_static))
    level = quasi_static.LEVELS[-1]
    level = replace(level, parameters=level.parameters | WEAK_MOTION)
    for h in tracks:
        if job.deadline.passed("least motion of all tracks"):
            yield h
            continue
        left = min(LEVEL_TIME, max(0.05, job.deadline.left))
        options = SolverOptions(TOLERANCE, left, deadline=job.deadline)
        start = built.values_at(h)
        solved = built.solve(job, (level,), start, h, settings=options)
        yield solved.at


def from_posterior(job: Job, kept) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return for each hypothesis (P, along), by the Hessian of least motion.

    P (n + 3, n + 3): covariance of theta and last pose; along (T, 3, n + 3): slopes of
    the poses in these.  The job holds the data of the hypotheses' samples.
    """
    built = built_page(replace(job, page=quasi_static))
    problem, window, out = built.problem, built.window, []
    data, scale = problem.data(WEAK_MOTION), problem.scale
    n, m = job.shape.theta, window.motion.unknowns
    theta, poses = (problem.variables[name].span for name in ("theta", "x"))
    geometry = geometry_of(job.shape)
    most, least = (geometry.each(*s) for s in (SIGMA_MAX, SIGMA_MIN))
    end = np.r_[theta, poses.stop - m : poses.stop]
    for h in kept:
        x = problem.pack(built.values_at(h))
        H = sum(problem.hessian(name, x, data) for name in problem.costs).toarray()
        values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
        vectors = vectors * scale[:, None]
        C = (vectors / np.maximum(np.abs(values), UNSEEN_INFORMATION)) @ vectors[end].T
        along = np.linalg.solve(C[end], C[poses].T).T.reshape(-1, m, n + m)[window.pose]
        shrink = np.minimum(1, most / np.sqrt(np.diag(C[end])))
        P = C[end] * np.outer(shrink, shrink) + np.diag(least**2)
        out.append((P, along))
    return out
