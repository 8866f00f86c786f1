"""Solve a page from hypotheses: in this process, or spread over an executor.

Solve a page from a hypothesis: window, problem, solution, kept together.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field, replace

import numpy as np

from formulations.finger_offset import NAME as OFFSET
from formulations.rigid_body import PLANAR

from ..geometry.faces import touched_faces
from ..geometry.tipping import lifted
from ..information.information import TOUCHED
from ..nlp.ipopt import SolverOptions, solve_levels
from ..nlp.problem import Problem
from ..nlp.solution import after
from ..problem.certificates import Certificates
from ..problem.pages import is_polytope
from ..problem.polytope_window import window_of
from ..problem.poses import poses
from ..problem.reductions import insisted, reduce
from ..problem.unreduced import carried
from .hypothesis import Hypothesis, Job
from .polytope_init import CLOSED, CREEPING, reseeded

ROUGH = 1e-3  # tolerance of a page's solves that only rank
HELD, OPEN = 20, 20  # iterations of a level that holds poses, and of one that opens it
RELAXED = 0.03  # IPOPT's first mu where it is opened
LONGEST = 60.0  # [s] that one level of a page may take
CLOSE = 1e-5  # IPOPT's first mu where a solution is known but for what was left out
REASON = 3.0  # [nats] as odds of 20 to 1 are
CHOSEN_AGAIN = ("theta", "x", "body")  # where a page that is filled anew starts


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


@dataclass(frozen=True, eq=False)
class Solved:
    """A page solved from one hypothesis: problem, window, solution.

    rough: where the levels before the last one had brought the hypothesis; profile
    (k, k): how far off sizes and final pose may be (profile.py).
    """

    hypothesis: Hypothesis
    problem: Problem
    window: object
    solution: object
    job: Job
    certificates: Certificates = field(default_factory=lambda: Certificates(()))
    rough: Hypothesis | None = None
    profile: np.ndarray | None = None

    @property
    def skipped(self) -> tuple:
        """What was left out, each with its check."""
        return self.certificates.skipped

    @property
    def rank(self) -> tuple[bool, float]:
        """What to sort by: what failed comes last.

        A face that nothing felt must be worth REASON.
        """
        favour = REASON * (CLOSED in self.hypothesis.path)
        return not self.solution.success, round(self.solution.objective, 3) - favour

    @property
    def touched(self) -> np.ndarray:
        """How many samples touched each face of a box, (3, 2): lower end, upper end."""
        at, motion = self.at, self.window.motion
        _, turned = poses(self.job.shape, motion, at.theta, at.x, None)
        return touched_faces(self.job.data, turned, TOUCHED)

    @property
    def at(self) -> Hypothesis:
        """The hypothesis moved to the solution."""
        values = self.solution.values
        return replace(
            self.hypothesis,
            theta=values["theta"].T.ravel(),
            x=values["x"][:, self.window.pose],
            offset=values.get(OFFSET),
            objective=self.solution.objective,
        )


def solved_from(
    job, page, hypothesis, options, shared=None, levels=None, before=None
) -> Solved:
    """Solve the page from one hypothesis; `shared` keeps problem and solvers.

    before: what earlier levels found from this hypothesis, to go on from.
    """
    shared = {} if shared is None else shared
    if not job.reductions.planar and len(hypothesis.x) == PLANAR.unknowns:
        lying = lifted(hypothesis.theta, hypothesis.x, job.shape)
        hypothesis = replace(hypothesis, x=lying)
    if not shared:
        window, problem, built = built_at(job, page, hypothesis)
        shared.update(window=window, problem=problem, solvers={}, built=built)
    window, problem = shared["window"], shared["problem"]
    settings = settings_of(job, options)
    start = started(problem, window, hypothesis) if before is None else before
    first, *later = _rounds(levels or page.LEVELS)
    solution = solve_levels(problem, first, start, settings, shared["solvers"])
    solution = solution if before is None else after(before, solution)
    solution.seconds["build"] += shared.pop("built", 0.0)  # it was built once
    solved = Solved(hypothesis, problem, window, solution, job)
    for levels in later:
        solved = _anew(job, page, solved, levels, options)
    return solved


def _rounds(levels) -> list[list]:
    """Return the levels in groups, a new one before each level that rebuilds."""
    rounds = [[]]
    for level in levels:
        if level.rebuild and rounds[-1]:
            rounds.append([])
        rounds[-1].append(level)
    return rounds


def _anew(job, page, solved, levels, options) -> Solved:
    """Fill the page again where a solve ended and go on with more levels."""
    hypothesis = reseeded(solved.at) if is_polytope(job.shape) else solved.at
    window, problem, built = built_at(job, page, hypothesis)
    values, _, _ = carried(solved, window, problem)
    kept = {name: values[name] for name in values if name not in CHOSEN_AGAIN}
    start = kept | started(problem, window, hypothesis)
    solution = solve_levels(problem, levels, start, settings_of(job, options))
    solution.seconds["build"] += built
    solution = after(solved.solution, solution)
    return Solved(hypothesis, problem, window, solution, job)


def gone_on(job, page, solved, settings, warm) -> Solved:
    """Return a solve that goes on, with less left out, from where another one ended.

    warm: IPOPT's first mu.
    """
    window, problem, built = built_at(job, page, solved.hypothesis)
    values, pulls, multipliers = carried(solved, window, problem)
    start = replace(
        solved.solution, values=values, bound_multipliers=pulls, multipliers=multipliers
    )
    last = replace(page.LEVELS[-1], warm_start={"mu_init": warm})
    solution = solve_levels(problem, (last,), start, settings)
    solution.seconds["build"] += built
    return Solved(solved.hypothesis, problem, window, solution, job)


def let_tilt(job, page, slid, settings, warm) -> Solved:
    """Return the page in free motion, from where an object that slides was found.

    slid: the page solved in planar motion; warm: IPOPT's first mu.
    """
    s, at = slid.solution, slid.at
    x = lifted(at.theta, s.values["x"], job.shape)
    known = replace(
        s, values=s.values | {"x": x},
        bound_multipliers=s.bound_multipliers | {"x": np.zeros_like(x)},
    )  # fmt: skip
    at = replace(at, x=lifted(at.theta, at.x, job.shape))
    lying = replace(slid, hypothesis=at, solution=known)
    found = gone_on(job, page, lying, settings, warm)
    return replace(found, solution=after(s, found.solution))


def best_first(solved) -> list[Solved]:
    """Return solves, the best first; what failed comes last."""
    return sorted(solved, key=lambda s: s.rank)


def loosened(job, page, solved, options) -> Solved:
    """Return the better of a solve and of one that goes on from it, level by level."""
    again = solved
    for level in page.LEVELS:
        again = _anew(job, page, again, [level], options)
    return min(solved, again, key=lambda s: s.rank)


def built_at(job, page, hypothesis):
    """Return window and problem of a page at a hypothesis, and the seconds it took."""
    began = time.process_time()
    window, shape = window_of(job, (hypothesis.theta, hypothesis.x))
    problem = Problem(kinds=job.kinds_of(page, window))
    page.build(problem, window, job.scene, shape)
    return window, problem, time.process_time() - began


def settings_of(job, options) -> SolverOptions:
    left = min(LONGEST, max(0.1, job.deadline - time.monotonic()))
    ipopt = {**(CREEPING if is_polytope(job.shape) else {}), **options.ipopt}
    return SolverOptions(tolerance=options.tolerance, time_limit=left, ipopt=ipopt)
