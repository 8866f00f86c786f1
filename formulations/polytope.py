r"""Convex polytopes: the hull of vertices v_j as a Shape, its volume and inertia.

    distance = |u|,   normal = u / |u|,   u = q - nearest point

(nearest_point.py), right for faces, edges and vertices as long as q is outside: a
sphere of radius rho around q may sink in by nearly rho.  A doubled, coplanar or
interior vertex changes nothing.

Volume, centroid and inertia are sums over the tetrahedra that the hull's triangles
(a, b, c) span with the origin, polynomials of the vertices for a given list of them:

    vol = a . (b x c) / 6            first = vol s / 4,     s = a + b + c
    second = vol (s s' + a a' + b b' + c c') / 20
    Sigma = second / vol             C = Sigma - centroid centroid'
    inertia = trace(C) 1 - C
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from .nearest_point import SHARP, length, towards
from .pushed_hull import as_pushed, legs_squared
from .shape import Shape

LEGS = 4  # vertices at most that carry the body
# Numbers of vertices that are compared: of Platonic solids, and two between
COUNTS = (4, 6, 8, 10, 12, 16, 20)


def _matrix(theta):
    return ca.reshape(theta, 3, theta.numel() // 3)


def polytope_distance(theta, q_of, small):
    """Return the distance [m] from the hull of the point q_of, which is outside."""
    return length(towards(_matrix(theta), q_of, small / SHARP))


def polytope_normal(theta, q_of, small):
    """Return the outward unit normal towards the point q_of outside of the hull."""
    u = towards(_matrix(theta), q_of, small / SHARP)
    return u / length(u)


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


def vertices_of(theta):
    """Return the vertices (V, 3) [m] that theta lists."""
    return ca.reshape(ca.DM(theta), 3, -1).T


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
    Sigma = ca.blockcat([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    C = Sigma - centroid @ centroid.T
    return ca.trace(C) * ca.DM.eye(3) - C


@cache
def polytope(vertices: int | None = None) -> Shape:
    """Return the class of hulls of so many vertices, theta = vertices one by one.

    None: as many of COUNTS as have the largest evidence.
    """
    counts = COUNTS if vertices is None else ()
    vertices = COUNTS[-1] if vertices is None else vertices
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
        quantities=(),
        reach=reach,
        mirrored=False,
        of_vertices=True,
        own_pages=("quasi_static", "violation_implicit"),
        symbol=ca.MX.sym,
        counts=counts,
        foot_squared=legs_squared,
        pushed=as_pushed,
        mesh=vertices_of,
    )
