"""Rotations of free poses x (6, T): their vectors, and the matrices that these mean."""

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
