"""Certify after a solve that five reductions were right, and name what to restore.

Exact reductions (far, absent, frictionless) must leave the optimum where it is; model
reductions (still, planar) must not be contradicted by the data.  The certificates of
far, absent and still are evaluated on the unreduced problem, built once at the
solution: every sample has a pose of its own, and every finger sample and impulse that
was dropped is restored.  Common constraints keep their multipliers.  New ones have zero
multipliers, new poses are those of their still span, and new impulses the page's own
guess.

The other three reductions (rigid, central, aligned) are nested models, which
refinement/nested_models compares with the larger ones: the declined of these are the
checks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from formulations.names import (
    FINGER,
    FINGER_FRICTION,
    FREE_TERM,
    GROUND,
    GROUND_FRICTION,
)

from ..local.solved import Solved
from ..local.transfer import matching_contacts, rows_of, samples_of, transferred_values
from ..nlp.kkt import gradient
from ..nlp.problem import Problem
from ..problem.job import Job
from ..problem.skipped import Certificates, Skipped
from .outliers import PLANAR_LIMIT, planar_share, unexplained_by_action
from .static_friction import rest_force, slip_gain

LEFT_OUT = ("still", "far", "absent")  # of samples, poses and impulses
NEUTRAL = 1e-6  # [relative] an exact reduction moves the objective by less
DECREMENT = 0.1  # [nats] what is left out would lower the objective by less


@dataclass(frozen=True, eq=False)
class UnreducedProblem:
    """The unreduced problem at a reduced solution.

    x (unknowns,) SI and data of `problem`; multipliers by constraint; far: rows of
    window.free, unfelt: rows of window.push, that had been left out.
    """

    window: object
    problem: Problem
    x: np.ndarray
    data: np.ndarray
    multipliers: dict[str, np.ndarray]
    far: np.ndarray
    unfelt: np.ndarray

    @cached_property
    def slope(self) -> np.ndarray:
        """The gradient (unknowns,) of the costs, SI."""
        return gradient(self.problem, self.x, self.data, self.problem.costs)

    @cached_property
    def whole_slope(self) -> np.ndarray:
        """The gradient (unknowns,) of costs and constraints times multipliers, SI."""
        lam = self.multipliers
        return self.slope + gradient(self.problem, self.x, self.data, lam, weights=lam)


def unreduced(job: Job, solved: Solved) -> UnreducedProblem:
    """Return a solved page without its reductions of samples, poses and impulses."""
    h, window, solution = solved.hypothesis, solved.window, solved.solution
    more = job.with_reductions(**dict.fromkeys(LEFT_OUT, False))
    more = replace(more, cuts=())
    again = more.window((h.theta, h.x), solved.at.theta)
    problem = job.build(again)
    values, _, multipliers = transferred_values(solved, again, problem)
    free = rows_of(samples_of(window.free), samples_of(again.free))
    unfelt = matching_contacts(window, again)[FINGER]
    return UnreducedProblem(
        window=again, problem=problem, x=problem.pack(values),
        data=problem.data(solution.parameters), multipliers=multipliers,
        far=np.nonzero(free < 0)[0], unfelt=np.nonzero(unfelt < 0)[0],
    )  # fmt: skip


def certify(job: Job, solved: Solved, rested: Skipped | None = None) -> Certificates:
    """Return the reductions of a solved page, each with its certificate.

    rested: that of the still spans, where it is known.
    """
    made, skipped, cuts = job.reductions, [], ()
    if made.still or made.far or made.absent:
        whole = unreduced(job, solved)
        skipped += [far(solved, whole)] * made.far + [absent(whole)] * made.absent
        if rested is not None:
            skipped.append(rested)
        elif made.still and len(solved.window.pose) > solved.window.poses:
            rest = slip_gain if job.scene.ground is None else rest_force
            value, slips = rest(job.scene, solved, whole)
            skipped.append(still(solved, value))
            cuts = () if skipped[-1].holds else slips
    if made.planar:
        skipped.append(planar_certificate(job, solved))
    skipped.append(frictionless(solved))
    return Certificates(tuple(s for s in skipped if s is not None), cuts)


def far(solved: Solved, whole) -> Skipped | None:
    """Certify that the dropped free samples cost nothing at the solution.

    A page whose term of free samples has another name may price them at anything.
    """
    if not len(whole.far):
        return None
    cost, problem = np.inf, whole.problem
    if FREE_TERM in problem.costs:
        cost = float(problem.value(FREE_TERM, whole.x, whole.data)[whole.far].sum())
    cost, limit = max(cost, 0.0), NEUTRAL * max(1.0, abs(solved.solution.objective))
    return Skipped(
        "far", f"{len(whole.far)} free samples", "certainly away from the object",
        "they would add to the objective [nats]", cost, limit, cost <= limit,
    )  # fmt: skip


def absent(whole) -> Skipped | None:
    """Certify that no impulse of a finger that feels nothing lowers the objective.

    The gradient of the Lagrangian by the impulses that were left out shows no descent.
    """
    if FINGER not in whole.problem.variables or not len(whole.unfelt):
        return None
    variable = whole.problem.variables[FINGER]
    slope = whole.whole_slope[variable.span].reshape(variable.columns, -1)
    normal = slope[whole.unfelt, 0]
    gain = float(max(0.0, (-normal * variable.scale[0]).max()))
    return Skipped(
        "absent", f"{len(whole.unfelt)} impulses", "the finger feels nothing",
        "pushing by one weight would gain at most [nats]", gain, DECREMENT,
        gain <= DECREMENT,
    )  # fmt: skip


def still(solved: Solved, value: float) -> Skipped:
    """Certify that a body stays at rest (static_friction.py).

    On a ground friction balances the forces on it; without one slips would gain little.
    """
    window = solved.window
    check, limit = "largest force on a body at rest, as a share of static friction", 1.0
    if solved.job.scene.ground is None:
        check, limit = "slips would lower the objective by [nats]", DECREMENT
    return Skipped(
        "still", f"{len(window.pose) - window.poses} poses",
        "nothing touched or moved the object", check, value, limit, value <= limit,
    )  # fmt: skip


def frictionless(solved: Solved) -> Skipped | None:
    """Certify dropped tangential impulses: at the solution the cones allow none."""
    solution, count, largest = solved.solution, 0, 0.0
    values = solution.parameters | solution.values
    for name, friction in ((FINGER, FINGER_FRICTION), (GROUND, GROUND_FRICTION)):
        lam = solution.values.get(name, np.zeros((0, 0)))
        if len(lam) == 1 and name in solved.window.frictionless:
            weight = solved.problem.variables[name].scale  # [N s] over a step
            allowed = np.multiply(values[friction], lam) / weight
            count, largest = count + 2 * lam.size, allowed.max(initial=largest)
    if not count:
        return None
    return Skipped(
        "frictionless", f"{count} tangential impulses", "friction is zero",
        "largest that the cone would allow [weights]", float(largest), 0.0,
        largest <= 0.0,
    )  # fmt: skip


def planar_certificate(job: Job, solved: Solved) -> Skipped:
    """Certify that an object that never tilts explains the touches (outliers.py)."""
    worst = planar_share(unexplained_by_action(job, solved))
    return Skipped(
        "planar", "height and two tilts of every pose", "the object lies flat",
        "share of an action's touches that no flat pose explains", worst, PLANAR_LIMIT,
        worst <= PLANAR_LIMIT,
    )  # fmt: skip
