r"""Upright cylinders and regular prisms: a cross-section swept along the body's z axis.

theta = (across, height) [m]: the diameter of the circle inscribed in the cross-section,
and the length along z; the origin is the centroid.  The cylinder is the limit of the
prism for many sides, so the sizes of all these classes mean the same, and so do their
priors: Student's t about 45 mm for each (size_prior.py).

With a = across / 2, e = a tan(pi / n) half a side, and (u, v) the horizontal point in
the axes of the nearest side (normal, along):

    prism       du = u - a,             dv = |v| - e,   dz = |z| - height / 2
    cylinder    du = |(x, y)| - a,      no dv
    phi      = || max((du, dv, dz), 0) || + min(max(du, dz), 0)        (exact outside)

rounded as the cuboid's in shape.py.  A side's normal is the x axis of the body.
"""

from __future__ import annotations

from functools import cache, partial
from math import cos, pi, sin, tan

import casadi as ca

from .shape import (
    Shape,
    faces_inward,
    gradient_normal,
    half_diagonal,
    positive_part,
)

RIM = 8  # points of a cylinder's rim on which it may rest: tilted by 10 degrees, the
# lowest one is 0.3 mm above a rim of 50 mm at most
RIM_POINTS = 96  # points of each rim of a cylinder's mesh: 0.07 % less volume


def swept_distance(du, dv, dz, small):
    """Return the signed distance [m] of a point beyond the faces by du, dv, dz [m].

    dv: beyond the end of the nearest side; it counts outside only.  None: no sides.
    """
    width = small / 5
    beyond = [positive_part(d, width) for d in (du, dv, dz) if d is not None]
    outside = ca.norm_2(ca.vertcat(*beyond))
    larger = ca.fmax(du, dz)
    both = larger + small * ca.log1p(ca.exp(-ca.fabs(du - dz) / small))
    return outside - positive_part(-both, width)


def _rounded(square, small):
    return ca.sqrt(square + (small / 10) ** 2)


def cylinder_distance(theta, q_of, small):
    """Return the signed distance [m] of the point q_of from the cylinder."""
    du = _rounded(q_of[0] ** 2 + q_of[1] ** 2, small) - theta[0] / 2
    return swept_distance(du, None, _rounded(q_of[2] ** 2, small) - theta[1] / 2, small)


def prism_distance(sides, theta, q_of, small):
    """Return the signed distance [m] of the point q_of from the prism."""
    turn = 2 * pi / sides
    facing = turn * ca.floor(ca.atan2(q_of[1], q_of[0]) / turn + 0.5)
    c, s = ca.cos(facing), ca.sin(facing)
    u, v = c * q_of[0] + s * q_of[1], c * q_of[1] - s * q_of[0]
    a = theta[0] / 2
    dv = _rounded(v * v, small) - a * tan(turn / 2)
    return swept_distance(
        u - a, dv, _rounded(q_of[2] ** 2, small) - theta[1] / 2, small
    )


def rim_point(stretch, theta, signs):
    """Return the point of a rim in the direction of `signs`, body frame [m]."""
    out = stretch * theta[0] / 2
    return ca.vertcat(out * signs[0], out * signs[1], signs[2] * theta[1] / 2)


def half_height(theta):
    """Return the height of the origin over the ground [m]."""
    return theta[1] / 2


def swept_inertia(second, theta):
    """Return the inertia per unit mass [m^2]; second: of the section / across^2."""
    level, upright = second * theta[0] ** 2, theta[1] ** 2 / 12
    return ca.diag(ca.vertcat(level + upright, level + upright, 2 * level))


def swept_reach(stretch, theta):
    """Return the distance of a corner from the origin, a number [m]."""
    across, height = (float(t) for t in ca.vertsplit(ca.DM(theta)))
    return half_diagonal([stretch * across, height])


def swept_mesh(points, stretch, first, theta):
    """Return the corners (2 points, 3) [m]: a rim of so many points, twice."""
    across, height = (float(t) for t in ca.vertsplit(ca.DM(theta)))
    angles = [first + 2 * pi * i / points for i in range(points)]
    r = stretch * across / 2
    return [
        (r * cos(a), r * sin(a), z) for z in (-height / 2, height / 2) for a in angles
    ]


def _swept(name, corners, distance, second, stretch, points, first, words, **more):
    """Return a Shape; stretch: of a corner's distance from the axis, in across / 2."""
    at = tuple(
        (cos(first + 2 * pi * i / corners), sin(first + 2 * pi * i / corners), -1.0)
        for i in range(corners)
    )
    return Shape(
        name=name,
        theta=2,
        bounds=(4e-3, 0.4),
        size_prior=(0.045, 0.020),
        corners=at,
        distance=distance,
        normal=gradient_normal(distance),
        corner=partial(rim_point, stretch),
        rest_height=half_height,
        inertia=partial(swept_inertia, second),
        words=words,
        units=("m", "m"),
        reach=partial(swept_reach, stretch),
        mirrored=corners % 2 == 0,
        mesh=partial(swept_mesh, points, stretch, first),
        rounded=faces_inward,
        **more,
    )


@cache
def prism(sides: int) -> Shape:
    """Return the class of upright regular prisms with so many sides, at least three.

    theta = (across, height) [m]; across: twice the distance of a side from the axis,
    which for an even number is the distance of opposite sides.  The prior of both is
    Student's t about 45 mm (size_prior.py).  ValueError for less than three sides.
    """
    if int(sides) != sides or sides < 3:
        raise ValueError(f"sides: expected a whole number of at least 3, got {sides}")
    turn = 2 * pi / sides
    stretch = 1 / cos(turn / 2)
    second = stretch**2 * (2 + cos(turn)) / 48  # R^2 (2 + cos) / 12 with R = a / cos
    level = [(i * turn, False) for i in range(sides)]
    over = [(i * turn, True) for i in range(sides)]
    return _swept(
        f"prism of {sides} sides", sides, partial(prism_distance, sides), second,
        stretch, sides, turn / 2, ("across flats", "height"),
        symmetries=tuple(((0, 1), _turned(*s)) for s in level + over),
    )  # fmt: skip


def _turned(angle, over):
    """Return the rotation about z, then, if `over`, half a turn about x, as rows."""
    c, s, k = cos(angle), sin(angle), -1.0 if over else 1.0
    return ((c, -k * s, 0.0), (s, k * c, 0.0), (0.0, 0.0, k))


CYLINDER = _swept(
    "cylinder", RIM, cylinder_distance, 1 / 16, 1.0, RIM_POINTS, pi / RIM,
    ("diameter", "height"), round=True,
    symmetries=(((0, 1), _turned(0.0, False)), ((0, 1), _turned(0.0, True))),
)  # fmt: skip
"""The class of upright cylinders, theta = (diameter, height) [m].

The prior of both is Student's t about 45 mm (size_prior.py).
"""
