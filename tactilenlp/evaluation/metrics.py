"""Compare an estimated body with the true one, that of a simulated world for instance.

The exact surface distance, and the errors of a cuboid's sizes and pose modulo its
symmetries.  The paper's Chamfer distances, which only the benchmarks report, are in
`examples/benchmarks/chamfer.py`.  SI units; a mesh is a `trimesh.Trimesh` in the world
frame, a cuboid's
`box(side_lengths, translation_matrix(position) @ quaternion_matrix(quaternion))`.

A world tells the truth by a method, `true_body(time)`: the TrueBody at a time [s] of
its measurements, None where it is not known.  No estimate and no choice of an action
calls it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ..common.brief import printed
from ..common.validation import (
    as_floats,
    check_kind,
    check_whole,
    checked_unit,
    numbers_of,
)
from ..data.trajectories import QUATERNION_TOLERANCE
from ..errors import TactileError
from ..geometry.faces import is_box
from ..geometry.transforms import rotation_of

if TYPE_CHECKING:
    from trimesh import Trimesh

# The real root of g^3 = g + 1: steps of 1/g and 1/g^2 fill a square evenly (Roberts,
# "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
PLASTIC_NUMBER = 1.3247179572447460
# Among relabelings whose angles differ by less than this [rad], the sizes decide (our
# choice: one degree).
NEAR_TIE = np.deg2rad(1.0)
# Pairs of point and triangle in memory at once (some 100 MB with all temporaries).
PAIRS_AT_ONCE = 200_000


@printed
@dataclass(frozen=True, eq=False)
class TrueBody:
    """The true body at an instant.

    mesh: its surface, in the world frame [m]; position (3,) [m] and quaternion (4,)
    wxyz of its body frame; side_lengths (3,) [m] of a cuboid, else None.
    """

    mesh: Trimesh
    position: np.ndarray
    quaternion: np.ndarray
    side_lengths: np.ndarray | None = None


@dataclass(frozen=True)
class SurfaceDistance:
    """The exact distance between two surfaces [m].

    `a_to_b` and `b_to_a` are the mean distances of points of one surface to the other,
    `mean` (p2s) is their average, `maximum` the largest of both.
    """

    mean: float
    maximum: float
    a_to_b: float
    b_to_a: float


@dataclass(frozen=True)
class CuboidError:
    """The errors of pose and sizes of a cuboid, modulo its 24 axis relabelings.

    `position` (3,) [m] is estimate minus truth; `rotation_vector` (3,) [rad], of length
    `rotation_angle`, satisfies R_estimate @ symmetry = exp(rotation_vector) @ R_true;
    `symmetry` (3, 3) is the relabeling with the smallest angle.  World frame.

    `side_lengths` (3,) [m] is `estimate[permutation] - truth`, on the true axes, and
    a covariance of sizes becomes `covariance[np.ix_(permutation, permutation)]`; those
    of position and world-frame rotation stay, as a relabeling acts on the body's side.
    """

    position: np.ndarray
    rotation_angle: float
    rotation_vector: np.ndarray
    symmetry: np.ndarray
    side_lengths: np.ndarray
    permutation: np.ndarray


def errors_of(world, estimate) -> dict[str, float]:
    """Return the errors of an estimate at its last sample, SI; empty without a truth.

    surface, surface_max [m]: exact distance, mean and largest; position [m] of the
    centroid; of two cuboids side_lengths [m], the largest, and rotation [rad], modulo
    symmetry.  Raises OptionError if `true_body` returns anything else.
    """
    if getattr(world, "true_body", None) is None:
        return {}
    true = world.true_body(float(estimate.measurements.time[-1]))
    if true is None:
        return {}
    fix = "return None where it is not known"
    check_kind("world.true_body", true, TrueBody, next=fix)
    distance = surface_distance(estimate.mesh(), true.mesh)
    errors = {"surface": distance.mean, "surface_max": distance.maximum}
    off = np.linalg.norm(estimate.position[-1] - true.position)
    errors["position"] = float(off)
    if true.side_lengths is not None and is_box(estimate):
        pose = estimate.position[-1], estimate.quaternion[-1]
        truth = true.side_lengths, true.position, true.quaternion
        apart = cuboid_errors(estimate.side_lengths, *pose, *truth)
        errors["side_lengths"] = float(np.abs(apart.side_lengths).max())
        errors["rotation"] = float(apart.rotation_angle)
    return errors


def surface_distance(
    mesh_a: Trimesh, mesh_b: Trimesh, samples: int = 2000, seed: int = 0
) -> SurfaceDistance:
    """Measure the distance of points of each surface to the exact other surface.

    `samples` points a side are spread evenly over the area; the means of two boxes are
    then right to about 0.5 %.  The maximum is over these points and all vertices: the
    Hausdorff distance from below, short of it by less than the spacing of the points.
    Swapping the arguments swaps `a_to_b` and `b_to_a` and changes nothing else.
    Raises TactileError for a mesh without area, OptionError for `samples`, `seed`.
    """
    generator = generator_of(samples, seed)
    a, b = triangles_of(mesh_a, "mesh_a"), triangles_of(mesh_b, "mesh_b")
    steps = 1 / samples, 1 / PLASTIC_NUMBER, 1 / PLASTIC_NUMBER**2
    cube = (np.outer(np.arange(samples), steps) + generator.random(3)) % 1.0
    (a_to_b, far_a), (b_to_a, far_b) = _one_way(a, b, cube), _one_way(b, a, cube)
    return SurfaceDistance((a_to_b + b_to_a) / 2, max(far_a, far_b), a_to_b, b_to_a)


def cuboid_errors(
    side_lengths: ArrayLike,
    position: ArrayLike,
    quaternion: ArrayLike,
    true_side_lengths: ArrayLike,
    true_position: ArrayLike,
    true_quaternion: ArrayLike,
) -> CuboidError:
    """Compare a cuboid's sizes and pose with the truth modulo its axis relabelings.

    Of the 24 proper relabelings of the estimate's axes, the one with the smallest
    rotation angle counts; within a degree of it, the one with the smallest size error.
    Full side lengths (3,) [m], centres (3,) [m], quaternions (4,) wxyz, body to world.
    Raises TactileError for wrong shapes and values (sizes above 0, unit quaternions).
    """
    cube = np.round(Rotation.create_group("O").as_matrix())
    # Column k of a relabeling is the new axis k in the old axes: one entry of +-1.
    permutations = np.argmax(np.abs(cube), axis=1)
    of, lengths = (TactileError, 3), {"unit": "[m]", "positive": True}
    sizes = numbers_of("side_lengths", side_lengths, *of, **lengths)[permutations]
    sizes = sizes - numbers_of("true_side_lengths", true_side_lengths, *of, **lengths)
    place = {"unit": "[m]", "finite": True}
    shift = numbers_of("position", position, *of, **place)
    shift = shift - numbers_of("true_position", true_position, *of, **place)
    quaternions = {"quaternion": quaternion, "true_quaternion": true_quaternion}
    unit = 4, QUATERNION_TOLERANCE, TactileError, "give a quaternion wxyz of length 1"
    wxyz = [checked_unit(name, value, *unit) for name, value in quaternions.items()]
    R_we, R_wt = rotation_of(wxyz).as_matrix()
    turns = Rotation.from_matrix(R_we @ cube @ R_wt.T).as_rotvec()
    angles, misfit = (np.linalg.norm(rows, axis=1) for rows in (turns, sizes))
    near = np.flatnonzero(angles <= angles.min() + NEAR_TIE)
    best = min(near, key=lambda k: (misfit[k], angles[k]))
    return CuboidError(
        shift, float(angles[best]), turns[best], cube[best], sizes[best],
        permutations[best],
    )  # fmt: skip


def points_on(triangles: np.ndarray, cube: np.ndarray) -> np.ndarray:
    """Map points (N, 3) of the unit cube to the surface (M, 3, 3), preserving area."""
    from trimesh.triangles import area

    covered = np.cumsum(area(triangles))
    face = np.searchsorted(covered[:-1], cube[:, 0] * covered[-1], side="right")
    root, split = np.sqrt(cube[:, 1]), cube[:, 2]
    weights = np.stack((1 - root, root * (1 - split), root * split), axis=1)
    return np.einsum("nk,nkd->nd", weights, triangles[face])


def _one_way(source: np.ndarray, target: np.ndarray, cube: np.ndarray):
    """Return the mean and the maximum distance [m] of points of source to target."""
    points = points_on(source, cube)
    corners = np.unique(source.reshape(-1, 3), axis=0)
    distance = _distance(np.concatenate((points, corners)), target)
    return float(np.mean(distance[: len(points)])), float(np.max(distance))


def _distance(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the exact distances (N,) [m] of points (N, 3) to the surface (M, 3, 3).

    Only triangles whose bounding sphere is nearer than the nearest centroid can hold
    the nearest point.  trimesh's `closest_point` has absolute tolerances (2e-14 on m^4)
    that misplace points on triangles below a millimetre, so each is scaled to size one.
    """
    from scipy.spatial.distance import cdist
    from trimesh.triangles import closest_point

    centroids = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - centroids[:, None], axis=2).max(axis=1)
    distance = np.full(len(points), np.inf)
    step = max(1, PAIRS_AT_ONCE // len(triangles))
    for start in range(0, len(points), step):
        reach = cdist(points[start : start + step], centroids)
        point, face = np.nonzero(reach - radii <= reach.min(axis=1, keepdims=True))
        point += start
        local = (triangles[face] - points[point, None]) / radii[face, None, None]
        gaps = closest_point(local, np.zeros((len(face), 3))) * radii[face, None]
        np.minimum.at(distance, point, np.linalg.norm(gaps, axis=1))
    return distance


def triangles_of(mesh: Trimesh, where: str) -> np.ndarray:
    """Return the triangles (M, 3, 3) [m] that have an area, or raise TactileError."""
    from trimesh.triangles import area

    triangles = as_floats(getattr(mesh, "triangles", np.empty((0, 3, 3))))
    if not np.all(np.isfinite(triangles)) or not np.any(area(triangles) > 0):
        expected, got = "a finite trimesh.Trimesh with an area", type(mesh).__name__
        next = "pass the mesh in the world frame, such as estimate.mesh()"
        raise TactileError(
            "unusable", where=where, expected=expected, got=got, next=next
        )
    return triangles[area(triangles) > 0]


def generator_of(samples: int, seed: int) -> np.random.Generator:
    """Return the seeded generator, or raise OptionError."""
    check_whole("samples", samples, 1, np.inf)
    check_whole("seed", seed, 0, np.inf)
    return np.random.default_rng(seed)
