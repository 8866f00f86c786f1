"""Carry points and directions from the world into the frame of a body that moves.

Poses x are planar (3, T), the body's origin on the ground, or free (6, T).
"""

from __future__ import annotations

import numpy as np

from .rotations import matrices


def planar(x) -> bool:
    """Tell whether poses x (unknowns, T) are planar."""
    return len(x) == 3


def directions(x, samples, a) -> np.ndarray:
    """Return the directions a (n, 3) at samples (n,), in the body frame."""
    pose = x[:, samples]
    if not planar(x):
        return np.einsum("nji,nj->ni", matrices(pose), a)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    back = c * a[:, 0] + s * a[:, 1], c * a[:, 1] - s * a[:, 0], a[:, 2]
    return np.stack(back, axis=1)


def points(x, samples, p_w) -> np.ndarray:
    """Return the points p_w (n, 3) [m] at samples (n,), in the body frame."""
    places = 2 if planar(x) else 3
    away = p_w.copy()
    away[:, :places] -= x[:places, samples].T
    return directions(x, samples, away)
