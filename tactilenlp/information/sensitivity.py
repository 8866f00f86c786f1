r"""Compute the parametric sensitivity of an estimate to what was assumed.

    dz/da = - K^{-1} [ d^2 L / dx da ]
                     [ d g   / da    ]

for mass, frictions, sensor noise and finger offsets a, by the factorised K of the
solution and central differences of exact gradients: no solve is repeated (Fiacco,
Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, 1983).  It
holds as long as no contact changes its state.

The ground is assumed to be level, or as it was told.  r (2,) are its rotations about
its own horizontal axes, Gaussian of deviation Scene.sigma_tilt: seen from a ground that
is turned by r, positions and normals of the touches turn by -r.  What is known of r is
read as of consider_parameters.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..nlp.kkt import KKTSystem
from .consider_parameters import derivatives, ends_of

ASSUMPTION_STEP = 1e-4  # [-] relative change of what was assumed
TILT_STEP = 1e-5  # [rad] change of a tilt of the ground, of differences


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


@dataclass(frozen=True, eq=False)
class GroundTilt:
    """What is known of the rotations r (2,) [rad] of the ground from where it is taken.

    slope (unknowns, 2): derivative of the gradient by r; about (3,) [m]: the point of
    the ground that stays, ground frame; R_wg (3, 3): from there to the world; mean
    (2,), information (2, 2) of r by touches and prior; level: odds that there is no
    rotation at all, 0 once one was estimated.
    """

    slope: np.ndarray
    about: np.ndarray
    R_wg: np.ndarray
    mean: np.ndarray
    information: np.ndarray
    level: float

    @property
    def gain(self) -> float:
        """By how many nats the likeliest r lowers the objective."""
        return float(self.mean @ self.information @ self.mean) / 2

    @property
    def squared(self) -> np.ndarray:
        """E[r r'] (2, 2)."""
        second = np.linalg.inv(self.information) + np.outer(self.mean, self.mean)
        return second / (1 + self.level)

    def covariance(self, by_gradient, turned=0.0) -> np.ndarray:
        """Return the covariance (k, k) by it.

        by_gradient: see KKTSystem.sensitivity; turned (k, 2): how the k numbers turn
        with the frame of the ground itself.
        """
        moves = turned - by_gradient.T @ self.slope
        return moves @ self.squared @ moves.T

    def turned(self, points) -> np.ndarray:
        """Return how poses at points (n, 3) [m] of the ground's frame turn with it.

        (n, 6, 2), positions [m/rad] and rotations, world frame.
        """
        arm, axes = (points - self.about) @ self.R_wg.T, self.R_wg[:, :2]
        moved = np.stack([np.cross(axis, arm) for axis in axes.T], axis=2)
        turns = np.broadcast_to(axes, moved.shape)
        return np.concatenate([moved, turns], axis=1)


def ground_tilt(kkt: KKTSystem, build: Callable, window, data, scene, about):
    """Return the GroundTilt at a solution; build(window): as above.

    data: smoothed, as the problem has them; scene: with the ground in whose frame they
    are; about (3,) [m]: the point of the ground that stays, ground frame.
    """
    touch, ground, by_turn = window.touch, scene.ground, []
    for way in ((1, 0), (0, 1), (1, 1)):  # the last one for the mixed derivative
        turn = [-TILT_STEP * way[0], -TILT_STEP * way[1], 0.0]
        R = Rotation.from_rotvec(turn).as_matrix()
        seen = data.transformed(R, about - R @ about)
        p_wf, at = touch.p_wf.copy(), (touch.sample, touch.finger)
        p_wf[:, :3] = seen.finger_position[at]
        if seen.finger_orientation is not None and p_wf.shape[1] > 3:
            p_wf[:, 3:] = seen.finger_orientation[at]
        touched = replace(touch, p_wf=p_wf, normal=seen.normal[at])
        ends = ends_of(kkt, build, replace(window, touch=touched))
        by_turn.append(derivatives(kkt.problem, ends, TILT_STEP))
    (b_x, pull_x, xx), (b_y, pull_y, yy), (_, _, both) = by_turn
    slope, mixed = np.stack([b_x, b_y], axis=1), (both - xx - yy) / 2
    moved = np.stack([kkt.moved(b) for b in slope.T], axis=1)
    data = np.array([[xx, mixed], [mixed, yy]]) + slope.T @ moved
    values, vectors = np.linalg.eigh((data + data.T) / 2)
    prior = 1 / scene.sigma_tilt**2
    information = (vectors * (np.maximum(values, 0.0) + prior)) @ vectors.T
    tilted = (ground.rotation @ ground.tilt)[:2]  # so far, from where it was told
    mean = np.linalg.solve(information, np.array([pull_x, pull_y]) - prior * tilted)
    level = 0.0
    if ground.told is None:
        share = np.sqrt(np.linalg.det(information)) / prior
        level = share * np.exp(-mean @ information @ mean / 2)
    return GroundTilt(slope, about, ground.rotation.T, mean, information, float(level))
