"""Measure the pose error of a polytope, modulo the symmetries of the body."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from trimesh import Trimesh

from tactilenlp.errors import TactileError
from tactilenlp.evaluation.metrics import (
    UNIT_TOLERANCE,
    PoseError,
    finite_array,
    smallest_rotation,
    triangles_of,
)
from tactilenlp.geometry.convex_hull import centroid


def polytope_pose_error(
    mesh: Trimesh,
    quaternion: ArrayLike,
    true_mesh: Trimesh,
    true_quaternion: ArrayLike,
    symmetries: ArrayLike = (((1, 0, 0), (0, 1, 0), (0, 0, 1)),),
) -> PoseError:
    """Compare the hull centroid and the rotation of a polytope with the truth.

    Quaternions (4,) wxyz, body to world, of body frames whose axes mean the same in
    estimate and truth; `symmetries` (K, 3, 3) rotate the body about its centroid, in
    the body frame.  Raises TactileError as `cuboid_errors`, and for flat meshes.
    """
    group = finite_array(symmetries, (None, 3, 3), "symmetries")
    skew = np.abs(group @ group.transpose(0, 2, 1) - np.eye(3)).max()
    if skew > UNIT_TOLERANCE or np.linalg.det(group).min() < 0:
        expected = "rotation matrices, no reflections"
        raise TactileError("unusable", where="symmetries", expected=expected)
    shift = _centroid(mesh, "mesh") - _centroid(true_mesh, "true_mesh")
    even = np.zeros(len(group))
    best, angle, turn = smallest_rotation(quaternion, true_quaternion, group, even)
    return PoseError(shift, angle, turn, group[best])


def _centroid(mesh: Trimesh, where: str) -> np.ndarray:
    """Return the volume centroid (3,) [m] of the convex hull."""
    from scipy.spatial import QhullError

    try:
        return centroid(triangles_of(mesh, where).reshape(-1, 3))
    except QhullError as error:
        expected = "vertices that are not all in one plane"
        raise TactileError("no volume", where=where, expected=expected) from error
