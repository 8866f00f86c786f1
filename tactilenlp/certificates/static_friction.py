"""Static friction: what carries a body at rest, and what a slip would gain.

For sample k of a still span F_k = sum_{j<=k} dL/dx_j [nats / m] is the force that would
move the body there, L the objective with a pose for every sample.  On a ground it must
not exceed f = kappa mu of static friction.  (The Newton decrement of separate poses is
of no use there: pages round friction, so that poses creep.)  A slip of s changes L by

    -(|F_k| - f) s + c s^2 / 2

with the curvature c of the costs.  Without a ground f is small, a slip may go any way,
and this gain counts.  On a ground it does not: certified by it, bodies that had moved
between actions were held where 5 nats spoke against it, their paths 9 sigma off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from formulations.names import GROUND_FRICTION
from formulations.rigid_body import ARM, LEAST_ARM
from formulations.violation_implicit import WORK_COST

from ..common.brief import MM_PER_M
from ..data.scene import low_friction
from ..geometry.transforms import is_planar, left_jacobians
from ..local.solved import Solved

NEARLY_SLIPS = 0.5  # [-] of friction: such a span may slip when another one is cut
LONGEST_SLIP = 1e-3  # [m] as far as a body at rest is let slip where nothing holds it
MIN_SLIP_CURVATURE = 1e3  # [nats / m^2] softer than any touch: 1 / (30 mm)^2
ON_ICE = 1.0  # [nats / m] least force: without friction a body at rest feels rounding


class Slip(NamedTuple):
    """The largest force on a span of samples at rest, beyond NEARLY_SLIPS of friction.

    size [nats / m]; rows: the samples up to it; direction: the slip that it drives, [1]
    of ways and [rad / m] of turns.
    """

    size: float
    rows: np.ndarray
    direction: np.ndarray

    @property
    def cut(self) -> int:
        """The sample from which the body may be elsewhere."""
        return int(self.rows[-1]) + 1


def rest_force(scene, solved: Solved, whole) -> tuple[float, tuple[int, ...]]:
    """Return the largest force on the still spans as a share of static friction [-].

    The second result: the samples at which a span that may slip ends.  whole: the
    UnreducedProblem, with a pose for every sample, of a body on the ground.
    """
    x = whole.problem.unpack(whole.x)["x"]
    arm = np.r_[1, 1, _lever_arm(solved, whole.window)]
    friction = _static_friction(scene, solved.solution)
    share, slips = _slips(solved, whole, _along(x), arm, friction)
    return share, tuple(slip.cut for slip in slips)


def slip_gain(scene, solved: Solved, whole) -> tuple[float, tuple[int, ...]]:
    """Return by how many nats slips of a floating body would lower the objective.

    The second result: the samples at which a span that may slip ends.  whole: as of
    `rest_force`.
    """
    x = whole.problem.unpack(whole.x)["x"]
    along = np.tile(np.eye(len(x)), (x.shape[1], 1, 1))  # it may move any way
    arm = np.r_[1, 1, 1, ARM, ARM, ARM]  # [m] a radian counts as so much
    friction = _static_friction(scene, solved.solution)
    _, slips = _slips(solved, whole, along, arm, friction)
    if not slips:
        return 0.0, ()
    force = np.array([slip.size for slip in slips])
    gains = slip_gains(force - friction, _curvatures(whole, along, slips))
    return float(gains.sum()), tuple(slip.cut for slip in slips)


def _slips(solved, whole, along, arm, friction) -> tuple[float, list[Slip]]:
    """Return the largest force of all spans over friction, and the slips that are near.

    along (T, 3 or 6, u): ways in which a body may slip, as changes of its pose; arm:
    the length that a unit of each counts as [m].
    """
    slope = whole.problem.unpack(whole.whole_slope)["x"].T
    slope = np.einsum("tij,tj->ti", along, slope)[whole.window.pose]
    slips, share = [], 0.0
    for rows in _spans(solved.window.pose):
        force = np.cumsum(slope[rows[:-1]], axis=0) / arm
        size = np.linalg.norm(force, axis=1)
        i = int(np.argmax(size))
        share = max(share, size[i] / friction)
        if size[i] > NEARLY_SLIPS * friction:
            slips.append(Slip(size[i], rows[: i + 1], force[i] / size[i] / arm))
    return share, slips


def _spans(pose) -> list[np.ndarray]:
    """Return the samples of each pose that several share."""
    ends = np.flatnonzero(np.diff(pose)) + 1
    spans = np.split(np.arange(len(pose)), ends)
    return [rows for rows in spans if len(rows) > 1]


def slip_gains(excess, curvature) -> np.ndarray:
    """Return by how much slips lower an objective (n,) [nats], friction included.

    excess (n,) [nats / m]: of the force over friction; curvature (n,) [nats / m^2].
    """
    excess = np.maximum(excess, 0.0)
    curvature = np.maximum(curvature, MIN_SLIP_CURVATURE)
    slip = np.minimum(excess / curvature, LONGEST_SLIP)
    return slip * (excess - curvature * slip / 2)


def _curvatures(whole, along, slips: list[Slip]) -> np.ndarray:
    """Return the curvatures (n,) [nats / m^2] of the costs along slips (n,)."""
    v, pose = whole.problem.variables["x"], whole.window.pose
    D = np.zeros((whole.problem.size, len(slips)))
    for d, slip in zip(D.T, slips, strict=True):
        at = np.unique(pose[slip.rows])
        step = np.einsum("i,tij->tj", slip.direction, along[at])
        d[(v.span.start + v.rows * at)[:, None] + np.arange(v.rows)] = step
    problem, x, data = whole.problem, whole.x, whole.data
    H = sum(problem.hessian(name, x, data) for name in problem.costs)
    return np.einsum("ij,ij->j", D, H @ D)


def _along(x) -> np.ndarray:
    """Return (n, 3, u) two ways along the ground and a turn, as changes of x (u, n)."""
    out = np.zeros((x.shape[1], 3, len(x)))
    out[:, [0, 1], [0, 1]] = 1.0
    if is_planar(x):
        out[:, 2, 2] = 1.0
    else:
        out[:, 2, 3:] = np.linalg.inv(left_jacobians(x))[:, :, 2]
    return out


def _lever_arm(solved: Solved, window) -> float:
    """Return the arm [m] at which the ground's friction resists a turn."""
    legs = window.supports(solved.at.theta)
    return max(float(np.linalg.norm(legs[:, :2], axis=1).mean()), LEAST_ARM)


def _static_friction(scene, solution) -> float:
    """Return what friction dissipates when a body slides [nats / m].

    It is that of violation_implicit whatever page was solved, also one without
    dissipation; the page's own weight `kappa` and coefficient come first.
    """
    values = {"kappa": WORK_COST, GROUND_FRICTION: low_friction(scene)}
    values |= solution.parameters | solution.values
    kappa, mu = (float(np.ravel(values[k])[0]) for k in ("kappa", GROUND_FRICTION))
    # A page weighs friction in nats per mm.
    return max(MM_PER_M * kappa * mu * (scene.gravity > 0), ON_ICE)
