r"""A polytope for the page `pushing`: its nearest point as a function that is called.

The nearest point of a hull takes a dozen Newton steps (nearest_point.py), and a step of
`pushing` needs it two dozen times.  So they are one function that is called, not
written out, and without derivatives.  One more step on

    u + V w(u) = q,    w = softmax(V'u / eps)                       (`exact`)

gives u, the vector from the nearest point to q, with exact first derivatives.

The body's origin is its centroid, and its foot its lowest vertices:

    c^2 = sum_j w_j (x_j^2 + y_j^2) / sum_j w_j,   w_j = exp((min z - z_j) / LIFTED)
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca

from . import nearest_point as near
from .finger import frozen
from .implicit import solve_3

LIFTED = 0.5e-3  # [m] a vertex this high carries a third of what the lowest does
HERE = (ca.DM.zeros(3), ca.DM.eye(3))  # pose: vertices are as they lie now


def as_pushed(shape, theta):
    """Return the class of polytopes of theta unknowns; distance, normal are calls."""
    return replace(shape, theta=theta, distance=distance, normal=normal)


def distance(theta, q_of, small):
    """Return the distance [m] from the hull of the point q_of, which is outside."""
    return near.length(towards(theta, q_of, small))


def normal(theta, q_of, small):
    """Return the outward unit normal towards the point q_of outside of the hull."""
    u = towards(theta, q_of, small)
    return u / near.length(u)


def towards(theta, q_of, small):
    """Return u (3,) [m] from the nearest point of the hull to q_of."""
    count = theta.numel() // 3
    V = ca.reshape(theta, 3, count)
    origin = V[:, 0]
    V, q = V - origin, q_of - origin
    small = small / near.SHARP
    nearest, exact = _functions(count)
    return exact(nearest(V, q, small), V, q, small)


@cache
def _functions(count):
    """Return nearest(V, q, small) -> u, a constant, and exact(u, V, q, small) -> u."""
    sizes = (3, 1), (1, 1), (3, count), (3, 1)
    arguments = u, small, V, q = [ca.SX.sym("in", *size) for size in sizes]
    size = near.size_of(V, q)
    residual, slope = near.residual_of(V, q, u, small * size)
    better = u - solve_3(frozen(slope, 2.0**-40), residual)
    exact = ca.Function(
        "exact", [u, V, q, small], [better],
        {"cse": True, "is_diff_in": [False, True, True, True]},
    )  # fmt: skip
    ends = ca.SX.sym("ends", 2)  # rounding before a step and after it
    followed = near.predictor_corrector(V, q, u, ends[0] * size, ends[1] * size)
    steps = {
        "begun": (small, near.damped_step(V, q, u, small * size)),
        "followed": (ends, followed),
        "newton": (small, near.newton_step(V, q, u, small * size)),
    }
    begun, followed, newton = (
        ca.Function(name, [u, widths, V, q], [after], {"cse": True})
        for name, (widths, after) in steps.items()
    )
    arguments = V, q, small = [ca.MX.sym("in", *size) for size in (*sizes[2:], (1, 1))]
    widths, u = small + ca.DM(near.WIDTHS).T, q - ca.sum2(V) / count
    for _ in range(near.FIRST):
        u = begun(u, widths[0], V, q)
    ends = ca.vertcat(widths[:, :-1], widths[:, 1:])
    u = followed.mapaccum(ends.shape[1])(u, ends, V, q)[:, -1]
    for _ in range(near.LAST):
        u = newton(u, small, V, q)
    constant = {"is_diff_in": [False] * 3}
    return ca.Function("nearest", arguments, [u], constant), exact


def legs_squared(theta, R_wo):
    """Return c^2 [m^2] of a hull: the mean square distance of its lowest vertices."""
    V = R_wo @ ca.reshape(theta, 3, theta.numel() // 3)
    height = V[2, :].T
    carries = ca.exp((ca.mmin(height) - height) / LIFTED)
    return ca.sum1(V[:2, :] ** 2) @ carries / ca.sum1(carries)
