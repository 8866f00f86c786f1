r"""The terms of known_trajectory.py: what a corner does on the ground, in nats.

    imbalance     4 (sqrt(1 + off / 4) - 1),   off = |linear|^2 + |angular|^2
    touching      lam_n / (lam_n + BITE w) touch(max(phi, 0))
    penetration   touch(max(-phi, 0))
    sliding       KAPPA (lam_f sqrt(|v_s|^2 + V_EPS^2) + v_s . lam_t - r w V_EPS)
                  dt / (w mm),       lam_f = mu lam_n + r w,   r = CONE_ROUNDING

w is m g dt.  An impulse at rest costs KAPPA mu lam_n V_EPS dt / (w mm).
The ground is z = a + b x + c y: (a, b, c) is the plane of all tosses plus the offset of
one.  A pose is p_wo (3,) and R_wo (9,), column by column; `_1` is one
sample ago, `_next` one ahead.
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


class Touch(NamedTuple):
    """A corner, sign * theta (3,) [m], and the impulse lam (3,) [N s] on it."""

    lam: object
    theta: object
    sign: object


def gaussian(deviation):
    """Return the cost of a value with a mean and a deviation."""
    return lambda x, mean: ca.sumsqr((x - mean) / deviation) / 2


def frame(plane, offset):
    """Return the unit normal and two tangents of the ground z = a + b x + c y."""
    level = plane + offset
    n = ca.vertcat(-level[1], -level[2], 1)
    n = n / ca.norm_2(n)
    return n, *contact.tangents(n, ca.DM([1, 0, 0]))


def place(p_wo, R_wo, theta, sign):
    """Return a corner of the body [m], world frame; R_wo (9,) column by column."""
    return p_wo + ca.reshape(R_wo, 3, 3) @ (sign * theta)


def gap(plane, offset, p_w):
    """Return the height [m] of a point over the ground."""
    level, (n, _, _) = plane + offset, frame(plane, offset)
    return n[2] * (p_w[2] - level[0] - level[1] * p_w[0] - level[2] * p_w[1])


def in_world(plane, offset, lam):
    """Return an impulse (normal, t1, t2) in the world frame [N s]."""
    n, t_1, t_2 = frame(plane, offset)
    return lam[0] * n + lam[1] * t_1 + lam[2] * t_2


def imbalance(
    plane, offset, inertia, fall, uniform, noise, dv, w, w_1, R_wo, R_wo_1, R_now,
    *touches,
):  # fmt: skip
    """Return the cost of a step: momentum change less impulses, pseudo-Huber.

    noise (2,): deviations [m/s], [rad/s].
    R_wo, R_wo_1: halfway to the next and from the last sample, where w and w_1 are.
    """
    m, g, dt = fall[0], fall[1], fall[2]
    R, R_1, R_0 = (ca.reshape(r, 3, 3) for r in (R_wo, R_wo_1, R_now))
    body = ca.diag(uniform * inertia)
    linear = dv + ca.vertcat(0, 0, g * dt)
    angular = R @ body @ R.T @ w - R_1 @ body @ R_1.T @ w_1
    for touch in touches:
        impulse = in_world(plane, offset, touch.lam) / m
        linear -= impulse
        angular -= ca.cross(R_0 @ (touch.sign * touch.theta), impulse)
    turn = (R_0.T @ angular) / (uniform * inertia)  # [rad/s]: what the tracker errs in
    off = ca.sumsqr(linear / noise[0]) + ca.sumsqr(turn / noise[1])
    return 4 * (ca.sqrt(1 + off / 4) - 1)


def touching(
    plane, offset, radius, theta, sign, lam, w, surface, p, R, p_1, R_1, p_next, R_next
):  # fmt: skip
    """Return the cost of an impulse on a corner that is, and was, above the ground."""
    now, before, after = (
        gap(plane, offset, place(p, R, theta, sign)) - radius
        for p, R in ((p, R), (p_1, R_1), (p_next, R_next))
    )
    dip = positive_part(before - 2 * now + after, GAP_EPS) / 2
    lowest = lesser(lesser(now, before), after) - dip
    off = sensing.touch(positive_part(lowest, GAP_EPS), surface)
    return lam[0] / (lam[0] + BITE * w) * off


def lesser(a, b):
    """Return the lesser of two gaps, rounded over GAP_EPS."""
    return (a + b - ca.sqrt((a - b) ** 2 + GAP_EPS**2)) / 2


def penetration(plane, offset, radius, theta, sign, surface, p_wo, R_wo):
    """Return the cost of a corner below the ground; surface [m]: tracker's error."""
    phi = gap(plane, offset, place(p_wo, R_wo, theta, sign)) - radius
    return sensing.touch(positive_part(-phi, GAP_EPS), surface)


def sliding(plane, offset, theta, sign, lam, mu, fall, w, p_1, R_1, p_next, R_next):
    """Return the cost of friction that does not dissipate, zero without an impulse."""
    dt, (_, t_1, t_2) = fall[2], frame(plane, offset)
    v = (place(p_next, R_next, theta, sign) - place(p_1, R_1, theta, sign)) / (2 * dt)
    v_s = ca.vertcat(ca.dot(v, t_1), ca.dot(v, t_2))
    most = mu * lam[0] + CONE_ROUNDING * w
    lost = contact.sliding_loss(most, lam, v_s, V_EPS)
    return KAPPA * (lost - CONE_ROUNDING * w * V_EPS) * dt / (w * contact.MM)
