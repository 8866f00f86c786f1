"""A page as it is built and as it is solved: its problem, a solution, their order."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from formulations.names import COMPLIANCE, FINGER_OFFSET, FINGER_TURN

from ..common.deadline import NEVER, Deadline
from ..data.ground import frame_of
from ..data.sensor_noise import variance_left
from ..geometry.faces import touched_faces
from ..information.goodness_of_fit import Fit, fit_of
from ..information.linearisation import Linearisation
from ..information.mixture import LocalOptimum, occam_of_hull
from ..information.tangent_space import (
    TangentSpace,
    tangent_space_of,
    tangent_space_of_hull,
)
from ..nlp.kkt import KKTSystem, kkt_system_of
from ..nlp.problem import Problem
from ..problem.fingertips import density_of_wrong_touches
from ..problem.hypothesis import Hypothesis, ranked
from ..problem.job import Job
from ..problem.pages import check_unknowns
from ..problem.polytope_window import PolytopeWindow
from ..problem.poses import poses
from ..problem.skipped import Certificates
from ..problem.window import Window
from ..solvers.options import SolverOptions
from ..solvers.solution import Solution, after
from ..solvers.solve import Solvers, solve_levels
from .margins import DECISIVE, NEGLIGIBLE

LEVEL_TIME = 60.0  # [s] at most, of one level of a page
SEARCH_TOLERANCE = 1e-4  # of solves that only start another page
SEARCH_TIME = 20.0  # [s] at most, of one such solve
ACCEPTABLE = {  # IPOPT's early stop: kinks of the surface make its steps tiny
    "acceptable_tol": 0.5,  # [nats / mm]
    "acceptable_obj_change_tol": 1e-4,  # [relative] over as many iterations
    "acceptable_iter": 5,
    "acceptable_compl_inf_tol": 1e-2,
    "acceptable_constr_viol_tol": 1e-4,
}


@dataclass(eq=False)
class BuiltPage:
    """The problem of a job's page, built, and what its solves share.

    origin: the hypothesis that it is built for, if any; seconds: of the build, until
    the first solve counts them.
    """

    problem: Problem
    window: Window | PolytopeWindow
    origin: Hypothesis | None
    seconds: float = 0.0
    _last_kkt: tuple | None = field(default=None, init=False, repr=False)

    @cached_property
    def solvers(self) -> Solvers:
        """The solvers of the problem, kept for further solves."""
        return Solvers(self.problem)

    def kkt_at(self, solution: Solution, deadline: Deadline = NEVER) -> KKTSystem:
        """Return the KKT system at a solution, kept until that at another one is."""
        if self._last_kkt is None or self._last_kkt[0] is not solution:
            kkt = kkt_system_of(self.problem, solution, deadline)
            self._last_kkt = solution, kkt
        return self._last_kkt[1]

    def values_at(self, h: Hypothesis) -> dict:
        """Return where a solve starts: a hypothesis as unknowns of the problem."""
        x = h.x[:, self.window.last]
        check_unknowns(self.problem, h.theta, x)
        theta = self.problem.variables["theta"]
        values = {"theta": h.theta.reshape(theta.columns, theta.rows).T, "x": x}
        if h.offset is not None and FINGER_OFFSET in self.problem.variables:
            values[FINGER_OFFSET] = h.offset
        return values

    def solve(
        self, job: Job, levels, start, hypothesis=None, before=None, settings=None
    ) -> Solved:
        """Return the page solved along some levels, from values or from a Solution.

        hypothesis: from which, by default the origin; before: the solution of earlier
        levels, whose iterations and seconds are added; settings: SolverOptions, by
        default those of a solve to the end.
        """
        settings = settings or settings_of(job)
        solution = solve_levels(self.problem, levels, start, settings, self.solvers)
        solution = solution if before is None else after(before, solution)
        solution, self.seconds = solution.with_build(self.seconds), 0.0
        return Solved(hypothesis or self.origin, self, solution, job)


@dataclass(frozen=True, eq=False)
class Solved:
    """A page solved from one hypothesis.

    before_last_level: the hypothesis after the levels before the last one; profile (k,
    k): how far sizes and final pose may be off (refinement/profile_likelihood.py);
    declined: larger models that the data did not ask for, each with its check.
    """

    hypothesis: Hypothesis
    built: BuiltPage
    solution: Solution
    job: Job
    certificates: Certificates = field(default_factory=lambda: Certificates(()))
    before_last_level: Hypothesis | None = None
    profile: np.ndarray | None = None
    declined: tuple = ()

    @property
    def problem(self) -> Problem:
        """The problem of the page."""
        return self.built.problem

    @property
    def window(self):
        """The measurements as the problem has them."""
        return self.built.window

    def with_window(self, window) -> Solved:
        """Return the solve as if of another window."""
        return replace(self, built=replace(self.built, window=window))

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
        """The key to sort by: failed solves last, then by cost, less the evidence lost.

        A face that no touch supports must lower the objective by DECISIVE.
        """
        favour = DECISIVE * self.hypothesis.closed
        cost = self.cost + (self.occam if self.solution.success else 0.0)
        return not self.solution.success, ranked(cost) - favour

    @cached_property
    def occam(self) -> float:
        """What the evidence loses by vertices whose number it chooses [nats]."""
        return occam_of_hull(self.kkt) if self.job.shape.counts else 0.0

    @cached_property
    def fit(self) -> Fit | None:
        """How well it explains its data; None of a page of another touch likelihood."""
        job = self.job
        left = variance_left(job.data, job.precision)
        return fit_of(self.problem, self.solution, self.window, job.data, left)

    @property
    def touched(self) -> np.ndarray:
        """How many samples touched each face of a box, (3, 2): lower end, upper end."""
        at = self.at
        _, quaternion = poses(self.window.shape, at.theta, at.x, None)
        turns = self.solution.values.get(FINGER_TURN)
        turns = None if turns is None else turns.T
        return touched_faces(self.job.data, quaternion, turns=turns)

    @property
    def at(self) -> Hypothesis:
        """The hypothesis moved to the solution."""
        values = self.solution.values
        c = values.get(COMPLIANCE)
        return replace(
            self.hypothesis,
            theta=values["theta"].T.ravel(),
            x=values["x"][:, self.window.pose],
            offset=values.get(FINGER_OFFSET),
            compliance=None if c is None else float(c.item()),
            objective=self.solution.objective,
        )

    @cached_property
    def kkt(self) -> KKTSystem:
        """The KKT system at the solution, which copies of this solve share."""
        return self.built.kkt_at(self.solution)

    @property
    def linearised(self) -> Linearisation:
        """The solution to first order."""
        return Linearisation(self.kkt, self.job, self.window)

    @cached_property
    def tangent(self) -> TangentSpace:
        """The coordinates of the shape and, unless it is held, of its final pose."""
        R_wg = frame_of(self.job.scene.ground).rotation.T
        problem, solution, window = self.problem, self.solution, self.window
        if window.shape.of_vertices:
            return tangent_space_of_hull(problem, solution, R_wg)
        return tangent_space_of(problem, solution, window, R_wg)

    @cached_property
    def optimum(self) -> LocalOptimum:
        """Shape and final pose of a shape with sizes, covariance by the Hessian."""
        z, R = self.tangent.z, self.tangent.R
        C, J = self.kkt.marginal(self.tangent.chosen), self.tangent.jacobian
        C, solution = J @ ((C + C.T) / 2) @ J.T, self.solution
        wrong = density_of_wrong_touches(self.problem, solution, self.window)
        return LocalOptimum(z, R, solution.objective + wrong, C, solution, self.window)


def best_first(solved) -> list[Solved]:
    """Return solves, the best first; what failed comes last."""
    return sorted(solved, key=lambda s: s.rank)


def close_to_best(solves) -> list[Solved]:
    """Return the solves that converged close to the first one, the best, without it."""
    limit = solves[0].cost + DECISIVE
    return [s for s in solves[1:] if s.solution.success and s.cost < limit]


@dataclass(eq=False)
class Solves:
    """What was solved by now: what is left where Ctrl-C or a deadline ends the rest.

    Each solve is added as it ends, to a collection that the caller holds.
    """

    ended: list[Solved] = field(default_factory=list)
    _parts: list[Solves] = field(default_factory=list)
    _provisional: Solves | None = None

    def add(self, solved: Solved) -> Solved:
        """Add a solve, and return it."""
        self.ended.append(solved)
        return solved

    def exchange(self, old: Solved, new: Solved) -> None:
        """Put a solve in the place of one that it finishes."""
        self.ended[self.ended.index(old)] = new

    def part(self, earlier=()) -> Solves:
        """Return a collection of its own, whose solves count as those here do."""
        self._parts.append(Solves([*earlier]))
        return self._parts[-1]

    def provisional(self) -> Solves:
        """Return a collection that counts as long as there is no other solve."""
        self._provisional = Solves()
        return self._provisional

    def best_first(self) -> list[Solved]:
        """Return the solves, the best first; provisional ones where these are all."""
        return best_first(self._to_the_end() or self._provisional_ones())

    def _to_the_end(self) -> list[Solved]:
        """Return the solves of this collection and its parts."""
        return [*self.ended, *(s for p in self._parts for s in p._to_the_end())]

    def _provisional_ones(self) -> list[Solved]:
        """Return the provisional solves of this collection and its parts."""
        own = self._provisional.best_first() if self._provisional else []
        return [*own, *(s for p in self._parts for s in p._provisional_ones())]


def comparable(best: Solved, solved) -> list[Solved]:
    """Return the solves that converged, of the best one's motion, of some weight."""
    least = best.solution.objective + NEGLIGIBLE
    return [
        s for s in solved
        if s.solution.success and s.window.motion is best.window.motion
        and s.solution.objective <= least
    ]  # fmt: skip


def settings_of(job: Job) -> SolverOptions:
    """Return the solver's settings within the time that a job has left."""
    left = min(LEVEL_TIME, max(0.1, job.deadline.left))
    kinked = ACCEPTABLE if job.shape.of_vertices else {}
    ipopt = {**kinked, **job.options.ipopt}
    tolerance = job.options.tolerance
    return SolverOptions(tolerance, left, ipopt=ipopt, deadline=job.deadline)


def search_settings(job: Job, **ipopt) -> SolverOptions:
    """Return the solver's settings of a solve that only starts another page."""
    deadline = job.deadline
    return SolverOptions(SEARCH_TOLERANCE, SEARCH_TIME, ipopt=ipopt, deadline=deadline)
