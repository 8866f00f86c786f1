"""Compute points of the surface of a body from theta, for meshes and models."""

from __future__ import annotations

import casadi as ca
import numpy as np

from formulations.shape_check import directions

from ..errors import TactileError
from ..problem.poses import body_corners

MESH_RAYS = 642  # of a sphere of 25 mm, facets are then within 0.15 mm
RAY_HALVINGS = 50  # of the interval along a ray: to rounding
SURFACE_EDGE = 1e-4  # rounding of edges, by the reach of the body
INNERMOST = 1e-6  # where a ray starts, by the reach: an ellipsoid's d(0) is 0 / 0


def body_surface(shape, theta) -> np.ndarray:
    """Return points (V, 3) [m], body frame, whose convex hull is the body.

    A cuboid has its corners, a shape with a `mesh` its points.  Of any other, the
    distance is zero at the points, one on each of MESH_RAYS directions from the origin;
    the edges between them are cut.  TactileError where a ray does not cross the surface
    within `reach`.
    """
    if shape.is_box:
        return body_corners(shape, theta)
    if shape.mesh is not None:
        return np.array(shape.mesh(theta), float)
    return sampled_surface(shape, theta)


def sampled_surface(shape, theta, count: int = MESH_RAYS) -> np.ndarray:
    """Return points (count, 3) [m] of evenly spread rays where the distance is zero."""
    reach, rays = float(shape.reach(theta)), np.asarray(directions(count))
    distance = _distances(shape, theta, SURFACE_EDGE * reach)
    low = np.full(count, INNERMOST * reach)
    high = np.full(count, (1 + SURFACE_EDGE) * reach)
    inside, outside = distance(low * rays) < 0, distance(high * rays) >= 0
    if not (inside & outside).all():
        raise TactileError(
            "the distance has no zero between the origin and the reach of the body",
            where=f"shape {shape.name!r}",
            got=f"{np.count_nonzero(~(inside & outside))} of {count} directions, "
            f"theta {np.round(theta, 4).tolist()}, reach {reach:.4g} m",
            expected="distance < 0 near the origin, >= 0 at reach(theta)",
            next="correct distance or reach of the Shape",
        )
    for _ in range(RAY_HALVINGS):
        middle = (low + high) / 2
        within = distance(middle * rays) < 0
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return ((low + high) / 2 * rays).T


def _distances(shape, theta, small: float):
    """Return the function that maps points (3, n) [m] to distances (n,) [m]."""
    q = shape.symbol("q", 3)
    one = ca.Function("distance", [q], [shape.distance(ca.DM(theta), q, small)])
    return lambda points: np.asarray(one.map(points.shape[1])(points)).ravel()
