"""Cut a convex body out of half-spaces; bring it to a number of vertices.

A half-space is a row (n, b) of the plane n . q = b, n (3,) outward unit, b [m]; the
body lies behind it.  Lengths in [m], the body's frame, the ground at z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from ..errors import TactileError
from .transforms import points_in_body

CAPS = 60  # planes that stand for the ball of what was never touched
MERGED = 1e-3  # [m] vertices nearer than this are one
LEAST = 1e-4  # [m] a body is at least this thick
INSIDE, OUTSIDE = 0.3, 0.06  # [radii] deviations of a contact point from the ball
INDEPENDENT = 30  # touches at most that say something new of the ball
HEIGHT = (0.7, 0.25)  # [radii] mean and deviation of the ball's centre over the ground
AFLOAT = (0.0, 0.5)  # [radii] and over the plane of touch of a body that floats
GOLDEN = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True, eq=False)
class Ball:
    """The ball that a body is thought to fill where nothing was felt: (3,), [m]."""

    centre: np.ndarray
    radius: float

    def caps(self, points, count: int = CAPS) -> np.ndarray:
        """Return half-spaces (count, 4) that touch the ball, spread evenly.

        They are turned towards the farthest of the points (n, 3), so that they turn
        with the body and not with the world's axes.
        """
        away = (points - self.centre)[:, :2]
        x, y = away[np.argmax(np.linalg.norm(away, axis=1))]
        turn = np.arctan2(y, x)
        c, s = np.cos(turn), np.sin(turn)
        n = directions(count) @ [[c, s, 0], [-s, c, 0], [0, 0, 1]]
        return np.c_[n, n @ self.centre + self.radius]


def directions(count: int) -> np.ndarray:
    """Return unit vectors (count, 3) spread evenly over the sphere (Fibonacci)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    r, phi = np.sqrt(1 - z * z), GOLDEN * np.arange(count)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def deepest(halfspaces) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius of the largest ball behind all half-spaces."""
    A = np.c_[halfspaces[:, :3], np.ones(len(halfspaces))]
    bounds = [(None, None)] * 3 + [(None, 1.0)]
    found = linprog([0, 0, 0, -1], A, halfspaces[:, 3], bounds=bounds, method="highs")
    if not found.success:
        return np.zeros(3), -np.inf
    return found.x[:3], float(found.x[3])


def corners(halfspaces) -> np.ndarray:
    """Return the vertices (V, 3) of an intersection; TactileError if it is empty."""
    inside, depth = deepest(halfspaces)
    if depth < LEAST:
        raise TactileError(
            "the half-spaces leave no body", where="corners", got=f"{depth:.2g} m deep"
        )
    rows = np.c_[halfspaces[:, :3], -halfspaces[:, 3]]
    points = HalfspaceIntersection(rows, inside).intersections
    return points[np.isfinite(points).all(axis=1)]


def outer(points) -> np.ndarray:
    """Return the points (V, 3) that are vertices of their hull."""
    return points[ConvexHull(points).vertices]


def merged(points, distance: float = MERGED) -> np.ndarray:
    """Return the points with clusters nearer than `distance` made one, their mean."""
    points, out = list(points), []
    while points:
        near = [np.linalg.norm(p - points[0]) < distance for p in points]
        out.append(np.mean([p for p, n in zip(points, near, strict=True) if n], axis=0))
        points = [p for p, n in zip(points, near, strict=True) if not n]
    return np.array(out)


def thinned(points, count: int) -> np.ndarray:
    """Return `count` of the vertices at most: those whose removal costs volume stay.

    A removal changes what its neighbours are worth, and no others.
    """
    points = outer(points)
    if len(points) <= count:
        return points
    neighbours = _neighbours(points)
    loss = {i: _loss(points, i, neighbours[i]) for i in neighbours}
    while len(loss) > count:
        gone = min(loss, key=loss.get)
        del loss[gone]
        ring = sorted(neighbours.pop(gone))
        joined = _neighbours(points[ring], ring)
        for i in ring:
            neighbours[i] = (neighbours[i] - {gone}) | joined[i]
        for i in ring:
            loss[i] = _loss(points, i, neighbours[i])
    return points[sorted(loss)]


def _neighbours(points, names=None) -> dict[int, set]:
    """Return the vertices that share an edge with each vertex, by name."""
    names = range(len(points)) if names is None else names
    found = {i: set() for i in names}
    if len(points) < 4:
        return {i: set(names) - {i} for i in names}
    try:
        simplices = ConvexHull(points).simplices
    except QhullError:  # a flat ring: all are neighbours
        return {i: set(names) - {i} for i in names}
    for simplex in np.array(list(names))[simplices].tolist():
        for i in simplex:
            found[i] |= set(simplex) - {i}
    return found


def _loss(points, i: int, ring) -> float:
    """Return the volume [m^3] that vertex i adds to the hull of its neighbours."""
    near = points[sorted(ring)]
    try:
        without = ConvexHull(near).volume if len(near) > 3 else 0.0
    except QhullError:
        without = 0.0
    try:
        return ConvexHull(np.vstack([near, points[i]])).volume - without
    except QhullError:
        return 0.0


def filled(points, count: int) -> np.ndarray:
    """Return exactly `count` vertices: what is missing is put on the longest edges.

    A point on an edge leaves the hull as it is and can move off it.
    """
    points = np.array(points)
    while len(points) < count:
        triangles = ConvexHull(points).simplices
        edges = np.vstack(
            [triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]
        )
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        longest = edges[int(np.argmax(length))]
        points = np.vstack([points, points[longest].mean(axis=0)])
    return points


def triangles(points, count: int) -> np.ndarray:
    """Return the outward triangles (count, 3) of a hull as indices; 0, 0, 0 pads."""
    hull = ConvexHull(points)
    tri = hull.simplices.copy()
    a, b, c = points[tri[:, 0]], points[tri[:, 1]], points[tri[:, 2]]
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    tri[inward] = tri[inward][:, ::-1]
    out = np.zeros((count, 3), int)
    out[: len(tri)] = tri[:count]
    return out


def centroid(points) -> np.ndarray:
    """Return the centroid (3,) [m] of the volume of a hull."""
    middle = points.mean(axis=0)
    fans = points[ConvexHull(points).simplices] - middle
    volumes = np.abs(np.linalg.det(fans))
    return middle + volumes @ fans.mean(axis=1) * 0.75 / volumes.sum()


def fitted_ball(points, size, height=HEIGHT) -> Ball:
    """Return the ball on the ground near whose surface the points (n, 3) lie.

    size: mean and deviation [m] of its radius before any touch; height: those [radii]
    of its centre over z = 0.  Contact points are in the middle of faces more often than
    at corners: INSIDE the ball, not OUTSIDE.
    """
    mean, deviation = size
    often = np.sqrt(max(1.0, len(points) / INDEPENDENT))

    def residual(z):
        away = np.linalg.norm(points - z[:3], axis=1) / z[3] - 1
        away = np.where(away > 0, away / OUTSIDE, away / INSIDE) / often
        above = (z[2] / z[3] - height[0]) / height[1]
        return np.r_[away, above, (z[3] - mean) / deviation]

    found = least_squares(residual, np.r_[points.mean(axis=0), mean])
    return Ball(found.x[:3], float(abs(found.x[3])))


def fingers(samples, x) -> np.ndarray:
    """Return the fingers' centres (samples, 3) [m] in the body frame."""
    return points_in_body(x, samples.sample, samples.p_wf)


def nearest(vertices, points) -> np.ndarray:
    """Return the points (n, 3) of a hull that are nearest to given ones outside."""
    return nearest_triangles(vertices, points)[0]


def nearest_triangles(vertices, points) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, 3) of a hull nearest to given ones outside.

    And the vertices (n, 3) of the triangle on which each lies.
    """
    import trimesh

    simplices, n = ConvexHull(vertices).simplices, len(points)
    found = trimesh.triangles.closest_point(
        np.repeat(vertices[simplices], n, axis=0), np.tile(points, (len(simplices), 1))
    ).reshape(len(simplices), n, 3)
    best = np.linalg.norm(found - points, axis=2).argmin(axis=0)
    return found[best, np.arange(n)], simplices[best]
