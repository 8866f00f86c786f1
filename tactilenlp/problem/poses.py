"""Compute poses and corners of a body from the unknowns of a page."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from ..data.ground import frame_of
from ..geometry.tipping import planar_to_free
from ..geometry.transforms import is_planar, matrices, quaternion_of, rotation_of


def poses(shape, theta, x, ground):
    """Return position (T, 3) [m], quaternion (T, 4) wxyz, world, of poses x (u, T)."""
    x = planar_to_free(theta, x, shape) if is_planar(x) else x
    ground, rotation = frame_of(ground), Rotation.from_matrix(matrices(x))
    rotation = Rotation.from_matrix(ground.rotation).inv() * rotation
    return ground.from_ground(x[:3].T), quaternion_of(rotation)


def rotations_on_ground(ground, quaternion) -> Rotation:
    """Return the rotations (T,) in the frame of the ground, or of the world without it.

    quaternion (T, 4): wxyz, world.
    """
    return Rotation.from_matrix(frame_of(ground).rotation) * rotation_of(quaternion)


def upright_poses(ground, position, quaternion) -> np.ndarray:
    """Return planar poses (3, T) as if a body stood upright, of poses in the world.

    In the frame of the ground, or of the world without it: x, y [m], and the yaw [rad]
    since the last pose, up to whole turns.  position (T, 3) [m], quaternion (T, 4).
    """
    R = rotations_on_ground(ground, quaternion)
    p = frame_of(ground).to_ground(position)
    yaw = np.unwrap((R * R[-1].inv()).as_rotvec()[:, 2])
    return np.vstack([p[:, :2].T, yaw])


def body_corners(shape, theta) -> np.ndarray:
    """Return the corners of a body, body frame, (corners, 3) [m]."""
    return np.asarray(_corners(shape)(theta)).T


@cache
def _corners(shape):
    """Return theta -> (3, 2 n): corners, and these mirrored at the plane z = 0."""
    theta = ca.SX.sym("theta", shape.theta)
    signs = np.array(shape.corners)
    every = np.vstack([signs, signs * [1, 1, -1]])
    points = ca.horzcat(*(shape.corner(theta, ca.DM(s)) for s in every))
    return ca.Function("corners", [theta], [points])
