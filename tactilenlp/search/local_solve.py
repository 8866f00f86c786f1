"""Local solves of a page: from a hypothesis, from an earlier solution, continued."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from formulations.finger_offset import NAME as OFFSET
from formulations.rigid_body import PLANAR

from ..data.ground import frame_of
from ..geometry.faces import touched_faces
from ..geometry.tipping import planar_to_free
from ..information.information import FACE_COSINE, optimum_of
from ..information.mixture import LocalOptimum
from ..nlp.problem import Problem
from ..problem.certificates import Certificates
from ..problem.pages import check_unknowns
from ..problem.polytope_window import window_of
from ..problem.poses import poses
from ..problem.reductions import required_reductions
from ..problem.unreduced import transferred_values
from ..solvers.options import SolverOptions
from ..solvers.solution import Solution, after, unfinished
from ..solvers.solve import solve_levels
from .hypothesis import Hypothesis, Job
from .margins import DECISIVE, NEGLIGIBLE
from .polytope_init import CLOSED, IPOPT_OPTIONS, with_vertices_on_hull

RANKING_TOLERANCE = 1e-3  # of a page's solves that only rank hypotheses
LEVEL_TIME = 60.0  # [s] at most, of one level of a page
RESTART_MU = 1e-5  # IPOPT's mu_init from a solution that lacks only what was dropped
RESTARTED = ("theta", "x", "body")  # unknowns of a rebuilt page that it guesses itself


@dataclass(frozen=True, eq=False)
class Solved:
    """A page solved from one hypothesis: problem, window, solution.

    rough: the hypothesis after the levels before the last one; profile (k, k): how far
    sizes and final pose may be off (refinement/profile_likelihood.py); declined: larger
    models that the data did not ask for, each with its check; built_at: the start that
    the problem was built for, if another one.
    """

    hypothesis: Hypothesis
    problem: Problem
    window: object
    solution: Solution
    job: Job
    certificates: Certificates = field(default_factory=lambda: Certificates(()))
    rough: Hypothesis | None = None
    profile: np.ndarray | None = None
    declined: tuple = ()
    built_at: Hypothesis | None = None

    @property
    def origin(self) -> Hypothesis:
        """The hypothesis at which the problem is built again."""
        return self.built_at or self.hypothesis

    @property
    def skipped(self) -> tuple:
        """What was left out, each with its check."""
        return (*self.certificates.skipped, *self.declined)

    @property
    def cost(self) -> float:
        """The objective with the priors of what a solve takes as given [nats]."""
        return self.solution.objective + self.job.prior_cost

    @property
    def rank(self) -> tuple[bool, float]:
        """The key to sort by: failed solves last, then by cost.

        A face that no touch supports must lower the objective by DECISIVE.
        """
        favour = DECISIVE * (CLOSED in self.hypothesis.path)
        return not self.solution.success, round(self.cost, 3) - favour

    @property
    def touched(self) -> np.ndarray:
        """How many samples touched each face of a box, (3, 2): lower end, upper end."""
        at, motion = self.at, self.window.motion
        _, turned = poses(self.job.shape, motion, at.theta, at.x, None)
        return touched_faces(self.job.data, turned, FACE_COSINE)

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

    @cached_property
    def optimum(self) -> LocalOptimum:
        """Shape and final pose of a shape with sizes, covariance by the Hessian."""
        R_wg = frame_of(self.job.scene.ground).rotation.T
        given = self.problem, self.solution, self.window, self.job.shape
        return optimum_of(*given, R_wg)


def best_first(solved) -> list[Solved]:
    """Return solves, the best first; what failed comes last."""
    return sorted(solved, key=lambda s: s.rank)


def comparable(best: Solved, solved) -> list[Solved]:
    """Return the solves that converged, of the best one's motion, of some weight."""
    least = best.solution.objective + NEGLIGIBLE
    return [
        s for s in solved
        if s.solution.success and s.window.motion is best.window.motion
        and s.solution.objective <= least
    ]  # fmt: skip


# Problems of a page, where they start, how they are solved


def problem_at(job: Job, hypothesis=None):
    """Return problem and window of a job's page, and the seconds it took.

    hypothesis: where it is solved from; reach depends on it, and contacts of hulls.
    """
    began = time.process_time()
    made = required_reductions(job.page, job.reductions)
    guess = None if hypothesis is None else (hypothesis.theta, hypothesis.x)
    window, shape = window_of(replace(job, reductions=made), guess)
    problem = replace(job, shape=shape).build(window)
    return problem, window, time.process_time() - began


def start_values(problem, window, h: Hypothesis) -> dict:
    """Return where a solve starts: the hypothesis as unknowns of the problem."""
    check_unknowns(problem, h.theta, h.x[:, window.last])
    theta = problem.variables["theta"]
    theta = h.theta.reshape(theta.columns, theta.rows).T
    start = {"theta": theta, "x": h.x[:, window.last]}
    if h.offset is not None and OFFSET in problem.variables:
        start[OFFSET] = h.offset
    return start


def settings_of(job) -> SolverOptions:
    """Return the solver's settings within the time that a job has left."""
    left = min(LEVEL_TIME, max(0.1, job.deadline.left))
    ipopt = {**IPOPT_OPTIONS[job.shape.parameters], **job.options.ipopt}
    tolerance = job.options.tolerance
    return SolverOptions(tolerance, left, ipopt=ipopt, deadline=job.deadline)


# Solves from a hypothesis


def in_motion_of(job, h: Hypothesis) -> Hypothesis:
    """Return a hypothesis with free poses where a job has them: a body that lies."""
    if job.reductions.planar or len(h.x) != PLANAR.unknowns:
        return h
    return replace(h, x=planar_to_free(h.theta, h.x, job.shape))


def solved_from(job, hypothesis, shared=None, levels=None, before=None) -> Solved:
    """Solve the page from one hypothesis; `shared` keeps problem and solvers.

    levels: by default those of the page; before: the solution of earlier levels from
    this hypothesis, to start from.
    """
    shared = {} if shared is None else shared
    hypothesis = in_motion_of(job, hypothesis)
    if not shared:
        problem, window, built = problem_at(job, hypothesis)
        shared.update(window=window, problem=problem, solvers={}, built=built)
        shared["built_at"] = hypothesis
    window, problem = shared["window"], shared["problem"]
    settings = settings_of(job)
    start = start_values(problem, window, hypothesis) if before is None else before
    levels = levels or job.page.LEVELS
    first, *later = grouped(levels, lambda _, level: level.rebuild)
    solution = solve_levels(problem, first, start, settings, shared["solvers"])
    solution = solution if before is None else after(before, solution)
    solution.seconds["build"] += shared.pop("built", 0.0)  # it was built once
    solved = Solved(hypothesis, problem, window, solution, job)
    return _rebuilt_for(job, replace(solved, built_at=shared.get("built_at")), later)


# Warm starts: values and multipliers of an earlier solution


def transferred(known: Solved, window, problem) -> Solution:
    """Return a solution as the start of another problem of the same data, or of more.

    Values and multipliers of what both problems have are kept; the page guesses the
    values of the rest, whose multipliers are zero.
    """
    values, bounds, multipliers = transferred_values(known, window, problem)
    return replace(
        known.solution, values=values, bound_multipliers=bounds, multipliers=multipliers
    )


def warm_started(
    job, known: Solved, mu_init: float = RESTART_MU, hypothesis=None,
    start: Callable = transferred,
) -> Solved:  # fmt: skip
    """Solve the page's last level from an earlier solution and its multipliers.

    known: solved with other reductions, or with less data; mu_init: of IPOPT;
    hypothesis: at which the problem is built, by default that of `known`;
    start(known, window, problem): the Solution to start from.
    """
    hypothesis = known.hypothesis if hypothesis is None else hypothesis
    problem, window, built = problem_at(job, hypothesis)
    last = replace(job.page.LEVELS[-1], warm_start={"mu_init": mu_init})
    given = start(known, window, problem)
    solution = solve_levels(problem, (last,), given, settings_of(job))
    solution.seconds["build"] += built
    return Solved(hypothesis, problem, window, solution, job, declined=known.declined)


def freed_to_tilt(job, slid: Solved) -> Solved:
    """Solve the page in free motion from its solution `slid` in planar motion."""
    s, at = slid.solution, slid.at
    x = planar_to_free(at.theta, s.values["x"], job.shape)
    known = replace(
        s, values=s.values | {"x": x},
        bound_multipliers=s.bound_multipliers | {"x": np.zeros_like(x)},
    )  # fmt: skip
    at = replace(at, x=planar_to_free(at.theta, at.x, job.shape))
    lying = replace(slid, hypothesis=at, solution=known)
    found = warm_started(job, lying)
    return replace(found, solution=after(s, found.solution))


# Continuation: from an easier problem of the same page to the page itself


def continued(job, solved: Solved) -> Solved | None:
    """Solve again by continuation from where a solve ended; None if the page has none.

    A page with levels for guessed poses (`ROUGH`) starts from the last two of them:
    the kinks between sliding and sticking, which can hold a path in a local optimum,
    are smooth there.  A page that is extended action by action (`EXTENDS`) goes through
    all its levels, rebuilt before each.  None as well without time for it.
    """
    if job.deadline.passed("continuation"):
        return None
    if rough := job.contract.rough[-2:]:
        return solved_from(job, solved.at, levels=rough)
    if not job.contract.extends:
        return None
    return _rebuilt_for(job, solved, [[k] for k in job.page.LEVELS])


def grouped(levels, begins: Callable) -> list:
    """Return the levels in groups, a new one where begins(the one before, level)."""
    pairs = enumerate(pairwise(levels), 1)
    cuts = [i for i, pair in pairs if begins(*pair)]
    return [levels[i:k] for i, k in pairwise([0, *cuts, len(levels)])]


def _rebuilt_for(job, solved, groups) -> Solved:
    """Go on from a solve through groups of levels, the page rebuilt before each."""
    with job.deadline.ending("all levels of the page"):
        for levels in groups:
            if job.deadline.passed("all levels of the page"):
                break
            solved = _rebuilt(job, solved, levels)
        else:
            return solved
    return replace(solved, solution=unfinished(solved.solution))


def _rebuilt(job, solved, levels) -> Solved:
    """Go on from a solve through levels of the page, rebuilt where it ended."""
    h = with_vertices_on_hull(job.shape, solved.at)
    problem, window, built = problem_at(job, h)
    values, _, _ = transferred_values(solved, window, problem)
    kept = {name: v for name, v in values.items() if name not in RESTARTED}
    start = kept | start_values(problem, window, h)
    solution = solve_levels(problem, levels, start, settings_of(job))
    solution.seconds["build"] += built
    solution = after(solved.solution, solution)
    return Solved(h, problem, window, solution, job)
