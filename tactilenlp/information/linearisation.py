r"""A solution to first order: how an estimate responds to data and to assumptions.

    dz/da = - K^{-1} [ d^2 L / dx da ]
                     [ d g   / da    ]

for measurements, mass, frictions, sensor noise and finger offsets a, by the factorised
K of the solution and central differences of exact gradients: no solve is repeated
(Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming,
1983).  It holds as long as no contact changes its state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from formulations.indentation import PUSH
from formulations.names import FINGER_IMPULSE, TOUCH_TERM
from formulations.rigid_body import G

from ..data.ground import frame_of
from ..data.scene import low_friction
from ..data.sensor_noise import reported_late
from ..geometry.transforms import is_planar
from ..nlp.kkt import KKTSystem
from ..problem.fingertips import finger_poses
from ..problem.job import Job
from ..problem.window import Window
from .consider_parameters import (
    ConsiderParameter,
    Prior,
    by_derivatives,
    derivatives,
    ends_of,
    scalars_of,
)
from .measurement_noise import (
    MixedDerivatives,
    mixed_derivatives,
    sensitivity_to_measurements,
)
from .tangent_space import pose_jacobians

ASSUMPTION_STEP = 1e-4  # [-] relative change of what was assumed
TILT_STEP = 1e-5  # [rad] change of a tilt of the ground, of differences


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A solution to first order: its KKT system, and what its measurements move.

    job: the search's Job, whose deadline is checked between the terms of the budget.
    """

    kkt: KKTSystem
    job: Job
    window: Window

    @cached_property
    def derivatives(self) -> list[MixedDerivatives]:
        """The mixed derivatives of every term that reads measurements."""
        return mixed_derivatives(self.kkt, self.job, self.window)

    @cached_property
    def consider_parameters(self) -> dict[str, ConsiderParameter]:
        """What is known of each consider parameter of one component, by name."""
        return scalars_of(self)

    @cached_property
    def motions(self) -> np.ndarray:
        """How poses move (unknowns, 3), zero for other unknowns.

        Columns: velocity; displacement of a body that was released in motion;
        extrapolation over the latency of the last samples of actions.
        """
        kkt, window, latency = self.kkt, self.window, self.job.precision.latency
        pose, step = kkt.problem.variables["x"], window.step
        x = kkt.x[pose.span].reshape(pose.columns, pose.rows)
        v, ahead = np.zeros_like(x), np.zeros_like(x)
        v[step.pose] = (x[step.pose] - x[step.before]) / step.dt[:, None]
        unseen = window.pose[reported_late(self.job.data, latency)]
        ahead[unseen] = latency * v[unseen]
        ways = v.ravel(), window.let_go(x.T).T.ravel(), ahead.ravel()
        motions = np.zeros((kkt.x.size, 3))
        motions[pose.span] = np.stack(ways, axis=1)
        return motions

    @cached_property
    def presses(self) -> np.ndarray:
        """How hard each touch (touches,) presses, in weights.

        By its impulse, and at least what slides a body over the ground; the deviation
        of a push, where ground or another finger holds against it: no motion tells how
        hard two fingers squeeze a body, or one presses on its top.
        """
        problem, window, scene = self.kkt.problem, self.window, self.job.scene
        sample, normal = window.touch.sample, window.touch.normal
        against = -normal @ normal.T * (sample[:, None] == sample)
        held = np.maximum(against.max(axis=1, initial=0.0), normal[:, 2])
        least = np.maximum(low_friction(scene), PUSH * held)
        if FINGER_IMPULSE not in problem.reports or not len(window.push):
            return least
        row, stepped = window.push_of_touch
        impulse = problem.value(FINGER_IMPULSE, self.kkt.x, self.kkt.data)[row]
        weight = scene.mass * G * window.step.dt[window.push.step[row]]
        found = -(impulse * window.touch.normal).sum(axis=1) / weight
        return np.maximum(least, stepped * found)

    @cached_property
    def tilt(self) -> ConsiderParameter | None:
        """The tilt of the ground about the point of it below the body's `end`.

        None where it is known, or there is none.
        """
        touched = TOUCH_TERM in self.kkt.problem.costs
        if self.job.scene.tilt_is_known or not touched:
            return None
        return ground_tilt(self, self.end * (1, 1, 0))

    def slopes_by_tilt(self, points) -> np.ndarray:
        """Return how poses at points (n, 3) [m] of the ground's frame move by the tilt.

        (n, 6, 2), positions [m/rad] and rotations, world frame.
        """
        arm = (points - self.end * (1, 1, 0)) @ self.R_wg.T
        axes = self.R_wg[:, :2]
        positions = np.stack([np.cross(axis, arm) for axis in axes.T], axis=2)
        rotations = np.broadcast_to(axes, positions.shape)
        return np.concatenate([positions, rotations], axis=1)

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The unknowns by name, as in a Solution."""
        return self.kkt.problem.unpack(self.kkt.x)

    @property
    def R_wg(self) -> np.ndarray:
        """The rotation (3, 3) from the ground's frame, of the problem, to the world."""
        return frame_of(self.job.scene.ground).rotation.T

    @cached_property
    def end(self) -> np.ndarray:
        """The body's middle (3,) [m] at the last sample, ground frame."""
        theta, x = self.values["theta"], self.values["x"][:, -1:]
        shape, motion = self.window.shape, self.window.motion
        if shape.of_vertices:
            return self.vertices.mean(axis=0)
        return pose_jacobians(shape, motion, theta[:, 0], x)[0][0]

    @property
    def vertices(self) -> np.ndarray:
        """The vertices (V, 3) [m] of a polytope at the last sample, ground frame.

        Its axes are those of the frame there.
        """
        return vertices_at_end(self.values)

    def response(self, chosen, jacobian, by_ground=0.0) -> Response:
        """Return the response of J z, with J (k, n) and z (n,) the chosen unknowns.

        by_ground (k, 2): how they turn with the frame of the ground itself.
        """
        by_gradient, by_constraint = (
            part @ jacobian.T for part in self.kkt.sensitivity(chosen)
        )
        C = jacobian @ by_gradient[chosen]
        motions = (jacobian @ self.motions[chosen]).T
        hessian = (C + C.T) / 2
        return Response(self, by_gradient, by_constraint, hessian, by_ground, motions)


@dataclass(frozen=True, eq=False)
class Response:
    """How k numbers of interest respond to errors: what terms are computed from.

    by_gradient (unknowns, k), by_constraint (rows, k): see KKTSystem.sensitivity;
    hessian (k, k): the covariance by the Hessian alone; by_ground: see
    Linearisation.response; motions (3, k): see Linearisation.motions.
    """

    linearisation: Linearisation
    by_gradient: np.ndarray
    by_constraint: np.ndarray
    hessian: np.ndarray
    by_ground: np.ndarray | float
    motions: np.ndarray

    def to_measurements(self, through_touches: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return how they move with positions and normals, (k, T, F, 3) each.

        Through the touches alone, or through all other terms.
        """
        terms = [
            mixed for mixed in self.linearisation.derivatives
            if (mixed.term.name == TOUCH_TERM) == through_touches
        ]  # fmt: skip
        data = self.linearisation.job.data
        columns = self.by_gradient, self.by_constraint
        return sensitivity_to_measurements(terms, data, *columns)


def vertices_at_end(values: dict) -> np.ndarray:
    """Return the vertices (V, 3) [m] of a polytope at the last sample, ground frame.

    values: the unknowns by name, SI.
    """
    x = values["x"][:3, -1]
    return values["theta"].T + (x * (1, 1, 0) if is_planar(values["x"]) else x)


def kkt_residual(problem, kkt: KKTSystem, data=None) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradient of L and the values of all constraints at the solution.

    data: by default those of `problem`, with the parameters of the solution.
    """
    if data is None:
        data = kkt.data + (problem.data() - kkt.problem.data())
    forces = [np.ravel(kkt.multipliers[name]) for name in problem.constraints]
    forces = np.concatenate([np.zeros(0), *forces])
    slope, g = problem.assembly.lagrangian(kkt.x / problem.scale, data, forces)
    return slope / problem.scale, g


def difference(by_gradient, by_constraint, ends, step) -> np.ndarray:
    """Return the change (k,) with r; ends: KKT residuals at r = step, -step."""
    (s, g), (s_1, g_1) = ends
    return -(by_gradient.T @ (s - s_1) + by_constraint.T @ (g - g_1)) / (2 * step)


def ground_tilt(linearisation: Linearisation, about) -> ConsiderParameter:
    """Return what is known of the tilt (2,) [rad] of the ground.

    about (3,) [m]: the point of the ground that stays, ground frame.
    """
    kkt, window, job = linearisation.kkt, linearisation.window, linearisation.job
    touch, ground, by_turn = window.touch, job.scene.ground, []
    at = touch.sample, touch.finger
    for way in ((1, 0), (0, 1), (1, 1)):  # the last one for the mixed derivative
        R = Rotation.from_rotvec([*np.multiply(-TILT_STEP, way), 0.0]).as_matrix()
        seen = job.data.transformed(R, about - R @ about)
        p_wf, normal = finger_poses(seen, job.scene)[at], seen.normal[at]
        touched = replace(touch, p_wf=p_wf, normal=normal)
        ends = ends_of(linearisation, replace(window, touch=touched))
        by_turn.append(derivatives(kkt.problem, ends, TILT_STEP))
    (b_x, pull_x, xx), (b_y, pull_y, yy), (_, _, both) = by_turn
    slope, mixed = np.stack([b_x, b_y], axis=1), (both - xx - yy) / 2
    pull, bend = np.array([pull_x, pull_y]), np.array([[xx, mixed], [mixed, yy]])
    turned = (ground.rotation @ ground.tilt)[:2]  # so far, from where it was told
    prior = Prior(job.scene.sigma_tilt, -turned, -np.inf, odds=ground.told is None)
    return by_derivatives(kkt, slope, pull, bend, prior)
