"""Compare an estimate with the ground truth of a simulated world.

No estimate and no choice of an action reads it.
"""

from __future__ import annotations

import numpy as np

SAME_INSTANT = 1e-6  # [s] largest difference of equal times


def true_mesh(world, time: float):
    """Return the true surface (trimesh.Trimesh) at a time [s], world frame, or None.

    world: has `truth` with object_position (T, 3) [m] and object_quaternion (T, 4)
    wxyz, `measurements` with their times, and side_lengths (3,) or vertices (V, 3) [m],
    as World has.  None without a truth at that time.
    """
    from trimesh.convex import convex_hull
    from trimesh.creation import box
    from trimesh.transformations import quaternion_matrix

    row = _row_of(world, time)
    if row is None:
        return None
    place = quaternion_matrix(world.truth.object_quaternion[row])
    place[:3, 3] = world.truth.object_position[row]
    if _sides(world) is not None:
        return box(_sides(world), place)
    return convex_hull(world.vertices).apply_transform(place)


def errors_of(world, estimate) -> dict[str, float]:
    """Return the errors of an estimate at its last sample, SI; empty without a truth.

    surface, surface_max [m]: exact distance, mean and largest; position [m] of the
    centroid; of two cuboids side_lengths [m], the largest, and rotation [rad], modulo
    symmetry.
    """
    from .metrics import cuboid_errors, surface_distance

    time = estimate.measurements.time[-1]
    true, row = true_mesh(world, time), _row_of(world, time)
    if true is None:
        return {}
    where = world.truth.object_position[row]
    distance = surface_distance(estimate.mesh(), true)
    errors = {"surface": distance.mean, "surface_max": distance.maximum}
    errors["position"] = float(np.linalg.norm(estimate.position[-1] - where))
    if _sides(world) is not None and estimate.shape == "cuboid":
        found = estimate.side_lengths, estimate.position[-1], estimate.quaternion[-1]
        truth = _sides(world), where, world.truth.object_quaternion[row]
        off = cuboid_errors(*found, *truth)
        errors["side_lengths"] = float(np.abs(off.side_lengths).max())
        errors["rotation"] = float(off.rotation_angle)
    return errors


def _sides(world):
    """Return the side lengths (3,) [m] of a world with a box, else None."""
    return getattr(world, "side_lengths", None)


def _row_of(world, time: float) -> int | None:
    """Return the index of the sample of a world's truth at a time, or None."""
    if getattr(world, "truth", None) is None:
        return None
    row = int(np.abs(world.measurements.time - time).argmin())
    return row if abs(world.measurements.time[row] - time) < SAME_INSTANT else None
