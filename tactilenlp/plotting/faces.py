"""Compute the faces of an estimate at a sample and their one-sigma band, in mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import HalfspaceIntersection

from ..common.brief import MM_PER_M
from ..geometry.faces import KNOWN_FACE, face_sigma, is_box, polygons, touched_faces
from ..information.tangent_space import VERTICAL

MAX_DRAWN_SIGMA = 26e-3  # [m] of an unobserved face: the band stays within the margins
MIN_DISTANCE_SHARE = 0.02  # [-] least distance of a drawn face over that estimated


@dataclass(frozen=True, eq=False)
class Face:
    """One face: corners (k, 3) [mm] in order and outward normal (3,), world frame."""

    corners: np.ndarray
    normal: np.ndarray
    touched: bool = False


def faces_of_hull(points) -> list[Face]:
    """Return the faces of the convex hull of points (n, 3) [mm]."""
    return [Face(points[corners], normal) for corners, normal in polygons(points)]


def faces_at(estimate, sample: int):
    """Return the faces at a sample, and the corners (n, 3) [mm] one sigma out and in.

    The faces of a cuboid move by their standard deviation at the last sample, and by
    that of its sizes alone at others; the faces of a polytope by that at the last
    sample.  None in place of the corners where the deviation of a face is not computed.
    """
    R_wo, p_wo = estimate.rotation(sample), estimate.position[sample]
    planes = polygons(estimate.vertices)
    normals = np.array([n for _, n in planes])
    touched = _touched(estimate, normals)
    faces = [
        Face(
            (estimate.vertices[corners] @ R_wo.T + p_wo) * MM_PER_M,
            R_wo @ n_o,
            bool(known),
        )
        for (corners, n_o), known in zip(planes, touched, strict=True)
    ]
    sigma = _deviations(estimate, sample, normals)
    if np.isnan(sigma).any():
        return faces, None
    away = np.array([estimate.vertices[c[0]] @ n for c, n in planes])  # from the origin
    band = [
        _moved(normals, away, way * np.minimum(sigma, MAX_DRAWN_SIGMA))
        for way in (1, -1)
    ]
    return faces, [(corners @ R_wo.T + p_wo) * MM_PER_M for corners in band]


def _moved(normals, away, by) -> np.ndarray:
    """Return the corners (n, 3) [m] of a body whose faces are moved out by `by` [m]."""
    away = np.maximum(away + by, MIN_DISTANCE_SHARE * away)
    return HalfspaceIntersection(np.c_[normals, -away], np.zeros(3)).intersections


def _touched(estimate, normals) -> np.ndarray:
    """Tell which faces were touched or lie on the ground, (faces,) bool."""
    scene, touches = estimate.scene, estimate.faces
    if touches.shape != normals.shape[:1]:  # not counted by the estimate
        data, turns = estimate.measurements, estimate.finger_turn
        touches = touched_faces(data, estimate.quaternion, normals, turns)
    # As many samples as make a face of a cuboid count as touched in its sigma.
    enough = KNOWN_FACE if is_box(estimate) else 1
    down = np.zeros(len(normals), bool)
    if scene.ground is not None:
        down = normals @ estimate.rotation().T @ scene.ground.normal < -VERTICAL
    return (touches >= enough) | down


def _deviations(estimate, sample: int, normals) -> np.ndarray:
    """Return the standard deviation of each face along its normal, (faces,) [m]."""
    last = range(len(estimate.position))[sample] == len(estimate.position) - 1
    if last or not is_box(estimate):
        return face_sigma(estimate)
    axis, side = np.argmax(abs(normals), axis=1), (normals.sum(axis=1) > 0).astype(int)
    # Sizes alone: the untouched face of two moves by the whole deviation.
    known = estimate.faces >= KNOWN_FACE
    known[2, 0] |= estimate.scene.ground is not None
    share = np.where(known.sum(axis=1, keepdims=True) == 1, ~known, 0.5)
    return (estimate.information.sigma("side_lengths")[:, None] * share)[axis, side]
