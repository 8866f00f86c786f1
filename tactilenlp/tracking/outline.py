"""Outlines of bodies by their support function, to compare poses of any shape.

s(d) = max over points p of the body of d . p, for fixed directions d of the world.  It
does not depend on how the axes of a symmetric body are named, and the largest
difference of two is the Hausdorff distance of two convex bodies.
"""

from __future__ import annotations

import numpy as np

from ..geometry.transforms import is_planar, matrices, planar_matrix
from .surface import body_surface, sampled_surface

OUTLINE_RAYS = 200  # that sample a surface without a mesh
LEVEL = np.pi / 6 * np.arange(12)  # [rad] of the horizontal directions
LEVEL_RAYS = np.stack([np.cos(LEVEL), np.sin(LEVEL)], 1)  # (12, 2)
EVERYWHERE = np.vstack([
    np.c_[LEVEL_RAYS, np.zeros(12)], np.c_[LEVEL_RAYS, np.ones(12)] / np.sqrt(2),
    np.c_[LEVEL_RAYS, -np.ones(12)] / np.sqrt(2), [[0, 0, 1], [0, 0, -1]],
])  # fmt: skip


def outline(shape, theta) -> np.ndarray:
    """Return points (V, 3) [m] of the surface, body frame."""
    if shape.mesh is not None or shape.is_box:
        return body_surface(shape, theta)
    return sampled_surface(shape, theta, OUTLINE_RAYS)


def path_outline(shape, h, every: int) -> np.ndarray:
    """Return points (12, 2, T) [m] of a planar path: supports around the origin."""
    body, x = outline(shape, h.theta)[:, :2], h.x[:, ::every]
    turned = LEVEL[:, None] - x[2]  # directions in the body frame
    d = np.stack([np.cos(turned), np.sin(turned)], axis=2)
    reach = (d @ body.T).max(axis=2)
    return x[:2] + reach[:, None] * LEVEL_RAYS[:, :, None]


def supports(shape, h, sample: int) -> np.ndarray:
    """Return the support function (38,) [m] of a body at a sample, ground frame."""
    x = h.x[:, sample]
    if is_planar(h.x):
        p, R = np.r_[x[:2], float(shape.rest_height(h.theta))], planar_matrix(x[2])
    else:
        p, R = x[:3], matrices(x[:, None])[0]
    points = outline(shape, h.theta) @ np.reshape(R, (3, 3)).T + p
    return (EVERYWHERE @ points.T).max(axis=1)
