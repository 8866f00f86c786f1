"""Simplify convex hulls: fewer vertices, fewer faces, more vertices of the same hull.

Lengths in [m], body frame.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from .convex_hull import (
    centroid,
    hull_vertices,
    merge_points,
    nearest_points,
    nearest_triangles,
    volume,
)

AT_ONCE = 600  # [1] vertices of a hull above which a tenth of those beyond goes at once
FARTHEST_CORNER = 1.0  # [m] from a centroid: planes that meet beyond close no body
CORNER, MOST_OF_TOUCH = 0.5e-3, 8.0  # [m], [nats] of a touch that a vertex explains


def fewer_vertices(points, count: int) -> np.ndarray:
    """Return at most `count` of the vertices, removing those that add least volume.

    Greedy: after a removal only the losses of its neighbours are computed again.  Of
    more than AT_ONCE vertices, a tenth of those beyond is removed at once.
    """
    points = hull_vertices(points)
    left, loss = np.arange(len(points)), np.zeros(len(points))
    changed = left
    while len(left) > count:
        simplices = left[ConvexHull(points[left]).simplices]
        for i in changed:
            ring = _neighbours(simplices, i)
            loss[i] = volume(points[[*ring, i]]) - volume(points[ring])
        at_once = max(1, (len(left) - AT_ONCE) // 10)
        gone = left[np.argsort(loss[left], kind="stable")[:at_once]]
        left, changed = np.setdiff1d(left, gone), _neighbours(simplices, gone)
    return points[left]


def _neighbours(simplices, some) -> np.ndarray:
    """Return the vertices that share an edge with some vertices, one or several."""
    return np.setdiff1d(simplices[np.isin(simplices, some).any(axis=1)], some)


def more_vertices(points, count: int) -> np.ndarray:
    """Return exactly `count` vertices, adding the midpoint of the longest edge.

    A midpoint does not change the hull, so that it may be added more than once; an
    optimiser can move each off the edge.  Halves of edges that were distinct instead
    gave no better objectives (two hulls: 1.2 nats less, 0.7 more).
    """
    points = np.array(points)
    while len(points) < count:
        triangles = ConvexHull(points).simplices
        pairs = [0, 1], [1, 2], [2, 0]
        edges = np.vstack([triangles[:, pair] for pair in pairs])
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        longest = edges[int(np.argmax(length))]
        points = np.vstack([points, points[longest].mean(axis=0)])
    return points


def with_counts(corners, counts) -> list[np.ndarray]:
    """Return the hull of corners (n, 3) as so many vertices each; counts: descending.

    Vertices that add least volume go one after another, so that a hull of fewer is
    made of the one before.  No count is taken that a smaller one has room for.
    """
    enough = min((count for count in counts if count >= len(corners)), default=np.inf)
    hulls = []
    for count in (count for count in counts if count <= enough):
        corners = fewer_vertices(corners, count)
        hulls.append(more_vertices(corners, count))
    return hulls


def with_fewer_faces(points, counts) -> list[np.ndarray]:
    """Return the vertices of a hull with at most so many faces each.

    counts: descending.  Faces are vertices of the polar body about the centroid, of
    which those that add least volume go one after another: their neighbours grow
    together.  None follow after faces that close no body.
    """
    centre = centroid(points)
    faces, bodies = polar(points - centre), []
    for count in counts:
        faces = fewer_vertices(faces, count)
        if not holds_origin(faces):
            break
        bodies.append(hull_vertices(merge_points(polar(faces))) + centre)
    return bodies


def holds_origin(points) -> bool:
    """Tell whether the hull of points (n, 3) [1/m] holds the origin, off its facets.

    Its facets are corners of the polar body, none beyond FARTHEST_CORNER.
    """
    try:
        return bool(ConvexHull(points).equations[:, 3].max() < -1 / FARTHEST_CORNER)
    except QhullError:  # of points in a plane
        return False


def polar(points) -> np.ndarray:
    """Return the vertices (n, 3) of the polar body of a hull that holds the origin."""
    planes = ConvexHull(points).equations
    return hull_vertices(planes[:, :3] / -planes[:, 3:])


def without_touch(vertices, centres, count: int) -> np.ndarray:
    """Return at most `count` of the vertices of a hull, without those touched least.

    centres (N, 3): of fingers that touch.  A vertex without which some are farther from
    the hull costs these, by CORNER, at most MOST_OF_TOUCH nats each.  Of others the one
    goes that adds least volume.
    """
    V = hull_vertices(vertices)
    while len(V) > count:
        point, corners = nearest_triangles(V, centres)
        apart = np.linalg.norm(centres - point, axis=1)
        each, whole = ((corners == i).any(axis=1) for i in range(len(V))), volume(V)
        lost = [
            _loss(np.delete(V, i, axis=0), whole, centres[near], apart[near])
            for i, near in enumerate(each)
        ]
        V = np.delete(V, np.argmin(lost), axis=0)
    return V


def _loss(rest, whole: float, centres, apart) -> float:
    """Return what touches lose [nats] and the share of the volume that the rest lacks.

    whole [m^3]: the volume with all vertices; apart (N,) [m]: of centres from that.
    """
    left = volume(rest)
    if not left:  # it would be flat
        return np.inf
    share = 1 - left / whole
    if not len(centres):
        return share
    farther = np.linalg.norm(centres - nearest_points(rest, centres), axis=1) - apart
    return share + touch_cost(farther)


def touch_cost(off) -> float:
    """Return what touches that are off a hull (n,) [m] cost in all [nats]."""
    return float(np.minimum((off / CORNER) ** 2 / 2, MOST_OF_TOUCH).sum())
