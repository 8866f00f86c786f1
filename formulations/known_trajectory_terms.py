r"""The terms of known_trajectory.py: what a corner does on the ground, in nats.

    imbalance     4 (sqrt(1 + off / 4) - 1),   off = |linear|^2 + |angular|^2
    touching      lam_n / (lam_n + BITE w) touch(max(phi, 0))
    penetration   touch(max(-phi, 0))
    sliding       KAPPA (lam_f sqrt(|v_s|^2 + V_EPS^2) + v_s . lam_t - r w V_EPS)
                  dt / (w mm),       lam_f = mu lam_n + r w,   r = CONE_ROUNDING

w is m g dt.  An impulse at rest costs KAPPA mu lam_n V_EPS dt / (w mm).
The ground is z = a + b x + c y: (a, b, c) is the plane of all tosses plus the offset of
one.  A rotation R_wo is (9,), column by column.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from . import contact, sensing
from .shape import positive_part

GAP_EPS = 0.2e-3  # [m] rounds max(phi, 0)
KAPPA = 1.0  # [nats] for friction that fails to dissipate a weight moved by 1 mm
V_EPS = 10e-3  # [m/s] rounds the sliding speed: 0.07 mm in a step of 1/148 s
CONE_ROUNDING = 0.01  # [weights] rounds the apex of the friction cone
BITE = 0.25  # [weights] an impulse of that size is half a touch


class Ground(NamedTuple):
    """The ground z = a + b x + c y, (a, b, c) = plane + offset."""

    plane: object
    offset: object

    def frame(self):
        """Return the unit normal and two tangents."""
        level = self.plane + self.offset
        n = ca.vertcat(-level[1], -level[2], 1)
        n = n / ca.norm_2(n)
        return n, *contact.tangents(n, ca.DM([1, 0, 0]))

    def gap(self, p_w):
        """Return the height [m] of a point over the ground."""
        level, (n, _, _) = self.plane + self.offset, self.frame()
        return n[2] * (p_w[2] - level[0] - level[1] * p_w[0] - level[2] * p_w[1])

    def in_world(self, lam):
        """Return an impulse (normal, t1, t2) in the world frame [N s]."""
        n, *tangents = self.frame()
        return contact.impulse(lam, n, tangents)


class Vertex(NamedTuple):
    """A corner, sign * theta (3,) [m]."""

    theta: object
    sign: object


class Touch(NamedTuple):
    """An impulse lam (3,) [N s] on a Vertex."""

    lam: object
    corner: object


class Pose(NamedTuple):
    """A pose of the body, p_wo (3,) [m] and R_wo (9,)."""

    p_wo: object
    R_wo: object

    def place(self, corner):
        """Return where a corner is [m], world frame."""
        return self.p_wo + ca.reshape(self.R_wo, 3, 3) @ (corner.sign * corner.theta)


class StepMotion(NamedTuple):
    """How the body moves in a step: noise (2,): deviations [m/s], [rad/s]; dv [m/s].

    R_half, R_half_1: halfway to the next and from the last sample, where the body turns
    at omega and omega_1 [rad/s]; R_wo: at the sample.
    """

    noise: object
    dv: object
    omega: object
    omega_1: object
    R_half: object
    R_half_1: object
    R_wo: object


def gaussian(deviation):
    """Return the cost of a value with a mean and a deviation."""
    return lambda x, mean: ca.sumsqr((x - mean) / deviation) / 2


def imbalance(ground, inertia, fall, uniform, step, *touches):
    """Return the cost of a step: momentum change less impulses, pseudo-Huber."""
    m, g, dt = fall[0], fall[1], fall[2]
    halves = step.R_half, step.R_half_1, step.R_wo
    R, R_1, R_0 = (ca.reshape(r, 3, 3) for r in halves)
    body = ca.diag(uniform * inertia)
    linear = step.dv + ca.vertcat(0, 0, g * dt)
    angular = R @ body @ R.T @ step.omega - R_1 @ body @ R_1.T @ step.omega_1
    for lam, corner in touches:
        impulse = ground.in_world(lam) / m
        linear -= impulse
        angular -= ca.cross(R_0 @ (corner.sign * corner.theta), impulse)
    turn = (R_0.T @ angular) / (uniform * inertia)  # [rad/s]: what the tracker errs in
    off = ca.sumsqr(linear / step.noise[0]) + ca.sumsqr(turn / step.noise[1])
    return 4 * (ca.sqrt(1 + off / 4) - 1)


def cuboid_imbalance(ground, inertia, fall, theta, step, *touches):
    """Return the same of a cuboid of half widths theta (3,) [m]."""
    uniform = uniform_cuboid(theta)
    return imbalance(ground, inertia, fall, uniform, step, *touches)


def uniform_cuboid(theta):
    """Return the inertia per mass (3,) [m^2] of a uniform cuboid."""
    return (ca.sumsqr(theta) - theta * theta) / 3


def touching(ground, radius, corner, lam, w, surface, *poses):
    """Return the cost of an impulse on a corner that is, and was, above the ground.

    poses: now, one sample ago, one ahead.
    """
    now, before, after = (ground.gap(pose.place(corner)) - radius for pose in poses)
    dip = positive_part(before - 2 * now + after, GAP_EPS) / 2
    lowest = lesser(lesser(now, before), after) - dip
    off = sensing.touch(positive_part(lowest, GAP_EPS), surface)
    return lam[0] / (lam[0] + BITE * w) * off


def lesser(a, b):
    """Return the lesser of two gaps, rounded over GAP_EPS."""
    return (a + b - ca.sqrt((a - b) ** 2 + GAP_EPS**2)) / 2


def penetration(ground, radius, corner, surface, now):
    """Return the cost of a corner below the ground; surface [m]: tracker's error."""
    phi = ground.gap(now.place(corner)) - radius
    return sensing.touch(positive_part(-phi, GAP_EPS), surface)


def sliding(ground, corner, lam, mu, fall, w, before, after):
    """Return the cost of friction that does not dissipate, zero without an impulse."""
    dt, (_, t1, t2) = fall[2], ground.frame()
    v = (after.place(corner) - before.place(corner)) / (2 * dt)
    v_s = ca.vertcat(ca.dot(v, t1), ca.dot(v, t2))
    lam_f = mu * lam[0] + CONE_ROUNDING * w
    lost = contact.sliding_loss(lam_f, lam, v_s, V_EPS)
    return KAPPA * (lost - CONE_ROUNDING * w * V_EPS) * dt / (w * contact.MM)
