"""A body of sizes and a pose as it stands on the ground, and as it lies once let go.

z is theta and the unknowns of a pose: planar (3,) or free (6,), ground frame.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..geometry.support import Standing, settling
from ..geometry.transforms import rotation_matrix
from ..problem.poses import body_corners
from .surface import body_surface, pose_of

SLOPE_STEP = 1e-6  # [m], [rad] of the differences by which vertices move with unknowns


def lying(shape, z) -> np.ndarray:
    """Return a body of a free pose, z (theta, pose), as it lies once it is let go."""
    theta, x = np.split(z, [shape.theta])
    p, R = pose_of(shape, theta, x)
    turn, p = settling(solid_points(shape, theta) @ R.T, p)
    return np.r_[theta, p, Rotation.from_matrix(turn @ R).as_rotvec()]


def solid_points(shape, theta) -> np.ndarray:
    """Return points (n, 3) [m] whose hull is a body, the corners on which it lies too.

    Rays that sample a surface without a mesh miss its corners by millimetres.
    """
    points = body_surface(shape, theta)
    return points if shape.mesh else np.vstack([points, body_corners(shape, theta)])


def standing_of(shape, z, covariance, centre) -> Standing:
    """Return a body z (theta, pose) (k,), known to a covariance (k, k), as it stands.

    centre (3,) [m]: of mass, from the centroid, body frame.
    """
    (theta, x), n = np.split(z, [shape.theta]), shape.theta
    p, R = pose_of(shape, theta, x)
    body = solid_points(shape, theta)
    slopes = np.zeros((len(body), 3, len(z)))
    for i, step in enumerate(SLOPE_STEP * np.eye(n)):
        ends = (solid_points(shape, theta + d) for d in (step, -step))
        slopes[:, :, i] = np.subtract(*ends) @ R.T / (2 * SLOPE_STEP)
    for i, step in enumerate(SLOPE_STEP * np.eye(len(x)), n):
        turned = rotation_matrix(x + step) - rotation_matrix(x - step)
        slopes[:, :, i] = body @ turned.T / (2 * SLOPE_STEP)
    return Standing(body @ R.T, p, (R @ centre)[:2], slopes[:, :2], covariance)
