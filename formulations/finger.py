r"""Convex end-effectors: gap and normal between a finger and a body.

A finger is a convex core swept by a ball of radius rho: the core of a sphere is one
point, that of a capsule a segment.  With p the point of the core nearest to the body,

    gap    = distance(theta, p) - rho           normal = grad distance(theta, p)

and the finger touches the body at p - rho normal.  Where a finger is, p_wf, is a vector
of data: (3,) [m] the centre of a sphere; (7,) the centre of a capsule and the unit
quaternion wxyz that turns finger to world, its segment along the finger's z axis.

The nearest point of a segment p(u) = c + u a, -1 < u < 1, is where

    F(u) = (1 - u^2) a . grad distance(p(u)) + 2 tau u = 0,

the minimum of distance(p(u)) - tau log(1 - u^2).  The distance is convex along the
segment, so there is just one, found by bisection.  The log makes u(theta, x) smooth
where the nearest point runs into an end, and unique where segment and face are parallel
(the middle); it widens the gap by tau at most.  Bisection has no derivatives; from its
end each of two Newton steps, u - F(u, x) / A with A = dF/du frozen, gives u one more
exact derivative with respect to x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import casadi as ca

TAU = 5e-5  # [rho] tau: turns the normal by sqrt(tau / rho) rad = 0.4 deg at most
SEGMENT_HALVINGS = 20  # of the segment: to its length / 10^6, where Newton finishes


def to_body(pose, p_w):
    """Return the world point p_w in the body frame."""
    p_wo, R_wo = pose
    return R_wo.T @ (p_w - p_wo)


def sphere_core(shape, theta, pose, p_wf, rho):
    """Return the centre of a sphere, world frame [m]."""
    return p_wf


def sphere_before(p_w, p_wf, p_wf_1):
    """Return where the sphere's point p_w was: a sphere is taken not to turn."""
    return p_w - p_wf + p_wf_1


def segment_before(p_w, p_wf, p_wf_1):
    """Return where the capsule's point p_w was, which turns with it."""
    q_f = quaternion_matrix(p_wf[3:]).T @ (p_w - p_wf[:3])
    return p_wf_1[:3] + quaternion_matrix(p_wf_1[3:]) @ q_f


def quaternion_matrix(q):
    """Return the rotation matrix of a unit quaternion wxyz."""
    w, v = q[0], q[1:]
    return (w * w - ca.sumsqr(v)) * ca.DM.eye(3) + 2 * (v @ v.T + w * ca.skew(v))


def segment_core(half_length, shape, theta, pose, p_wf, rho):
    """Return the point of a capsule's segment nearest to the body, world frame [m]."""
    c_wf, a_wf = p_wf[:3], half_length * quaternion_matrix(p_wf[3:])[:, 2]
    slope, steepness = _along(shape)
    line = theta, to_body(pose, c_wf), pose[1].T @ a_wf, rho
    u = 0
    for k in range(SEGMENT_HALVINGS):
        u -= ca.sign(slope(u, *line)) / 2 ** (k + 1)
    u = frozen(u - slope(u, *line) / steepness(u, *line), 2.0**-50)
    A = frozen(steepness(u, *line), 1e-6 * TAU * rho)
    for _ in range(2):
        u -= slope(u, *line) / A
    return c_wf + u * a_wf


def unchanged(normal, p_wf=None):
    """Return the normal: the orientation of finger and sensor is known."""
    return normal


def frozen(value, quantum):
    """Return the value, rounded to whole quanta: a constant to any derivative."""
    return ca.floor(value / quantum) * quantum


@cache
def _along(shape):
    """Return F(u), and dF/du, on the segment c + u a of the body frame."""
    u, rho = ca.SX.sym("u"), ca.SX.sym("rho")
    theta, c, a = (ca.SX.sym(*s) for s in (("theta", shape.theta), ("c", 3), ("a", 3)))
    tau = TAU * rho
    distance = shape.distance(theta, c + u * a, rho / 10)
    F = (1 - u * u) * ca.gradient(distance, u) + 2 * tau * u
    arguments = [u, theta, c, a, rho]
    return (
        ca.Function("slope", arguments, [F], {"cse": True}),
        ca.Function("steepness", arguments, [ca.gradient(F, u)], {"cse": True}),
    )


@dataclass(frozen=True)
class Finger:
    """The functions of an end-effector, given where it is, p_wf, and its rho [m].

    numbers: how many p_wf has; core(shape, theta, pose, p_wf, rho) -> (3,) [m] nearest
    point of the core, world frame; before(p_w, p_wf, p_wf_1) -> (3,) [m] where the
    finger's own point p_w was when the finger was at p_wf_1; felt(normal, p_wf) -> (3,)
    the normal that the finger measures; measured(normal) -> (3,) the measured normal,
    from what a page has as such.
    """

    numbers: int
    core: Callable
    before: Callable
    felt: Callable = unchanged
    measured: Callable = unchanged

    def gap(self, shape, theta, pose, p_wf, rho):
        """Return the gap [m] between body and finger."""
        p_w = self.core(shape, theta, pose, p_wf, rho)
        return shape.distance(theta, to_body(pose, p_w), rho / 10) - rho

    def normal(self, shape, theta, pose, p_wf, rho):
        """Return the body's outward unit normal towards the finger, world frame."""
        return self.touch(shape, theta, pose, p_wf, rho)[1]

    def touch(self, shape, theta, pose, p_wf, rho):
        """Return the finger's point nearest to the body [m], and that normal, world."""
        p_w = self.core(shape, theta, pose, p_wf, rho)
        n = pose[1] @ shape.normal(theta, to_body(pose, p_w), rho / 10)
        return p_w - rho * n, n


SPHERE = Finger(3, sphere_core, sphere_before)


@cache
def capsule(half_length):
    """Return a capsule whose segment is 2 half_length [m] long (0: a sphere)."""
    return Finger(7, partial(segment_core, half_length), segment_before)
