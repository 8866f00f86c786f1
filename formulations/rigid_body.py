r"""Pose kinematics of a rigid body, and its change of momentum over one time step.

    v_k = (p_k - p_{k-1}) / dt           omega_k = vee log(R_k R_{k-1}') / dt
    linear  = v_k - v_{k-1}                                     per unit mass
    angular = R I R' omega_k - R_1 I R_1' omega_{k-1}           about the centroid

A motion maps its unknowns x to the pose (p_wo, R_wo).  PLANAR slides flat on the
ground, x = (x, y, yaw), the height follows from the shape; FREE is a whole rigid
motion, x = (p_wo, rotation vector), whose chart is regular for turns below 2 pi.
The balance of impulse and momentum is in balance.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

G = 9.81  # [m/s^2] makes a weight of a mass, also where nothing falls
LEAST_ARM = 1e-3  # [m] of a body that rests on one point
ARM = 20e-3  # [m] length of the body: turns a moment into a force, a radian into a way


@dataclass(frozen=True)
class Motion:
    """How many unknowns a pose has, and what pose they mean.

    pose(shape, theta, x) -> p_wo (3,) [m], R_wo (3, 3).  scale: typical change of each
    unknown; unit: their units.
    """

    name: str
    unknowns: int
    scale: tuple[float, ...]
    unit: str
    pose: Callable


@dataclass(frozen=True)
class MassProperties:
    """Centroid (3,) [m] in the body frame, and inertia about it.

    inertia: (3, 3) [m^2] per unit mass.
    """

    centroid: object
    inertia: object


class Step(NamedTuple):
    """What a term reads of a time step: the body theta, its pose x, and x_1 before.

    dt [s]; w [N s]: the weight of the body over it; x_2: the pose two samples before,
    and dt_1 [s] from it to x_1, of terms that read a change of momentum.
    """

    theta: object
    x: object
    x_1: object
    dt: object
    w: object
    x_2: object = None
    dt_1: object = None


def steps_of(step, theta, x, w, s):
    """Return the Step that each instance of a term reads; s: its row in `step`."""
    return Step(theta, x[:, step.pose[s]], x[:, step.before[s]], step.dt[s], w)


def declare_poses(nlp, window):
    """Declare the poses x (unknowns, poses), of which the window may hold some."""
    motion = window.motion
    return nlp.variable(
        "x", motion.unknowns, window.poses, lower=window.lower, upper=window.upper,
        guess=0.0, unit=motion.unit, scale=motion.scale,
    )  # fmt: skip


def uniform(shape, theta):
    """Return the MassProperties of a shape whose origin is its centroid."""
    return MassProperties(ca.DM.zeros(3), shape.inertia(theta))


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

    Series of arcsin(s)/s to third order: 1e-5 rad off at 0.3 rad a step, 7e-3 at 0.8.
    """
    R = R_to @ R_from.T
    s = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    square = ca.sumsqr(s)
    return s * (1 + square / 6 + 3 * square * square / 40)


def momentum_change(body, poses, dt, dt_1=None):
    """Return the change of linear and angular momentum per unit mass over one step.

    (p - p_1) / dt - (p_1 - p_2) / dt_1, and likewise of the inertia times the spin.
    poses: (p_wo, R_wo) of the body's origin now, one and two samples ago; a body at
    rest has equal ones.  dt, dt_1 [s]: of this step and of the one before, as long
    where it is not given.  Returns (3,) [m/s] and (3,) [m^2/s], the latter about the
    centroid, world frame.
    """
    (p, R), (p_1, R_1), (p_2, R_2) = ((p + R @ body.centroid, R) for p, R in poses)
    change = p - 2 * p_1 + p_2
    before = R_1 @ body.inertia @ R_1.T @ turn(R_1, R_2)
    spin = R @ body.inertia @ R.T @ turn(R, R_1) - before
    if dt_1 is not None:  # exactly zero where both steps are as long
        uneven = 1 - dt / dt_1
        change += uneven * (p_1 - p_2)
        spin += uneven * before
    return change / dt, spin / dt
