r"""Pose kinematics, and the balance of impulse and momentum over one time step.

    v_k = (p_k - p_{k-1}) / dt           w_k = vee log(R_k R_{k-1}') / dt
    m (v_k - v_{k-1})     = sum of impulses + m g dt                    (linear)
    R I R' w_k - R I R' w_{k-1} = sum of r x impulse about the centroid (angular)

A motion maps its unknowns x to the pose (p_wo, R_wo).  PLANAR slides flat on the
ground, x = (x, y, yaw), the height follows from the shape; FREE is a whole rigid
motion, x = (p_wo, rotation vector), whose chart is regular for turns below 2 pi.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Motion:
    """How many unknowns a pose has, and what pose they mean.

    pose(shape, theta, x) -> p_wo (3,) [m], R_wo (3, 3).  scale: typical change of each
    unknown; units: their names.
    """

    name: str
    unknowns: int
    scale: tuple[float, ...]
    unit: str
    pose: Callable


def planar_pose(shape, theta, x):
    """Return the pose of a body that lies flat on the ground at z = 0."""
    c, s = ca.cos(x[2]), ca.sin(x[2])
    R_wo = ca.blockcat([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return ca.vertcat(x[0], x[1], shape.rest_height(theta)), R_wo


def free_pose(shape, theta, x):
    """Return the pose of a body that moves freely."""
    return x[:3], rotation(x[3:6])


PLANAR = Motion("planar", 3, (1e-3, 1e-3, 0.05), "m, m, rad", planar_pose)
FREE = Motion("free", 6, (1e-3,) * 3 + (0.05,) * 3, "m, m, m, rad, rad, rad", free_pose)


def rotation(w):
    """Return the rotation matrix of the rotation vector w (3,) [rad] (Rodrigues).

    1 - cos(a) = 2 sin(a / 2)^2, which does not cancel for small angles.
    """
    angle = ca.sqrt(ca.sumsqr(w) + 1e-16)
    half = ca.sin(angle / 2) / (angle / 2)
    K = ca.skew(w)
    return ca.DM.eye(3) + ca.sin(angle) / angle * K + half * half / 2 * K @ K


def turn(R_to, R_from):
    """Return the rotation vector from R_from to R_to (3,) [rad], for turns below 0.8.

    Series of arcsin(s)/s to third order: 4e-5 rad off at 0.3 rad a step.
    """
    R = R_to @ R_from.T
    s = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    square = ca.sumsqr(s)
    return s * (1 + square / 6 + 3 * square * square / 40)


def momentum_change(shape, motion, theta, x, x_1, x_2, dt):
    """Return the change of linear and angular momentum per unit mass over one step.

    x, x_1, x_2: pose now, one and two samples ago; a body at rest has x_1 = x_2.
    Returns (3,) [m/s] and (3,) [m^2/s], the latter about the centroid, world frame.
    """
    (p, R), (p_1, R_1), (p_2, R_2) = (
        motion.pose(shape, theta, c) for c in (x, x_1, x_2)
    )
    linear = (p - 2 * p_1 + p_2) / dt
    inertia = shape.inertia(theta)
    angular = R @ inertia @ R.T @ turn(R, R_1) - R_1 @ inertia @ R_1.T @ turn(R_1, R_2)
    return linear, angular / dt
