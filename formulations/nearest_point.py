r"""The point of a convex hull nearest to a given point, smooth in the vertices.

The point c of the hull of vertices v_j nearest to q is

    c = sum w_j v_j,    w = argmin |q - sum w_j v_j|^2 / 2 + eps sum w_j log w_j

over the simplex; the entropy keeps every weight positive, so that c is smooth where the
nearest feature changes from face to edge to vertex.  With u = q - c its dual is a
concave problem of three unknowns,

    max_u  u . q - |u|^2 / 2 - eps log sum exp(u . v_j / eps),   w = softmax(V'u / eps),

whose optimality condition u + V w(u) = q (`residual_of`) is solved by Newton's method
with continuation in eps: a predictor step along du/deps, then a Newton step; without
the predictor, steps overshoot on large faces and diverge.  eps = small |q - middle|, so
the hull is rounded over lengths of `small`.

Where roots are noted (implicit.py), u is one; else the steps after `frozen` give it one
more exact derivative each (finger.py).
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import casadi as ca

from .finger import frozen
from .implicit import are_noted, root, solve_3

SHARP = 30  # lengths of rounding in `small`, a tenth of the finger: 0.03 mm
LEAST_DISTANCE = 1e-6  # [m] a distance is not exactly zero, so that it has derivatives
WIDTHS = (*(10e-3 * 2.0**-k for k in range(10)), 0.0)  # [m] added to small, in turn
FIRST = 4  # Newton steps while the hull is most round
LARGEST_CHANGE = 5.0  # [-] by which these change log w_j - log w_k at most
LAST = 3  # Newton steps where the hull is sharp, before freezing
EXACT_STEPS = 2  # more Newton steps: exact derivatives where written out


def length(u):
    """Return |u| [m] of a vector (3,) [m], nowhere exactly zero."""
    return ca.sqrt(ca.sumsqr(u) + LEAST_DISTANCE**2)


def towards(vertices, q_of, small):
    """Return u (3,) [m] from the nearest point of the hull of vertices (3, k) to q_of.

    small: length [m] over which edges and corners are rounded.
    """
    count, origin = vertices.shape[1], vertices[:, 0]
    V, q = vertices - origin, q_of - origin
    if not are_noted():
        return _written_out(count)(V, q, small)
    eps = size_of(V, q) * small
    return root(lambda u: residual_of(V, q, u, eps)[0], _found(count), V, q, small)


@cache
def _found(count):
    """Return (V (3, count), q, small) -> u, without derivatives."""
    V, q, small = ca.SX.sym("V", 3, count), ca.SX.sym("q", 3), ca.SX.sym("small")
    u, eps = _iterated(V, q, small)
    for _ in range(EXACT_STEPS):
        u = newton_step(V, q, u, eps)
    return ca.Function("found", [V, q, small], [u])


@cache
def _written_out(count):
    """Return (V (3, count), q, small) -> u, with derivatives."""
    V, q, small = ca.SX.sym("V", 3, count), ca.SX.sym("q", 3), ca.SX.sym("small")
    u, eps = _iterated(V, q, small)
    u = frozen(u, 2.0**-60)
    slope = frozen(residual_of(V, q, u, eps)[1], 2.0**-40)
    for _ in range(EXACT_STEPS):
        u = u - solve_3(slope, residual_of(V, q, u, eps)[0])
    return ca.Function("towards", [V, q, small], [u])


def _iterated(V, q, small):
    """Return u and eps after the steps that need no derivatives."""
    size = size_of(V, q)
    u = q - ca.sum2(V) / V.shape[1]
    rounding = [size * (small + width) for width in WIDTHS]
    for _ in range(FIRST):
        u = damped_step(V, q, u, rounding[0])
    for before, eps in pairwise(rounding):
        u = predictor_corrector(V, q, u, before, eps)
    for _ in range(LAST):
        u = newton_step(V, q, u, eps)
    return u, eps


def size_of(V, q):
    """Return the distance [m] of q from the middle of the vertices, frozen."""
    return frozen(ca.sqrt(ca.sumsqr(q - ca.sum2(V) / V.shape[1])), 1e-6)


def newton_step(V, q, u, eps):
    """Return u after one Newton step."""
    residual, slope = residual_of(V, q, u, eps)
    return u - solve_3(slope, residual)


def damped_step(V, q, u, eps):
    """Return u after a Newton step that changes log w_j / w_k by a little."""
    residual, slope = residual_of(V, q, u, eps)
    step = solve_3(slope, residual)
    change = V.T @ step / eps
    change = ca.mmax(change) - ca.mmin(change)
    return u - step * ca.fmin(1, LARGEST_CHANGE / (change + 1e-12))


def predictor_corrector(V, q, u, before, eps):
    """Return u at rounding eps from that at `before`: a predictor, a Newton step."""
    residual, slope = residual_of(V, q, u, before)
    height, w = softmax(V, u, before)
    F_eps = -V @ (w * (height - ca.dot(w, height))) / before
    return newton_step(V, q, u - solve_3(slope, residual + (eps - before) * F_eps), eps)


def softmax(V, u, eps):
    """Return V'u / eps and its softmax w (V)."""
    height = V.T @ u / eps
    w = ca.exp(height - frozen(ca.mmax(height), 1.0))
    return height, w / ca.sum1(w)


def residual_of(V, q, u, eps):
    """Return u + V w(u) - q and its slope in u (3, 3)."""
    _, w = softmax(V, u, eps)
    c = V @ w
    slope = ca.DM.eye(3) + (V @ ca.diag(w) @ V.T - c @ c.T) / eps
    return u + c - q, slope
