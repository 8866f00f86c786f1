"""How well each face of an estimated shape is known: one deviation, one colour each."""

from __future__ import annotations

import numpy as np

from .checks import check_types

# Information runs from blue (none) over pale to red (much), as in the paper's first
# figure; these three are told apart by the colour-blind (after Okabe and Ito).
BLUE, PALE, RED = (0, 114, 178), (240, 228, 200), (213, 60, 0)
UNKNOWN, KNOWN = 10e-3, 0.1e-3  # [m] deviations that are as blue, as red as can be


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


def face_sigma(estimate) -> np.ndarray:
    """Return how well each face is known at the last sample, (faces,) [m].

    The standard deviation of a face's middle along its normal, from the covariance of
    shape and pose together, in the order of `polygons`; NaN for all where the
    information knows no corners.
    """
    check_types(estimate=(estimate, "Estimate"))
    maps, vertices = estimate.information.maps, estimate.vertices
    faces = polygons(vertices)
    k = maps["position"].shape[1]
    if "vertices" in maps:
        corners = maps["vertices"].reshape(-1, 3, k)
    elif "side_lengths" in maps and len(vertices) == 8:
        corners = np.sign(vertices)[:, :, None] / 2 * maps["side_lengths"]
    else:
        return np.full(len(faces), np.nan)
    R_wo = estimate.rotation()
    turn = np.nan_to_num(maps["rotation"])  # NaN: held by a reduction
    C = estimate.information.spread
    out = []
    for corner, n_o in faces:
        n_w, middle = R_wo @ n_o, R_wo @ vertices[corner].mean(axis=0)
        J = n_w @ (maps["position"] + R_wo @ corners[corner].mean(axis=0))
        J = J + np.cross(middle, n_w) @ turn
        out.append(J @ C @ J)
    return np.sqrt(np.where(np.array(out) < 0, np.inf, out))


def information_colour(sigma) -> np.ndarray:
    """Return the colour (..., 3) [0..255] of a deviation [m]; grey where it is NaN."""
    sigma = np.asarray(sigma, float)
    with np.errstate(divide="ignore"):
        much = np.log(UNKNOWN / sigma) / np.log(UNKNOWN / KNOWN)
    much = np.clip(np.nan_to_num(much, nan=0.5, posinf=1, neginf=0), 0, 1)
    scale = np.array([BLUE, PALE, RED], float)
    mixed = np.stack([np.interp(much, [0, 0.5, 1], c) for c in scale.T], axis=-1)
    mixed[np.isnan(sigma)] = 170.0
    return mixed.round().astype(np.uint8)
