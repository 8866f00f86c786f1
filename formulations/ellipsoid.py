r"""Ellipsoids: theta = full axes (3,) [m] along x, y, z, origin its centre.

With half axes h = theta / 2, the nearest point p of the surface to q, and t of largest
root of

    sum_i (h_i q_i / (h_i^2 + t))^2 = 1,    p_i = h_i^2 q_i / (h_i^2 + t),
    phi(q) = t || p / h^2 ||,               n = (p / h^2) / || p / h^2 ||.

The root is found by Newton's method on 1 / sqrt(sum) - 1, which is nearly linear in t,
from a lower bound (More and Sorensen, "Computing a trust region step", 1983).

An ellipsoid has no face to lie on: it touches the ground at one point, which moves over
its surface as it rolls (`support`), so that its poses have six unknowns each.
"""

from __future__ import annotations

import casadi as ca

from .shape import (
    Shape,
    axis_relabellings,
    cuboid_corner,
    cuboid_rest_height,
    every_size,
)
from .shape_check import directions

NEWTON_STEPS = 6  # 10 mm outside, to 0.01 um for axes of a ratio up to 1:20
POINTS = 642  # of the mesh: facets cut off 1 % of the volume


def _nearest(theta, q_of, small):
    """Return t [m^2] and p / h^2 (3,) [1/m] of the nearest point of the surface."""
    square = (theta / 2) ** 2
    q = ca.sqrt(q_of * q_of + (small / 100) ** 2)
    weighted = square * q * q
    t = ca.mmax(ca.sqrt(square) * q - square)
    for _ in range(NEWTON_STEPS):
        below = square + t
        total = ca.sum1(weighted / below**2)
        slope = -2 * ca.sum1(weighted / below**3)
        t = t + 2 * total * (1 - ca.sqrt(total)) / slope
    return t, q_of / (square + t)


def ellipsoid_distance(theta, q_of, small):
    """Return the signed distance [m] of the point q_of from the ellipsoid."""
    t, outward = _nearest(theta, q_of, small)
    return t * ca.sqrt(ca.sumsqr(outward) + 1e-12)


def ellipsoid_normal(theta, q_of, small):
    """Return the outward unit normal at the nearest point."""
    _, outward = _nearest(theta, q_of, small)
    return outward / ca.norm_2(outward)


def ellipsoid_support(theta, n):
    """Return the point (3,) [m] of the surface with the outward unit normal n."""
    square = (theta / 2) ** 2
    return square * n / ca.sqrt(ca.sum1(square * n * n))


def ellipsoid_inertia(theta):
    """Return the inertia per unit mass of a uniform ellipsoid [m^2]."""
    square = theta * theta
    return ca.diag(ca.sum1(square) - square) / 20


def ellipsoid_reach(theta):
    """Return half the longest axis, a number [m]."""
    return float(ca.mmax(ca.DM(theta))) / 2


def ellipsoid_mesh(theta):
    """Return POINTS evenly spread unit vectors, each times the half axes (3,) [m]."""
    return (ca.diag(ca.DM(theta) / 2) @ directions(POINTS)).T


ELLIPSOID = Shape(
    name="ellipsoid",
    theta=3,
    bounds=(4e-3, 0.4),
    size_prior=(0.045, 0.020),
    corners=((0, 0, -1),),
    distance=ellipsoid_distance,
    normal=ellipsoid_normal,
    corner=cuboid_corner,
    rest_height=cuboid_rest_height,
    inertia=ellipsoid_inertia,
    symmetries=axis_relabellings(),
    words=("axis x", "axis y", "axis z"),
    units=("m", "m", "m"),
    quantities=(("axes", every_size),),
    reach=ellipsoid_reach,
    mirrored=False,
    support=ellipsoid_support,
    mesh=ellipsoid_mesh,
)
"""The class of ellipsoids, theta = full axes (3,) [m], lying on the end of the z axis.

The prior of each is Student's t about 45 mm (size_prior.py).
"""
