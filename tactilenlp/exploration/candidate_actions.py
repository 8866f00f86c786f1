"""Say from where fingers face a body: its corners, edges and faces."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..geometry.faces import polygons
from .action_space import Workspace

MANY = 100_000  # combinations of fingers: more are drawn, not shuffled
ROUND = 0.15  # [rad] beyond its bound, a direction is still brought to it


def facing(estimate, space: Workspace) -> list[np.ndarray]:
    """Return for each finger the angles (n, 2) that face corner, edge or face."""
    vertices, R_wo = estimate.vertices, estimate.rotation()
    points = list(vertices)
    for face, _ in polygons(vertices):
        points.append(vertices[face].mean(axis=0))
        points += [
            (vertices[i] + vertices[j]) / 2 for i, j in pairwise((*face, face[0]))
        ]
    toward = np.unique(np.round(points, 9), axis=0) @ R_wo.T
    if space.ground is not None:
        toward = toward @ space.ground.rotation.T
    azimuth = np.arctan2(toward[:, 1], toward[:, 0])
    declination = np.arcsin(toward[:, 2] / np.linalg.norm(toward, axis=1))
    out = []
    for finger in range(space.fingers):
        heading = 2 * np.pi * finger / space.fingers
        ascension = (azimuth - heading + np.pi) % (2 * np.pi) - np.pi
        at = slice(2 * finger, 2 * finger + 2)
        low, high = space.lower[at], space.upper[at]
        angles = np.stack([ascension, declination], axis=1)
        near = (angles >= low - ROUND) & (angles <= high + ROUND)
        near = np.clip(angles[near.all(axis=1)], low, high)
        out.append(near if len(near) else (low + high)[None] / 2)
    return out


def combined(facing: list[np.ndarray], count: int, rng) -> np.ndarray:
    """Return at most `count` actions (n, 2 F): each finger faces something."""
    sizes = [len(angles) for angles in facing]
    drawn = rng.permutation(min(np.prod(sizes), MANY))[:count]
    if np.prod(sizes) > MANY:
        drawn = rng.integers(np.prod(sizes), size=count)
    picks = np.unravel_index(drawn, sizes)
    return np.hstack([a[i] for a, i in zip(facing, picks, strict=True)])
