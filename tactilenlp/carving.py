"""Carve a polytope out of what was felt: planes, free fingers, ground and a ball."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .errors import TactileError
from .hull import (
    Ball,
    corners,
    filled,
    fingers,
    merged,
    nearest,
    outer,
    thinned,
)
from .planes import Faces, bodily, unseen, unseen_ball

CUTS = 30  # at most, by fingers that feel nothing
PENETRATION = 0.1e-3  # [m] a free finger may sink in so far
FARTHEST = 3**0.5  # [radii] a cube's corners are so far out of the ball within it


def carved(window, faces: Faces, size, vertices: int, ground=True, ball=True):
    """Return the vertices (vertices, 3) [m] of the body behind the planes.

    ground: whether there is one, at z = 0; ball: whether it is a ball where no finger
    was.  Without one, None unless planes and ground close the body.
    """
    n = faces.n
    points, _ = bodily(window.touch, faces.x, n[faces.plane])
    planes = np.c_[n, np.maximum(faces.b, (points @ n.T).max(axis=0))]
    fitted = unseen_ball(points, size, ground)
    if ball:
        halfspaces = np.vstack([planes, unseen(points, fitted, ground)])
    elif (halfspaces := closed(planes, points, fitted, ground)) is None:
        return None
    found = corners(halfspaces)
    cuts = separating(window, faces, points)
    for _ in range(CUTS):
        deep = (found @ cuts[:, :3].T).max(axis=0, initial=-np.inf) - cuts[:, 3]
        if not len(cuts) or deep.max() < PENETRATION:
            break
        halfspaces = np.vstack([halfspaces, cuts[[np.argmax(deep)]]])
        try:
            found = corners(halfspaces)
        except TactileError:
            break
    return filled(thinned(outer(merged(found)), vertices), vertices)


def closed(planes, points, ball: Ball, ground) -> np.ndarray | None:
    """Return the half-spaces (n, 4) that close a body without a ball, if they do.

    They do where no corner of planes and ground is FARTHEST radii from the middle of
    the ball, or farther: a sharp corner that no finger felt is no reason for a face.
    """
    wide = replace(ball, radius=2 * FARTHEST * ball.radius)
    halfspaces = np.vstack([planes, unseen(points, wide, ground)])
    far = np.linalg.norm(corners(halfspaces) - ball.centre, axis=1).max()
    return halfspaces if far < FARTHEST * ball.radius else None


def separating(window, faces: Faces, points) -> np.ndarray:
    """Return half-spaces (n, 4) between the touched points and every free finger."""
    centre = fingers(window.free, faces.x)
    if not len(centre):
        return np.zeros((0, 4))
    away = centre - nearest_of(points, centre)
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    b = (centre * away).sum(axis=1) - window.free.radius
    return np.c_[away, np.maximum(b, (points @ away.T).max(axis=0))]


def nearest_of(points, centre) -> np.ndarray:
    """Return the points of the hull of `points` nearest to each centre (n, 3)."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[-1] < 1e-4:
        apart = np.linalg.norm(points[None] - centre[:, None], axis=2)
        return points[np.argmin(apart, axis=1)]
    return nearest(outer(points), centre)
