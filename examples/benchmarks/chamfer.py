"""Compute the paper's bidirectional Chamfer distance (bCH).

It has two forms, of different units: as the paper prints it and as the authors'
code computes it.  Neither is comparable with the exact `surface_distance`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tactilenlp.common.validation import numbers_of
from tactilenlp.errors import TactileError
from tactilenlp.evaluation.metrics import (
    generator_of,
    points_on,
    triangles_of,
)

if TYPE_CHECKING:
    from trimesh import Trimesh


def chamfer_paper(points_a: ArrayLike, points_b: ArrayLike) -> float:
    """Compute bCH as the paper prints it: a sum of squares [m^2].

    sum_a min_b |a - b|^2 + sum_b min_a |b - a|^2 (the paper, "Problem formulation"), of
    finite points (N, 3) and (M, 3) [m], else TactileError.  It grows with N and M.
    """
    a, b = _checked("points_a", points_a), _checked("points_b", points_b)
    return float(sum(np.sum(distance**2) for distance in _nearest(a, b)))


def _checked(where: str, points: ArrayLike) -> np.ndarray:
    """Return points (N, 3) [m] as floats, finite and at least one, or raise."""
    points = numbers_of(where, points, TactileError, "N", 3, unit="[m]", finite=True)
    if not len(points):
        expected = "(N, 3) finite numbers [m], N > 0"
        raise TactileError("no points", where=where, got="none", expected=expected)
    return points


def chamfer_code(
    mesh_a: Trimesh, mesh_b: Trimesh, samples: int = 1000, seed: int = 0
) -> float:
    """Compute bCH as the authors' code does: mean distances, both ways added [m].

    Unsquared distances between nearest of `samples` random points a side, which the
    paper plots in mm.  Read it beside `chamfer_floor`.  Raises as `surface_distance`.
    """
    a, b = triangles_of(mesh_a, "mesh_a"), triangles_of(mesh_b, "mesh_b")
    generator = generator_of(samples, seed)
    points_a, points_b = (points_on(x, generator.random((samples, 3))) for x in (a, b))
    return float(sum(np.mean(distance) for distance in _nearest(points_a, points_b)))


def chamfer_floor(mesh: Trimesh, samples: int = 1000, seed: int = 0) -> float:
    """Compute `chamfer_code` of a perfect estimate, about sqrt(area / samples) [m]."""
    return chamfer_code(mesh, mesh, samples, seed)


def _nearest(points_a: np.ndarray, points_b: np.ndarray):
    """Return the distances [m] from each point to the nearest of the other set."""
    from scipy.spatial import cKDTree

    return cKDTree(points_b).query(points_a)[0], cKDTree(points_a).query(points_b)[0]
