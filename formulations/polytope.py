r"""Convex polytopes: the point of a hull nearest to a finger, its volume and inertia.

A polytope is the convex hull of vertices v_j.  The point c of it nearest to q is

    c = sum w_j v_j,    w = argmin |q - sum w_j v_j|^2 / 2 + eps sum w_j log w_j

over the simplex; the entropy keeps every weight positive, so that c is smooth where the
nearest feature changes from face to edge to vertex.  With u = q - c its dual is a
concave problem of three unknowns,

    max_u  u . q - |u|^2 / 2 - eps log sum exp(u . v_j / eps),   w = softmax(V'u / eps),

solved by Newton's method while eps falls, a step along du/deps before each: without
it steps overshoot on large faces and run away.  eps = small |q - middle|: the hull is
rounded over lengths of `small`.  The distance is |u|, the outward normal u / |u|, right
for faces, edges and vertices as long as q is outside: a sphere of radius rho around q
may sink in by nearly rho.  A doubled, coplanar or interior vertex changes nothing.

Newton's steps from a frozen u give one more exact derivative each (finger.py).

Volume, centroid and inertia are sums over the tetrahedra that the hull's triangles span
with the origin: polynomials of the vertices for a given list of triangles.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import casadi as ca

from .finger import frozen
from .shape import Shape

WIDTHS = (*(10e-3 * 2.0**-k for k in range(10)), 0.0)  # [m] added to small, in turn
SHARP = 30  # lengths of rounding in `small`, a tenth of the finger: 0.03 mm
FIRST = 4  # Newton steps while the hull is most round
FAR = 5.0  # [-] by which these change log w_j - log w_k at most
LAST = 3  # Newton steps where the hull is sharp, before freezing
TINY = 1e-6  # [m] a distance is not exactly zero, so that it has derivatives
LEGS = 4  # vertices at most that carry the body
EXACT = 2  # Newton steps after freezing: as many exact derivatives


def towards(vertices, q_of, small):
    """Return u (3,) [m] from the nearest point of the hull of vertices (3, k) to q_of.

    small: length [m] over which edges and corners are rounded.
    """
    return _towards(vertices.shape[1])(vertices, q_of, small)


@cache
def _towards(count):
    """Return (vertices (3, count), q_of, small) -> u, written out once a process."""
    V, q, small = ca.SX.sym("V", 3, count), ca.SX.sym("q", 3), ca.SX.sym("small")
    return ca.Function("towards", [V, q, small], [_written_out(V, q, small)])


def _written_out(vertices, q_of, small):
    origin = vertices[:, 0]
    V, q = vertices - origin, q_of - origin
    size = ca.sqrt(ca.sumsqr(q_of - ca.sum2(vertices) / vertices.shape[1]))
    size = frozen(size, 1e-6)
    u = q - ca.sum2(V) / V.shape[1]
    rounding = [size * (small + width) for width in WIDTHS]
    for _ in range(FIRST):
        u = _begun(V, q, u, rounding[0])
    for before, eps in pairwise(rounding):
        u = _followed(V, q, u, before, eps)
    for _ in range(LAST):
        u = _newton(V, q, u, eps)
    u = frozen(u, 2.0**-60)
    slope = frozen(_residual(V, q, u, eps)[1], 2.0**-40)
    for _ in range(EXACT):
        u = u - _solve(slope, _residual(V, q, u, eps)[0])
    return u


def _newton(V, q, u, eps):
    """Return u after one of Newton's steps."""
    residual, slope = _residual(V, q, u, eps)
    return u - _solve(slope, residual)


def _begun(V, q, u, eps):
    """Return u after a step from afar, which log w_j / w_k changes by FAR at most."""
    residual, slope = _residual(V, q, u, eps)
    step = _solve(slope, residual)
    change = V.T @ step / eps
    change = ca.mmax(change) - ca.mmin(change)
    return u - step * ca.fmin(1, FAR / (change + 1e-12))


def _followed(V, q, u, before, eps):
    """Return u once the rounding fell to eps: a step along du/deps, and Newton's."""
    residual, slope = _residual(V, q, u, before)
    height, w = _weights(V, u, before)
    bend = -V @ (w * (height - ca.dot(w, height))) / before
    return _newton(V, q, u - _solve(slope, residual + (eps - before) * bend), eps)


def _weights(V, u, eps):
    """Return V'u / eps and its softmax w (V)."""
    height = V.T @ u / eps
    w = ca.exp(height - frozen(ca.mmax(height), 1.0))
    return height, w / ca.sum1(w)


def _residual(V, q, u, eps):
    """Return u + V w(u) - q and its slope in u (3, 3)."""
    _, w = _weights(V, u, eps)
    c = V @ w
    slope = ca.DM.eye(3) + (V @ ca.diag(w) @ V.T - c @ c.T) / eps
    return u + c - q, slope


def _solve(A, b):
    """Return A^-1 b for a symmetric positive (3, 3) matrix, by cofactors."""
    a, d, e = A[:, 0], A[:, 1], A[:, 2]
    cofactors = ca.horzcat(ca.cross(d, e), ca.cross(e, a), ca.cross(a, d))
    return cofactors.T @ b / ca.dot(a, cofactors[:, 0])


def _matrix(theta):
    return ca.reshape(theta, 3, theta.numel() // 3)


def polytope_distance(theta, q_of, small):
    """Return the distance [m] from the hull of the point q_of, which is outside."""
    return ca.sqrt(ca.sumsqr(towards(_matrix(theta), q_of, small / SHARP)) + TINY**2)


def polytope_normal(theta, q_of, small):
    """Return the outward unit normal towards the point q_of outside of the hull."""
    u = towards(_matrix(theta), q_of, small / SHARP)
    return u / ca.sqrt(ca.sumsqr(u) + TINY**2)


def vertex(theta, signs):
    """Return the vertex that a term over ground contacts reads, body frame [m]."""
    return theta


def on_the_ground(theta):
    """Return the height of the origin, which is on the ground below the body [m]."""
    return 0.0


def reach(theta):
    """Return how far the farthest vertex is from the origin, a number [m]."""
    V = ca.reshape(ca.DM(theta), 3, -1)
    return float(ca.sqrt(ca.mmax(ca.sum1(V * V))))


def moments(triangle):
    """Return volume, its first and second moments about the origin, of a tetrahedron.

    triangle (9,): its three outer vertices, the fourth is the origin, counterclockwise
    from outside.  Returns (1 + 3 + 6,) [m^3, m^4, m^5], second moments xx yy zz xy yz
    zx.
    """
    a, b, c = triangle[:3], triangle[3:6], triangle[6:9]
    volume = ca.dot(a, ca.cross(b, c)) / 6
    s = a + b + c
    S = volume / 20 * (s @ s.T + a @ a.T + b @ b.T + c @ c.T)
    second = ca.vertcat(S[0, 0], S[1, 1], S[2, 2], S[0, 1], S[1, 2], S[2, 0])
    return ca.vertcat(volume, volume * s / 4, second)


def whole_moments(theta):
    """Return the moments of a hull, the sum over its triangles (9 k,)."""
    return sum(moments(theta[9 * i : 9 * i + 9]) for i in range(theta.numel() // 9))


def inertia_about(centroid, second):
    """Return the inertia (3, 3) [m^2] per unit mass about the centroid (3,) [m].

    second (6,) [m^2]: second moments per volume about the origin.
    """
    xx, yy, zz, xy, yz, zx = (second[i] for i in range(6))
    S = ca.blockcat([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]) - centroid @ centroid.T
    return ca.trace(S) * ca.DM.eye(3) - S


@cache
def polytope(vertices: int = 20) -> Shape:
    """Return the class of hulls of so many vertices, theta = vertices one by one."""
    return Shape(
        name="polytope",
        theta=3 * vertices,
        bounds=(-0.4, 0.4),
        size_prior=(0.022, 0.008),
        corners=tuple((slot, 0, 0) for slot in range(LEGS)),
        distance=polytope_distance,
        normal=polytope_normal,
        corner=vertex,
        rest_height=on_the_ground,
        inertia=None,
        reach=reach,
        mirrored=False,
        parameters="vertices",
        last_pose_held=True,
        window_depends_on_start=True,
        hypotheses=1,
        own_pages=("quasi_static", "violation_implicit"),
        symbol=ca.MX.sym,
    )
