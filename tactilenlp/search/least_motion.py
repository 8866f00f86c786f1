"""Least motion: trajectories solved by the quasi-static page, over processes if asked.

The page fits what was felt with as little motion as possible, without forces.  Its
optimum is a second start beside each track: where the pushing model erred by a
millimetre, physics finds another pattern of sticking and sliding from there.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any, Protocol

from formulations import quasi_static
from formulations.finger_offset import NAME as OFFSET

from ..common.threads import on_one_thread
from ..solvers.options import SolverOptions
from ..solvers.solve import solve_levels
from .hypothesis import Hypothesis, Job
from .local_solve import LEVEL_TIME, problem_at, start_values

WEAK_MOTION = {"motion weight": 100.0}  # [nats/m] a third of the page's own
TOLERANCE = 1e-3  # [-] of these solves: they are starts


class Executor(Protocol):
    """What spreads work over processes: any executor of concurrent.futures, or Dask.

    Functions and arguments are sent by pickle, so that the functions of a Shape of
    one's own are in a file that the other processes can import.  A page is not sent.
    """

    def submit(self, function, /, *arguments) -> Any:
        """Call function(*arguments) elsewhere; return a Future: result(), cancel()."""


def least_motion(
    job: Job, tracks, executor: Executor | None = None
) -> list[Hypothesis]:
    """Return for each track, in order, the optimum of least motion from there.

    executor: over which the tracks are solved in chunks.
    """
    if executor is None:
        return _solved(job, tracks)
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    chunks = [tracks[i::workers] for i in range(workers) if tracks[i::workers]]
    futures = [executor.submit(_solved, job, chunk) for chunk in chunks]
    out = [None] * len(tracks)
    try:
        for i, future in enumerate(futures):
            out[i::workers] = future.result()
    finally:  # after an error or Ctrl-C, pending chunks are cancelled
        for future in futures:
            future.cancel()
    return out


@on_one_thread
def _solved(job: Job, tracks) -> list[Hypothesis]:
    problem, window, _ = problem_at(replace(job, page=quasi_static))
    level = quasi_static.LEVELS[-1]
    level = replace(level, parameters=level.parameters | WEAK_MOTION)
    solvers = {}
    out = []
    for h in tracks:
        if job.deadline.passed("least motion of all tracks"):
            out.append(h)
            continue
        out.append(_solved_from(job, problem, window, level, h, solvers))
    return out


def _solved_from(job, problem, window, level, h: Hypothesis, solvers) -> Hypothesis:
    """Return the optimum of least motion from a track."""
    left = min(LEVEL_TIME, max(0.05, job.deadline.left))
    options = SolverOptions(TOLERANCE, left, deadline=job.deadline)
    start = start_values(problem, window, h)
    s = solve_levels(problem, (level,), start, options, solvers)
    theta, x = s.values["theta"][:, 0], s.values["x"][:, window.pose]
    offset = s.values.get(OFFSET)
    return Hypothesis(theta, x, s.objective, h.path, s.iterations, offset)
