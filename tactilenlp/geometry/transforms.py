"""Rotations of free poses x (6, T): their vectors, and the matrices that these mean.

Carry points and directions from the world into the frame of a body that moves.

Poses x are planar (3, T), the body's origin on the ground, or free (6, T).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

SMALL = 1e-4  # [rad] a turn below which the series is exact to rounding


def continuous(R) -> np.ndarray:
    """Return rotation vectors (n, 3) [rad] of rotations (n, 3, 3) without jumps."""
    w = Rotation.from_matrix(np.array(R)).as_rotvec()
    far = np.linalg.norm(np.diff(w, axis=0), axis=1) >= np.pi
    first = 1 + int(np.argmax(far)) if far.any() else len(w)  # till then w goes on
    for k in range(first, len(w)):
        angle = np.linalg.norm(w[k])
        if angle > 1e-6:
            turns = [w[k] * (1 + 2 * np.pi * j / angle) for j in (-1, 0, 1)]
            w[k] = min(turns, key=lambda v, k=k: np.linalg.norm(v - w[k - 1]))
    return w


def backward(R) -> np.ndarray:
    """Return the same, none at the last of the rotations, where the body is upright."""
    return continuous(R[::-1])[::-1]


def turning(x) -> np.ndarray:
    """Return how free poses x (6, T) turn with their rotation vectors (T, 3, 3).

    From a change of the vector to a small turn about the world's axes [rad].
    """
    w = x[3:].T
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    K = -np.cross(w[:, None], np.eye(3))
    small = angle < SMALL
    angle = np.where(small, 1.0, angle)
    first = np.where(small, 1 / 2, (1 - np.cos(angle)) / angle**2)
    second = np.where(small, 1 / 6, (angle - np.sin(angle)) / angle**3)
    return np.eye(3) + first * K + second * K @ K


def matrices(x) -> np.ndarray:
    """Return the rotations (T, 3, 3) of free poses x (6, T)."""
    return Rotation.from_rotvec(x[3:].T).as_matrix()


def is_planar(x) -> bool:
    """Tell whether poses x (unknowns, T) are planar."""
    return len(x) == 3


def directions_in_body(x, samples, a) -> np.ndarray:
    """Return the directions a (n, 3) at samples (n,), in the body frame."""
    pose = x[:, samples]
    if not is_planar(x):
        return np.einsum("nji,nj->ni", matrices(pose), a)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    back = c * a[:, 0] + s * a[:, 1], c * a[:, 1] - s * a[:, 0], a[:, 2]
    return np.stack(back, axis=1)


def points_in_body(x, samples, p_w) -> np.ndarray:
    """Return the points p_w (n, 3) [m] at samples (n,), in the body frame."""
    places = 2 if is_planar(x) else 3
    away = p_w.copy()
    away[:, :places] -= x[:places, samples].T
    return directions_in_body(x, samples, away)


def carried(x, old, new) -> np.ndarray:
    """Return poses x (3, T) carried by the planar motion that takes `old` to `new`."""
    turn = new[2] - old[2]
    c, s = np.cos(turn), np.sin(turn)
    a, b = x[:2] - old[:2, None]
    return np.vstack([new[0] + c * a - s * b, new[1] + s * a + c * b, x[2] + turn])
