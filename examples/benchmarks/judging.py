"""What benchmarks share that judge estimates by the truth."""

from time import process_time

import numpy as np
from trimesh import Trimesh
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp import solve_estimate
from tactilenlp.errors import TactileError
from tactilenlp.geometry.transforms import rotation_of


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


def placed(mesh: Trimesh, position, quaternion) -> Trimesh:
    """Move a mesh from the body's frame to a pose in the world; return it."""
    pose = translation_matrix(position) @ quaternion_matrix(quaternion)
    return mesh.apply_transform(pose)


def planar_path(position, quaternion) -> np.ndarray:
    """Return the planar poses (3, T) [m, m, rad] of a body that stays upright."""
    yaw = np.unwrap(rotation_of(quaternion).as_euler("zyx")[:, 0])
    return np.vstack([position[:, :2].T, yaw])
