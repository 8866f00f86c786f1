"""Least motion: trajectories solved by the quasi-static page, over processes if asked.

The page fits what was felt with as little motion as possible, without forces.  Its
optimum is a second start beside each track: where the pushing model erred by a
millimetre, physics finds another pattern of sticking and sliding from there.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, Protocol

from formulations import quasi_static
from formulations.finger_offset import NAME as OFFSET

from ..common.threads import on_one_thread
from ..solvers.options import SolverOptions
from ..solvers.solve import solve_levels
from .hypothesis import Hypothesis, Job, same
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
    """Return for the first tracks, in order, the optimum of least motion from there.

    Tracks are left out from where no further optimum is expected.  executor: over which
    all tracks are solved in chunks; the result is the same.
    """
    if executor is None:
        return _until_all_found(job.shape, _solved(job, tracks))
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    chunks = [tracks[i::workers] for i in range(workers) if tracks[i::workers]]
    futures = [executor.submit(_solved_chunk, job, chunk) for chunk in chunks]
    out = [None] * len(tracks)
    try:
        for i, future in enumerate(futures):
            out[i::workers] = future.result()
    finally:  # after an error or Ctrl-C, pending chunks are cancelled
        for future in futures:
            future.cancel()
    return _until_all_found(job.shape, out)


def _until_all_found(shape, solved: Iterable[Hypothesis]) -> list[Hypothesis]:
    """Return optima, in order, until those found are probably all.

    The expected number of all optima, (solves - 1) / (solves - found - 2) for each
    found, is then less than half of one above those found (Boender and Rinnooy Kan,
    Bayesian stopping rules for multistart global optimization methods, Math. Program.
    37, 1987).
    """
    out, found = [], []
    for h in solved:
        out.append(h)
        if not any(same(shape, h, other) for other in found):
            found.append(h)
        n, k = len(out), len(found)
        if n > k + 2 and k * (n - 1) / (n - k - 2) < k + 0.5:
            break
    return out


@on_one_thread
def _solved_chunk(job: Job, tracks) -> list[Hypothesis]:
    return [*_solved(job, tracks)]


def _solved(job: Job, tracks) -> Iterator[Hypothesis]:
    """Yield the optimum of least motion from each track."""
    problem, window, _ = problem_at(job, quasi_static)
    level = quasi_static.LEVELS[-1]
    level = replace(level, parameters=level.parameters | WEAK_MOTION)
    solvers = {}
    for h in tracks:
        late = job.deadline.passed("least motion of all tracks")
        yield h if late else _solved_from(job, problem, window, level, h, solvers)


def _solved_from(job, problem, window, level, h: Hypothesis, solvers) -> Hypothesis:
    """Return the optimum of least motion from a track."""
    left = min(LEVEL_TIME, max(0.05, job.deadline.left))
    options = SolverOptions(TOLERANCE, left, deadline=job.deadline)
    start = start_values(problem, window, h)
    s = solve_levels(problem, (level,), start, options, solvers)
    theta, x = s.values["theta"][:, 0], s.values["x"][:, window.pose]
    offset = s.values.get(OFFSET)
    return Hypothesis(theta, x, s.objective, h.path, s.iterations, offset)
