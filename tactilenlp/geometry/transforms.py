"""Rotations and rigid motions: planar ones, quaternions wxyz, poses of a moving body.

Poses x are planar (3, T), with rows x, y [m] and yaw [rad] and the body's origin on the
ground, or free (6, T), with rows position [m] and rotation vector [rad].
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

SERIES_ANGLE = 1e-4  # [rad] below it the series is exact to rounding


def rotvecs(R) -> np.ndarray:
    """Return continuous rotation vectors (n, 3) [rad] of rotations (n, 3, 3)."""
    w = Rotation.from_matrix(np.array(R)).as_rotvec()
    far = np.linalg.norm(np.diff(w, axis=0), axis=1) >= np.pi
    first = 1 + int(np.argmax([*far, True]))  # w is continuous before it
    for k in range(first, len(w)):
        angle = np.linalg.norm(w[k])
        if angle > 1e-6:  # whole turns about its axis lead closest to the one before
            axis = w[k] / angle
            turns = np.round((w[k - 1] @ axis - angle) / (2 * np.pi))
            w[k] += 2 * np.pi * turns * axis
    return w


def rotvecs_back(R) -> np.ndarray:
    """Return the same, continuous from the last rotation back, where w is shortest."""
    return rotvecs(R[::-1])[::-1]


def left_jacobians(x) -> np.ndarray:
    """Return the left Jacobians of SO(3) (T, 3, 3) of free poses x (6, T).

    They map a change of the rotation vector to a small rotation about the world's axes.
    """
    w = x[3:].T
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    K = -np.cross(w[:, None], np.eye(3))
    small = angle < SERIES_ANGLE
    angle = np.where(small, 1.0, angle)
    first = np.where(small, 1 / 2, (1 - np.cos(angle)) / angle**2)
    second = np.where(small, 1 / 6, (angle - np.sin(angle)) / angle**3)
    return np.eye(3) + first * K + second * K @ K


def matrices(x) -> np.ndarray:
    """Return the rotations (T, 3, 3) of free poses x (6, T)."""
    return Rotation.from_rotvec(x[3:].T).as_matrix()


def rotation_of(quaternion) -> Rotation:
    """Return the rotations that quaternions wxyz (..., 4) stand for."""
    return Rotation.from_quat(np.roll(quaternion, -1, axis=-1))


def quaternion_of(rotation: Rotation) -> np.ndarray:
    """Return the quaternions wxyz (..., 4) of rotations."""
    return np.roll(rotation.as_quat(), 1, axis=-1)


def rotate_planar(yaw, x, y, origin=(0.0, 0.0)) -> tuple:
    """Return origin + R(yaw) (x, y), coordinates turned about the vertical.

    yaw [rad]; all arguments broadcast.  The inverse rotation is that by -yaw, to the
    last digit.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    return origin[0] + c * x - s * y, origin[1] + s * x + c * y


def planar_matrix(yaw: float) -> np.ndarray:
    """Return the rotation matrix (3, 3) about the vertical by yaw [rad]."""
    x, y, z = np.eye(3)
    return np.array([*rotate_planar(yaw, x, y), z])


def rotation_matrix(x) -> np.ndarray:
    """Return the rotation (3, 3) of one pose x, planar (3,) or free (6,)."""
    return planar_matrix(x[2]) if is_planar(x) else matrices(x[:, None])[0]


def is_planar(x) -> bool:
    """Return whether poses x (unknowns, T) are planar."""
    return len(x) == 3


def directions_in_body(x, samples, a) -> np.ndarray:
    """Return world directions a (n, 3) at samples (n,) in the body frame (n, 3)."""
    pose = x[:, samples]
    if not is_planar(x):
        return np.einsum("nji,nj->ni", matrices(pose), a)
    return np.stack([*rotate_planar(-pose[2], a[:, 0], a[:, 1]), a[:, 2]], axis=1)


def rotate_back(a, w) -> np.ndarray:
    """Return directions a (..., 3) before they were turned by w (..., 3) [rad]."""
    a, w = np.array(a), np.broadcast_to(w, a.shape)
    turn = Rotation.from_rotvec(np.array(w).reshape(-1, 3))
    return turn.inv().apply(a.reshape(-1, 3)).reshape(a.shape)


def points_in_body(x, samples, p_w) -> np.ndarray:
    """Return world points p_w (n, 3) [m] at samples (n,) in the body frame (n, 3)."""
    places = 2 if is_planar(x) else 3
    away = p_w.copy()
    away[:, :places] -= x[:places, samples].T
    return directions_in_body(x, samples, away)


def moved_origin(x, d) -> np.ndarray:
    """Return poses x (3, T) of the same body with its origin at d (2,) [m] of it."""
    moved = x.copy()
    moved[:2] += rotate_planar(x[2], *d)
    return moved


def move_poses(x, old, new) -> np.ndarray:
    """Return poses x, planar or free, moved by the planar motion from `old` to `new`.

    old, new (3,): x, y [m] and yaw [rad].
    """
    turn = new[2] - old[2]
    place = rotate_planar(turn, *(x[:2] - old[:2, None]), origin=new)
    if is_planar(x):
        return np.vstack([*place, x[2] + turn])
    turned = planar_matrix(turn) @ matrices(x)
    return np.vstack([*place, x[2], rotvecs(turned).T])
