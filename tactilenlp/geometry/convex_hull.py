"""Convex hulls: half-space intersection, untouched side, centroid, closest point.

A half-space is a row (n, b) of the plane n . q = b, n (3,) outward unit, b [m]; the
body lies where n . q <= b.  Lengths in [m], body frame, the ground at z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from ..errors import TactileError
from .transforms import planar_matrix, points_in_body

BALL_PLANES = 60  # half-spaces that approximate the ball
MERGE_DISTANCE = 1e-3  # [m] vertices closer than this are merged
LEAST_INRADIUS = 1e-4  # [m] of the largest ball in a body; thinner ones are errors
# [radii] deviations of a contact point from the ball
SIGMA_INSIDE, SIGMA_OUTSIDE = 0.3, 0.06
INDEPENDENT_TOUCHES = 30  # touches counted as independent, at most
# Mean and deviation [radii] of the height of the ball's centre: over the ground, and
# over the plane of touch of a body that floats.
CENTRE_HEIGHT = 0.7, 0.25
FLOATING_HEIGHT = 0.0, 0.5
EXTENTS = 16  # directions, over half a turn, in which a body's extents are compared
ENLARGED = 2.0**10  # [1] trimesh's tolerances are absolute: too wide for small faces
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True, eq=False)
class Ball:
    """The prior shape of a body where it was not touched: centre (3,), radius, [m]."""

    centre: np.ndarray
    radius: float

    def caps(self, points) -> np.ndarray:
        """Return half-spaces (BALL_PLANES, 4) tangent to the ball, evenly distributed.

        Their heading is that of the farthest of the points (n, 3), so that the result
        does not depend on the world's axes.
        """
        away = (points - self.centre)[:, :2]
        x, y = away[np.argmax(np.linalg.norm(away, axis=1))]
        turn = np.arctan2(y, x)
        n = directions(BALL_PLANES) @ planar_matrix(-turn)
        return np.c_[n, n @ self.centre + self.radius]


def directions(count: int) -> np.ndarray:
    """Return unit vectors (count, 3) evenly distributed (Fibonacci sphere)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    r, phi = np.sqrt(1 - z * z), GOLDEN_ANGLE * np.arange(count)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def vertices_behind(halfspaces) -> np.ndarray:
    """Return the vertices (V, 3) [m] of the intersection of half-spaces (n, 4).

    It is expanded from its Chebyshev centre, that of the largest ball in it.  Raises
    TactileError if it is empty or thinner than LEAST_INRADIUS.
    """
    A = np.c_[halfspaces[:, :3], np.ones(len(halfspaces))]
    bounds = [(None, None)] * 3 + [(None, 1.0)]
    ball = linprog([0, 0, 0, -1], A, halfspaces[:, 3], bounds=bounds, method="highs")
    depth = ball.x[3] if ball.success else -np.inf
    if depth < LEAST_INRADIUS:
        raise TactileError(
            "the intersection of the half-spaces is empty or flat",
            where="halfspaces",
            got=f"inradius {depth:.2g} m",
            expected=f"at least {LEAST_INRADIUS:g} m",
        )
    rows = np.c_[halfspaces[:, :3], -halfspaces[:, 3]]
    points = HalfspaceIntersection(rows, ball.x[:3]).intersections
    return points[np.isfinite(points).all(axis=1)]


def hull_vertices(points) -> np.ndarray:
    """Return the points (V, 3) that are vertices of their hull."""
    return points[ConvexHull(points).vertices]


def merge_points(points) -> np.ndarray:
    """Return the points (n, 3) with clusters within MERGE_DISTANCE averaged."""
    points, out = list(points), []
    while points:
        near = [np.linalg.norm(p - points[0]) < MERGE_DISTANCE for p in points]
        out.append(np.mean([p for p, n in zip(points, near, strict=True) if n], axis=0))
        points = [p for p, n in zip(points, near, strict=True) if not n]
    return np.array(out)


def volume(points) -> float:
    """Return the volume [m^3] of a hull, 0 of points in a plane."""
    try:
        return ConvexHull(points).volume
    except (QhullError, ValueError):  # the latter of none
        return 0.0


def triangles(points, count: int) -> np.ndarray:
    """Return the outward triangles (count, 3) of a hull as indices; 0, 0, 0 pads."""
    hull = ConvexHull(points)
    tri = hull.simplices.copy()
    a, b, c = points[tri[:, 0]], points[tri[:, 1]], points[tri[:, 2]]
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    tri[inward] = tri[inward][:, ::-1]
    return np.pad(tri, ((0, count - len(tri)), (0, 0)))


def centroid(points) -> np.ndarray:
    """Return the centroid (3,) [m] of the volume of the hull of points (n, 3) [m]."""
    middle = points.mean(axis=0)
    fans = points[ConvexHull(points).simplices] - middle
    volumes = np.abs(np.linalg.det(fans))
    return middle + volumes @ fans.mean(axis=1) * 0.75 / volumes.sum()


def unseen_ball(points, size, ground) -> Ball:
    """Return the ball that stands for the untouched side, fitted to contact points.

    By least squares; points (n, 3) [m]; size: prior mean and standard deviation [m] of
    its radius; ground: whether there is one.  Contact points lie in the middle of faces
    more often than at corners, hence more often inside: SIGMA_INSIDE, SIGMA_OUTSIDE.
    """
    mean, deviation = size
    height = CENTRE_HEIGHT if ground else FLOATING_HEIGHT
    often = np.sqrt(max(1.0, len(points) / INDEPENDENT_TOUCHES))

    def residual(z):
        away = np.linalg.norm(points - z[:3], axis=1) / z[3] - 1
        away = np.where(away > 0, away / SIGMA_OUTSIDE, away / SIGMA_INSIDE) / often
        above = (z[2] / z[3] - height[0]) / height[1]
        return np.r_[away, above, (z[3] - mean) / deviation]

    ball = least_squares(residual, np.r_[points.mean(axis=0), mean]).x
    return Ball(ball[:3], float(abs(ball[3])))


def departure(vertices, centres, radius) -> np.ndarray:
    """Return how far fingers (n,) are from touching a hull [m]: negative within it.

    centres (n, 3), radius (n,) [m].
    """
    planes = ConvexHull(vertices).equations
    away = (centres @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    out = away > 0
    if out.any():
        nearest = nearest_points(vertices, centres[out])
        away[out] = np.linalg.norm(centres[out] - nearest, axis=1)
    return away - radius


def fingers_in_body(samples, x) -> np.ndarray:
    """Return the fingers' centres (samples, 3) [m] in the body frame."""
    return points_in_body(x, samples.sample, samples.p_wf)


def nearest_points(vertices, points) -> np.ndarray:
    """Return the points (n, 3) [m] of a hull closest to given points (n, 3) outside."""
    return nearest_triangles(vertices, points)[0]


def nearest_triangles(vertices, points) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, 3) [m] of a hull closest to given points outside.

    Also return the indices (n, 3) of the vertices of the triangle on which each lies.
    """
    import trimesh

    simplices, n = ConvexHull(vertices).simplices, len(points)
    triangles = np.repeat(ENLARGED * vertices[simplices], n, axis=0)
    every = np.tile(ENLARGED * points, (len(simplices), 1))
    closest = trimesh.triangles.closest_point(triangles, every) / ENLARGED
    closest = closest.reshape(len(simplices), n, 3)
    best = np.linalg.norm(closest - points, axis=2).argmin(axis=0)
    return closest[best, np.arange(n)], simplices[best]


def hausdorff_distance(a, b) -> float:
    """Return how far two hulls, each by points on its surface (n, 3), are apart [m]."""
    ways = (nearest_points(b, a) - a, nearest_points(a, b) - b)
    return max(float(np.linalg.norm(way, axis=1).max()) for way in ways)


def nearest_in_hull(points, centre) -> np.ndarray:
    """Return the points of the hull of `points` nearest to each centre (n, 3)."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[-1] < 1e-4:
        apart = np.linalg.norm(points[None] - centre[:, None], axis=2)
        return points[np.argmin(apart, axis=1)]
    return nearest_points(hull_vertices(points), centre)


def unseen_halfspaces(points, ball: Ball, ground) -> np.ndarray:
    """Return half-spaces (n, 4) of the untouched side: a ball, and the ground if any.

    points (k, 3) [m]: where the body was touched.
    """
    caps = ball.caps(points)
    return np.vstack([[[0, 0, -1, 0]], caps]) if ground else caps


def centre_of_shape(planes, points, size, ground) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (2,) [m] and covariance (2, 2) [m^2] of a body's centroid, in plan.

    planes (n, 4): half-spaces that hold it; points (k, 3) [m]: where it was touched;
    size, ground: as of `unseen_ball`.  Its surface lies anywhere between the hull of
    the points and that of planes, ground and ball: in each of EXTENTS directions the
    middle of the body is that of two uniform densities.  Their average is exact for the
    mean, and wider than least squares for the covariance.
    """
    unseen = unseen_halfspaces(points, unseen_ball(points, size, ground), ground)
    outer = vertices_behind(np.vstack([planes, unseen]))
    angle = np.pi * np.arange(EXTENTS) / EXTENTS
    u = np.stack([np.cos(angle), np.sin(angle)])
    (high, low), (high_1, low_1) = (
        ((V[:, :2] @ u).max(axis=0), (V[:, :2] @ u).min(axis=0))
        for V in (outer, points)
    )
    moved = (high_1 + low_1 - high - low) / 4  # the middle, from that of the outer one
    variance = ((high - high_1) ** 2 + (low_1 - low) ** 2) / 12 / 4
    covariance = 2 / EXTENTS * (u * variance) @ u.T
    return centroid(outer)[:2] + 2 / EXTENTS * u @ moved, covariance
