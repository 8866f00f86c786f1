r"""Impulses on a body that slides flat: rounded complementarity, Coulomb's law.

    lam_n = w S(-phi / (s dt))              0 <= lam_n  _|_  phi >= 0      as s -> 0
    lam_t = -mu lam_n v_s / sqrt(|v_s|^2 + s^2)                  maximum dissipation
    N_i   = S(a + b X_i + c Y_i)            loads of corners that hold the body flat

with S(z) = (z + sqrt(z^2 + LOAD_ROUNDING^2)) / 2.  One weight overlaps by s dt
and rebounds at two or three s: the energy of body and overlap never grows.  The ground
carries the body on the corners of `shape`, which share the load affinely: a, b, c are
the least loads that satisfy the other three balances, z, roll and pitch.  A corner that
would have to pull carries nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from .rigid_body import ARM
from .shape import positive_part

LOAD_ROUNDING = 0.1  # [weights] rounds the normal impulse where the gap closes
PULL_ROUNDING = 0.01  # [weights] rounds the load of a corner that would have to pull


class Pusher(NamedTuple):
    """A finger that may push: where it is at the end and the begin of a step, radius.

    p_wf, p_wf_1: as in finger.py [m]; rho [m].
    """

    p_wf: object
    p_wf_1: object
    rho: object


def push(body, step, mu, s, pusher):
    """Return where a finger touches (3,) [m], and its impulse on the body (3,) [N s].

    body: time_stepping.Sliding; step: rigid_body.Step; mu: friction; s [m/s]; pusher:
    a Pusher.
    """
    (p, R), (p_1, R_1) = (body.pose(step.theta, x) for x in (step.x, step.x_1))
    at = body.shape, step.theta, (p, R), pusher.p_wf, pusher.rho
    phi, (p_w, n) = body.finger.gap(*at), body.finger.touch(*at)
    lam_n = step.w * positive_part(-phi / (s * step.dt), LOAD_ROUNDING)
    body_before = p_1 + R_1 @ (R.T @ (p_w - p))
    v = (body.finger.before(p_w, pusher.p_wf, pusher.p_wf_1) - body_before) / step.dt
    return p_w, -lam_n * n + coulomb(mu * lam_n, v - n * ca.dot(v, n), s)


def drag(body, step, mu, s, force, moment):
    """Return friction of the ground (2,) [N s], its moment about z [N s m].

    force, moment (3,): what the ground has to bear, of which z, roll and pitch say how
    the corners share the load.
    """
    (p, R), (p_1, R_1) = (body.pose(step.theta, x) for x in (step.x, step.x_1))
    corners = [body.shape.corner(step.theta, ca.DM(c)) for c in body.shape.corners]
    arms = [R @ c for c in corners]
    ways = [(p + R @ c - p_1 - R_1 @ c) / step.dt for c in corners]
    each = [coulomb(mu, v[:2], s) for v in ways]
    bases = [ca.horzcat(1, r[0] / ARM, r[1] / ARM) for r in arms]
    load = ca.vertcat(force[2], moment[0] / ARM, moment[1] / ARM)
    abc = ca.inv_minor(bearing(bases, arms, each)) @ load
    total, turning = ca.SX.zeros(2), 0
    for b, r, f in zip(bases, arms, each, strict=True):
        N = positive_part(b @ abc, PULL_ROUNDING * step.w)
        total += N * f
        turning += N * (r[0] * f[1] - r[1] * f[0])
    return total, turning


def bearing(bases, arms, each):
    """Return the (3, 3) map from a, b, c to the load in z, roll and pitch."""
    A = 0
    for b, r, f in zip(bases, arms, each, strict=True):
        roll, pitch = r[1] - r[2] * f[1], r[2] * f[0] - r[0]
        A += ca.vertcat(1, roll / ARM, pitch / ARM) @ b
    return A


def coulomb(most, v_s, s):
    """Return the friction impulse against sliding at v_s [m/s], at most `most`."""
    return -most * v_s / ca.sqrt(ca.sumsqr(v_s) + s**2)
