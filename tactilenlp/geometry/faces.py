"""How well each face of an estimated shape is known: one deviation, one colour each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.validation import check_types


def polygons(points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the faces of the hull of points (n, 3): corners in order, outward normal.

    Corners are indices; facets of one plane are one face.
    """
    from scipy.spatial import ConvexHull

    planes = (hull := ConvexHull(points)).equations.round(5)  # one per face
    faces = []
    for plane in np.unique(planes, axis=0):
        corners = np.unique(hull.simplices[(planes == plane).all(axis=1)])
        arms = points[corners] - points[corners].mean(axis=0)
        turn = np.arctan2(arms @ np.cross(plane[:3], arms[0]), arms @ arms[0])
        faces.append((corners[np.argsort(turn)], plane[:3]))
    return faces


@dataclass(frozen=True, eq=False)
class SupportingPlanes:
    """The planes behind which a body lies at the last sample, a row for each face.

    normal (n, 3) outward unit, world frame; offset (n,) [m]: the body lies where
    normal . p <= offset; sigma (n,) [m]: standard deviation of the offset, the normal
    as it is: that of the face's least certain corner; corners: indices of vertices;
    touches (n,): samples that touched the face, -1 where the estimate does not tell.
    """

    normal: np.ndarray
    offset: np.ndarray
    sigma: np.ndarray
    corners: tuple[np.ndarray, ...]
    touches: np.ndarray


def supporting_planes(estimate) -> SupportingPlanes:
    """Return the planes of all faces, touched or not, in the order of `polygons`.

    sigma is NaN for all where the information knows no corners.
    """
    check_types(estimate=(estimate, "Estimate"))
    R_wo, faces = estimate.rotation(), polygons(estimate.vertices)
    corners = tuple(corner for corner, _ in faces)
    n = np.array([R_wo @ normal for _, normal in faces])
    p = estimate.vertices @ R_wo.T + estimate.position[-1]
    b = np.array([(p[c] @ m).max() for c, m in zip(corners, n, strict=True)])
    sigma = np.full(len(faces), np.nan)
    if (moves := _moves_of_corners(estimate)) is not None:
        each = zip(corners, n, strict=True)
        sigma = np.array([_deviations(estimate, moves[c], m).max() for c, m in each])
    touches = estimate.faces if estimate.faces.ndim == 1 else -np.ones(len(faces), int)
    return SupportingPlanes(n, b, sigma, corners, touches)


def face_sigma(estimate) -> np.ndarray:
    """Return how well each face is known at the last sample, (faces,) [m].

    The standard deviation of a face's middle along its normal, from the covariance of
    shape and pose together, in the order of `polygons`; NaN for all where the
    information knows no corners.
    """
    check_types(estimate=(estimate, "Estimate"))
    faces, moves = polygons(estimate.vertices), _moves_of_corners(estimate)
    if moves is None:
        return np.full(len(faces), np.nan)
    R_wo = estimate.rotation()
    return np.concatenate([
        _deviations(estimate, moves[corner].mean(axis=0, keepdims=True), R_wo @ n_o)
        for corner, n_o in faces
    ])  # fmt: skip


def _moves_of_corners(estimate) -> np.ndarray | None:
    """Return how each vertex moves with the unknowns (V, 3, k), world frame [m].

    None where the information knows no corners.
    """
    maps, vertices = estimate.information.maps, estimate.vertices
    k = maps["position"].shape[1]
    if "vertices" in maps:
        corners = maps["vertices"].reshape(-1, 3, k)
    elif "side_lengths" in maps and len(vertices) == 8:
        corners = np.sign(vertices)[:, :, None] / 2 * maps["side_lengths"]
    else:
        return None
    R_wo = estimate.rotation()
    turn = np.nan_to_num(maps["rotation"])  # NaN: held by a reduction
    turned = -np.cross(vertices @ R_wo.T, turn.T[:, None]).transpose(1, 2, 0)
    return maps["position"] + R_wo @ corners + turned


def _deviations(estimate, moves, n) -> np.ndarray:
    """Return deviations (c,) [m] along n (3,) of points that move by (c, 3, k)."""
    J = n @ moves
    variance = ((J @ estimate.information.spread) * J).sum(axis=1)
    return np.sqrt(np.where(variance < 0, np.inf, variance))


def touched_faces(data, quaternion, threshold) -> np.ndarray:
    """Return how many samples touched each face, (3 axes, 2 sides)."""
    from scipy.spatial.transform import Rotation

    t, f = np.nonzero(data.contact & data.valid)
    R = Rotation.from_quat(quaternion[t][:, [1, 2, 3, 0]])
    n = R.inv().apply(data.normal[t, f])
    return np.stack([(n < -threshold).sum(axis=0), (n > threshold).sum(axis=0)], 1)
