r"""A finger as a spring between where it is, p, and where it is meant to be, r.

    lam(phi) = k S(-phi) / sqrt(1 + (k S(-phi) / f_max)^2)         it presses
    f_t(u)   = k u / sqrt(1 + (k |u| / (mu_f lam))^2)              it rubs

phi is the gap at r, u = r - p less the way of the touched point, both along the
surface: the finger sticks like a spring until friction lets it slip, then
|f_t| -> mu_f lam.  S(x) = max(x, 0), rounded over SOFT.
"""

from __future__ import annotations

import casadi as ca

from .shape import positive_part

FAINT = 1e-6  # [N] of friction where nothing touches
SOFT = 5e-5  # [m] rounds the onset of a contact


def press(phi, stiffness, max_force):
    """Return the normal force [N] of a finger meant to be at a gap phi [m]."""
    force = stiffness * positive_part(-phi, SOFT)
    return force / ca.sqrt(1 + (force / max_force) ** 2)


def contact_of(shape, finger, theta, pose, p_wf, rho):
    """Return gap, normal and the slope (1, 3) of the gap along (x, y, yaw)."""
    phi = finger.gap(shape, theta, pose, p_wf, rho)
    n = finger.normal(shape, theta, pose, p_wf, rho)
    return phi, n, -(n.T @ lever(pose, p_wf - rho * n))


def lever(pose, p_w):
    """Return how a body's point p_w moves with (x, y, yaw), (3, 3)."""
    a = p_w - pose[0]
    return ca.blockcat([[1, 0, -a[1]], [0, 1, a[0]], [0, 0, 0]])


def held_back(pose, d, p_wf, p_wf_1, rho, n):
    """Return how a touched point moves along the surface with d (3, 3), and u (3,)."""
    along = ca.DM.eye(3) - n @ n.T
    across = along @ lever(pose, p_wf - rho * n)
    return across, along @ (p_wf - p_wf_1) - across @ d


def sticking(u, friction, stiffness):
    """Return the share of u (3,) [m] that friction [N] holds: 1 sticks, 0 slips."""
    force = stiffness * stiffness * ca.sumsqr(u)
    return (friction + FAINT) / ca.sqrt((friction + FAINT) ** 2 + force)


def positive_slope(x):
    """Return the derivative of S(x) at the onset of a contact."""
    return (1 + x / ca.sqrt(x * x + SOFT**2)) / 2
