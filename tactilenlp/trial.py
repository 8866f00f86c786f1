"""Solve a page from hypotheses: in this process, or spread over an executor."""

from __future__ import annotations

import importlib
import os
import time
from dataclasses import replace

from formulations.finger_offset import NAME as OFFSET

from .hypothesis import Hypothesis, Job
from .nlp import Problem
from .reduce import insisted, reduce
from .solve import SolverOptions, solve_levels

ROUGH = 1e-3  # tolerance of a page's solves that only rank
HELD, OPEN = 20, 20  # iterations of a level that holds poses, and of one that opens it
RELAXED = 0.03  # IPOPT's first mu where it is opened
LONGEST = 60.0  # [s] that one level of a page may take


def posed(job: Job, page, guess=None):
    """Return the problem that a page poses of a job's data, and the window."""
    made = insisted(page, job.reductions)
    window = reduce(job.data, job.scene, job.shape, job.precision, made, guess)
    problem = Problem(kinds=job.kinds_of(page, window))
    page.build(problem, window, job.scene, job.shape)
    return problem, window


def tried(job, problem, window, levels, h, tolerance, solvers) -> Hypothesis:
    """Return the hypothesis that solving the levels makes of h."""
    left = min(LONGEST, max(0.05, job.deadline - time.monotonic()))
    options = SolverOptions(tolerance=tolerance, time_limit=left)
    s = solve_levels(problem, levels, started(problem, window, h), options, solvers)
    theta, x = s.values["theta"][:, 0], s.values["x"][:, window.pose]
    offset = s.values.get(OFFSET)
    return Hypothesis(theta, x, s.objective, h.path, s.iterations, offset)


def started(problem, window, h: Hypothesis) -> dict:
    """Return where a solve starts: the hypothesis as unknowns of the problem."""
    theta = problem.variables["theta"]
    theta = h.theta.reshape(theta.columns, theta.rows).T
    start = {"theta": theta, "x": h.x[:, window.last]}
    if h.offset is not None and OFFSET in problem.variables:
        start[OFFSET] = h.offset
    return start


def opened(levels, final: bool):
    """Return levels to solve from guessed poses.

    What holds poses is solved for a few iterations only, so that impulses fit a path
    that is wrong still; then once more with nothing held.
    """
    first = []
    for level in levels:
        if level.fixed:
            first.append(level.with_ipopt(max_iter=HELD))
            free = replace(level, fixed=())
            first.append(free.with_ipopt(mu_init=RELAXED, max_iter=OPEN))
    rest = [level for level in levels if not level.fixed]
    return [*first, *rest] if final or not first else first


def spread(solve_chunk, job: Job, starts, executor, *args) -> list:
    """Solve every start, in order; spread over the executor in chunks."""
    if executor is None:
        return solve_chunk(job, starts, *args)
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    chunks = [starts[i::workers] for i in range(workers) if starts[i::workers]]
    futures = [executor.submit(solve_chunk, job, chunk, *args) for chunk in chunks]
    out = [None] * len(starts)
    try:
        for i, future in enumerate(futures):
            out[i::workers] = future.result()
    finally:  # after an error or Ctrl-C nobody waits for the others
        for future in futures:
            future.cancel()
    return out


def page_named(page):
    """Return a page: a module travels between processes by its name."""
    return importlib.import_module(page) if isinstance(page, str) else page
