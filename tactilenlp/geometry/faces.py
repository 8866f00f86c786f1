"""Faces of a polytope: polygons, supporting planes with sigma, touches per face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ..common.brief import printed
from ..common.validation import check_types
from ..errors import OptionError
from .convex_hull import fingers_in_body
from .transforms import directions_in_body, rotate_back, rotation_of

KNOWN_FACE = 3  # contact samples that make a face known: fewer may be wrong booleans
FACE_COSINE = 0.99  # [-] |n . axis| above which a normal belongs to a face
BOX_NORMALS = np.stack([-np.eye(3), np.eye(3)], axis=1)  # (3 axes, 2 sides, 3)
FACE_REACH = 0.5e-3  # [m] a contact point this near to a face is on it
FACE_TILT = 0.05  # [rad] as exact as touched faces come out
# [rad], deviations: a touch at most so far off is of a face
MAX_TILT, TILT_DEVIATIONS = 0.14, 3.0


def polygons(points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the faces of the hull of points (n, 3): ordered corners, outward normal.

    Corners are indices of points; coplanar facets are one face.
    """
    try:
        planes = (hull := ConvexHull(points)).equations.round(5)  # one per face
    except (QhullError, ValueError) as bad:
        raise OptionError(
            "the body has no volume", where="vertices", got=np.ptp(points, axis=0),
            expected="corners (n, 3) [m] that are not in a plane",
            next="see whether the estimate is marked as not converged",
        ) from bad  # fmt: skip
    faces = []
    for plane in np.unique(planes, axis=0):
        corners = np.unique(hull.simplices[(planes == plane).all(axis=1)])
        arms = points[corners] - points[corners].mean(axis=0)
        turn = np.arctan2(arms @ np.cross(plane[:3], arms[0]), arms @ arms[0])
        faces.append((corners[np.argsort(turn)], plane[:3]))
    return faces


@printed
@dataclass(frozen=True, eq=False)
class SupportingPlanes:
    """The supporting planes of a body at the last sample, one row per face.

    normal (n, 3) outward unit, world frame; offset (n,) [m]: the body lies where
    normal . p <= offset; sigma (n,) [m]: standard deviation of the offset for a fixed
    normal, that of the face's least certain corner; corners: indices of vertices;
    touches (n,): samples that touched the face, -1 where this is unknown.
    """

    normal: np.ndarray
    offset: np.ndarray
    sigma: np.ndarray
    corners: tuple[np.ndarray, ...]
    touches: np.ndarray


def supporting_planes(estimate) -> SupportingPlanes:
    """Return the planes of all faces, touched or not, in the order of `polygons`.

    sigma is NaN for all if the information has no map to the corners.
    """
    check_types(estimate=(estimate, "Estimate"))
    R_wo, faces = estimate.rotation(), polygons(estimate.vertices)
    corners = tuple(corner for corner, _ in faces)
    n = np.array([R_wo @ normal for _, normal in faces])
    p = estimate.vertices @ R_wo.T + estimate.position[-1]
    b = np.array([(p[c] @ m).max() for c, m in zip(corners, n, strict=True)])
    each, moves = zip(corners, n, strict=True), _moves_of_corners(estimate)
    sigma = np.array([_deviations(estimate, moves[c], m).max() for c, m in each])
    touches = estimate.faces if estimate.faces.ndim == 1 else -np.ones(len(faces), int)
    if len(touches) != len(faces):
        raise OptionError(
            "the faces are those of another body", where="estimate.faces",
            got=f"touches of {len(touches)} faces", expected=f"{len(faces)} faces",
            next="use the estimate as it was solved or saved",
        )  # fmt: skip
    return SupportingPlanes(n, b, sigma, corners, touches)


def face_sigma(estimate) -> np.ndarray:
    """Return the standard deviation of each face at the last sample, (faces,) [m].

    That of the face's middle along its normal, from the joint covariance of shape and
    pose, in the order of `polygons`; NaN for all if the information has no map to the
    corners.
    """
    check_types(estimate=(estimate, "Estimate"))
    faces, moves = polygons(estimate.vertices), _moves_of_corners(estimate)
    R_wo = estimate.rotation()
    return np.concatenate([
        _deviations(estimate, moves[corner].mean(axis=0, keepdims=True), R_wo @ n_o)
        for corner, n_o in faces
    ])  # fmt: skip


def _moves_of_corners(estimate) -> np.ndarray:
    """Return the Jacobian of vertices by the unknowns (V, 3, k), world frame.

    NaN if the information has no map to the corners.
    """
    maps, vertices = estimate.information.maps, estimate.vertices
    k = maps["position"].shape[1]
    if is_hull(estimate):
        corners = maps["vertices"].reshape(-1, 3, k)
    elif is_box(estimate):
        corners = np.sign(vertices)[:, :, None] / 2 * maps["side_lengths"]
    else:
        return np.full((len(vertices), 3, k), np.nan)
    R_wo = estimate.rotation()
    turn = np.nan_to_num(maps["rotation"])  # NaN: held by a reduction
    by_turn = -np.cross(vertices @ R_wo.T, turn.T[:, None]).transpose(1, 2, 0)
    return maps["position"] + R_wo @ corners + by_turn


def _deviations(estimate, moves, n) -> np.ndarray:
    """Return sigma (c,) [m] along n (3,) of points with Jacobians (c, 3, k)."""
    J = n @ moves
    variance = ((J @ estimate.information.covariance_matrix) * J).sum(axis=1)
    return np.sqrt(np.where(variance < 0, np.inf, variance))


# What kind of body it is, by what its information tells, not by the name of its class:


def has_sides(estimate) -> bool:
    """Tell whether theta are the sides (3,) of a body, of any class."""
    return "side_lengths" in estimate.information.maps and estimate.theta.shape == (3,)


def is_box(estimate) -> bool:
    """Tell whether a body is a box with its sides as theta."""
    return has_sides(estimate) and len(estimate.vertices) == 8


def is_hull(estimate) -> bool:
    """Tell whether theta are vertices of a body, whose axes are held at the end."""
    return "vertices" in estimate.information.maps


# Which face a touch is of, by its normal alone, or by its place as well:


def touched_faces(data, quaternion, normals=BOX_NORMALS, turns=None) -> np.ndarray:
    """Return how many samples touched each face, (...), of a box (3 axes, 2 sides).

    quaternion (T, 4) wxyz, body to world; normals (..., 3): outward, body frame; turns
    (F, 3) [rad]: by which the fingers' normals are turned, None if they are not.  A
    touch is of every face with whose normal its own agrees by FACE_COSINE.
    """
    t, f = np.nonzero(data.contact)
    n = data.normal[t, f] if turns is None else rotate_back(data.normal, turns)[t, f]
    n = rotation_of(quaternion[t]).inv().apply(n)
    met = n @ normals.reshape(-1, 3).T > FACE_COSINE
    return np.count_nonzero(met, axis=0).reshape(normals.shape[:-1])


def touched_polygons(window, vertices, faces, x, sigma: float) -> np.ndarray:
    """Return the number of touches of each face of a hull at poses x (u, T).

    faces: corners and outward normal of each, as of `polygons`; sigma:
    deviation of felt normals [rad].  A touch belongs to the face whose normal is
    closest to the felt one, and to others within the error of felt normals.
    """
    facing = np.cos(min(MAX_TILT, FACE_TILT + TILT_DEVIATIONS * sigma))
    touch = window.touch
    centre = fingers_in_body(touch, x)
    n = directions_in_body(x, touch.sample, touch.normal)
    point = centre - touch.radius[:, None] * n
    alike = []  # (faces, touches): cosine to a face that the point is on
    for corners, normal in faces:
        off = (point - vertices[corners[0]]) @ normal
        alike.append(np.where(np.abs(off) < FACE_REACH, n @ normal, -1.0))
    alike = np.array(alike)
    best = np.maximum(alike.max(axis=0, initial=-1.0), np.cos(MAX_TILT))
    return np.count_nonzero((alike > facing) | (alike >= best), axis=1)
