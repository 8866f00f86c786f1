"""What benchmarks share that judge estimates by the truth, or solve from it."""

from time import process_time

import numpy as np
from trimesh import Trimesh
from trimesh.transformations import quaternion_matrix, translation_matrix

from formulations.shape import CUBOID
from tactilenlp import Problem, solve_estimate
from tactilenlp.data.sensor_noise import precision_of, smooth_paths
from tactilenlp.errors import TactileError
from tactilenlp.geometry.faces import KNOWN_FACE, touched_faces
from tactilenlp.geometry.transforms import rotation_of
from tactilenlp.problem.reductions import (
    Reductions,
    required_reductions,
    window_of_samples,
)


def refusal(error: Exception) -> str:
    """Return what a row says of an error that ended an estimate."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:160]}"


def solved(*arguments, **options):
    """Return an estimate, None where it is refused, and its first columns.

    They are the CPU seconds and why it was refused, "" where it was not.
    """
    estimate, refused, began = None, "", process_time()
    try:
        estimate = solve_estimate(*arguments, **options)
    except TactileError as error:
        refused = refusal(error)
    return estimate, {"cpu_s": process_time() - began, "refused": refused}


def spread_samples(data, count: int) -> np.ndarray:
    """Return so many samples of a recording, evenly from the first to the last."""
    return np.unique(np.linspace(0, data.samples - 1, count).round().astype(int))


def quantile(values, q=0.5) -> float:
    """Return a quantile of what is not NaN; infinite where a failure weighs in.

    A failure is infinite among the values.
    """
    values = np.asarray(values, float)
    values = values[~np.isnan(values)]
    if not len(values):
        return np.nan
    with np.errstate(invalid="ignore"):
        found = np.quantile(values, q)
    # The interpolation beside an infinite value is NaN, at a finite one too.
    rank = np.quantile(values, q, method="higher")
    return float(rank if np.isnan(found) else found)


def placed(mesh: Trimesh, position, quaternion) -> Trimesh:
    """Move a mesh from the body's frame to a pose in the world; return it."""
    pose = translation_matrix(position) @ quaternion_matrix(quaternion)
    return mesh.apply_transform(pose)


def touched_sizes(data, quaternion) -> dict[str, bool]:
    """Return which sizes of a box are touched on both faces, or by the ground below.

    quaternion (T, 4): its true path, at least up to the last sample of the data.
    """
    faces = touched_faces(data, quaternion[: data.samples])
    faces[2, 0] += KNOWN_FACE  # the ground touches -z
    known = faces.min(axis=1) >= KNOWN_FACE
    return {f"touched_{a}": bool(k) for a, k in zip("xyz", known, strict=True)}


def planes_off(planes, mesh: Trimesh) -> np.ndarray:
    """Return by how much a true body is off supporting planes, (planes,) [m]."""
    return np.abs((mesh.vertices @ planes.normal.T).max(axis=0) - planes.offset)


def planar_path(position, quaternion) -> np.ndarray:
    """Return the planar poses (3, T) [m, m, rad] of a body that stays upright."""
    yaw = np.unwrap(rotation_of(quaternion).as_euler("zyx")[:, 0])
    return np.vstack([position[:, :2].T, yaw])


def stated(page, data, scene, theta, x):
    """Return the problem that a page states of a box, and its reduced window.

    theta (3,) [m] and x (3, T): sizes and planar poses that a solve will start from.
    """
    precision, made = precision_of(data, scene), required_reductions(page, Reductions())
    known = smooth_paths(data, precision), scene, CUBOID, precision, made
    window, problem = window_of_samples(*known, guess=(theta, x)), Problem()
    page.build(problem, window, scene, CUBOID)
    return problem, window
