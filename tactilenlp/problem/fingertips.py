"""Describe fingertips: their geometry, their poses, and equivalent spheres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations.finger import SPHERE, Finger, capsule

from ..geometry.transforms import rotation_of

END_COSINE = 0.1  # [-] cosine between capsule and normal from which on its end touches


def finger_of(scene) -> Finger:
    """Return the geometry of the fingertips of a scene."""
    return capsule(scene.finger_length / 2) if scene.finger_length > 0 else SPHERE


def finger_poses(data, scene) -> np.ndarray:
    """Return where the fingers are as their geometry takes it, (T, F, numbers)."""
    if scene.finger_length == 0:
        return data.finger_position
    return np.concatenate([data.finger_position, data.finger_orientation], axis=2)


def as_spheres(data, scene):
    """Return the data as spherical fingertips would measure them, for initial guesses.

    Where a capsule touches, the sphere is at that end of it which points against the
    normal, or in its middle where it lies along the surface; else in its middle.
    """
    if scene.finger_length == 0:
        return data
    turn = rotation_of(data.finger_orientation.reshape(-1, 4))
    axis = turn.apply([0, 0, 1.0]).reshape(data.normal.shape)
    along = (axis * data.normal).sum(axis=2, keepdims=True)
    u = -np.clip(along / END_COSINE, -1, 1)
    p = data.finger_position + u * scene.finger_length / 2 * axis
    return replace(data, finger_position=p, finger_orientation=None)
