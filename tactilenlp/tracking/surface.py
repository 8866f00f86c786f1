"""Points of the surface of a body from theta, and supports by which poses are compared.

The support function s(d) = max over points p of the body of d . p, for fixed directions
d of the world, does not depend on how the axes of a symmetric body are named, and the
largest difference of two is the Hausdorff distance of two convex bodies.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from formulations.shape_check import directions

from ..errors import TactileError
from ..geometry.transforms import is_planar, rotation_matrix

MESH_RAYS = 642  # of a sphere of 25 mm, facets are then within 0.15 mm
OUTLINE_RAYS = 200  # that are enough to compare bodies
RAY_HALVINGS = 50  # of the interval along a ray: to rounding
SURFACE_EDGE = 1e-4  # rounding of edges, by the reach of the body
INNERMOST = 1e-6  # where a ray starts, by the reach: an ellipsoid's d(0) is 0 / 0
LEVEL = np.pi / 6 * np.arange(12)  # [rad] of the horizontal directions
LEVEL_RAYS = np.stack([np.cos(LEVEL), np.sin(LEVEL)], 1)  # (12, 2)
EVERYWHERE = np.vstack([
    np.c_[LEVEL_RAYS, np.zeros(12)], np.c_[LEVEL_RAYS, np.ones(12)] / np.sqrt(2),
    np.c_[LEVEL_RAYS, -np.ones(12)] / np.sqrt(2), [[0, 0, 1], [0, 0, -1]],
])  # fmt: skip


def body_surface(shape, theta, count: int = MESH_RAYS) -> np.ndarray:
    """Return points (V, 3) [m], body frame, whose convex hull is the body.

    A shape with a `mesh` has its points.  Of any other, the distance is zero at the
    points, one on each of `count` directions from the origin; the edges between them
    are cut.  TactileError where a ray does not cross the surface within `reach`.
    """
    if shape.mesh is not None:
        return np.array(shape.mesh(theta), float)
    reach, rays = float(shape.reach(theta)), np.asarray(directions(count))
    q = shape.symbol("q", 3)
    phi = shape.distance(ca.DM(theta), q, SURFACE_EDGE * reach)
    each = ca.Function("distance", [q], [phi]).map(count)

    def distance(length):
        return np.asarray(each(length * rays)).ravel()

    low = np.full(count, INNERMOST * reach)
    high = np.full(count, (1 + SURFACE_EDGE) * reach)
    crossed = (distance(low) < 0) & (distance(high) >= 0)
    if not crossed.all():
        raise TactileError(
            "the distance has no zero between the origin and the reach of the body",
            where=f"shape {shape.name!r}",
            got=f"{np.count_nonzero(~crossed)} of {count} directions, "
            f"theta {np.round(theta, 4).tolist()}, reach {reach:.4g} m",
            expected="distance < 0 near the origin, >= 0 at reach(theta)",
            next="correct distance or reach of the Shape",
        )
    for _ in range(RAY_HALVINGS):
        middle = (low + high) / 2
        within = distance(middle) < 0
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return ((low + high) / 2 * rays).T


def trajectory_outline(shape, h, every: int) -> np.ndarray:
    """Return points (12, 2, T) [m] of planar poses: supports around the origin."""
    body, x = body_surface(shape, h.theta, OUTLINE_RAYS)[:, :2], h.x[:, ::every]
    angle = LEVEL[:, None] - x[2]  # directions in the body frame
    d = np.stack([np.cos(angle), np.sin(angle)], axis=2)
    reach = (d @ body.T).max(axis=2)
    return x[:2] + reach[:, None] * LEVEL_RAYS[:, :, None]


def supports(shape, h, sample: int) -> np.ndarray:
    """Return the support function (38,) [m] of a body at a sample, ground frame."""
    p, R = pose_of(shape, h.theta, h.x[:, sample])
    points = body_surface(shape, h.theta, OUTLINE_RAYS) @ R.T + p
    return (EVERYWHERE @ points.T).max(axis=1)


def pose_of(shape, theta, x) -> tuple[np.ndarray, np.ndarray]:
    """Return the origin (3,) [m] and rotation (3, 3) of a pose x, planar or free."""
    p = np.r_[x[:2], float(shape.rest_height(theta))] if is_planar(x) else x[:3]
    return p, rotation_matrix(x)
