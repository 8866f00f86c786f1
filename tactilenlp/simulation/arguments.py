"""Check the arguments of a World and its trajectories; convert them to arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..common.validation import as_floats
from ..errors import OptionError, SceneError, shortened
from ..geometry.convex_hull import centroid
from ..geometry.transforms import rotation_of

MAX_SIDE = 5.0  # [m] of a box: larger values are most likely millimetres
MAX_DEPTH = 1e-5  # [m] below the ground at first: from deeper, the body jumps up
LONGEST_ACTION = 600.0  # [s] of an action: 2.4 million steps
LONGEST_REST = 30.0  # [s] before the first action: 120 000 steps, computed at once
PARKED_MOTION = 1e-9  # [m] a finger whose path is shorter is parked
ARGUMENT_RULES = {  # unit with lower bound; length: -1 a number, None any
    "side_lengths": ("m > 0", 3),
    "finger_radius": ("m > 0", None),
    "mass": ("kg > 0", -1),
    "friction_ground": (">= 0", -1),
    "friction_finger": (">= 0", -1),
    "ground": ("m", -1),
    "gravity": ("m/s^2 >= 0", -1),
    "max_force": ("N > 0", -1),
    "contact_force": ("N >= 0", -1),
    "settle": ("s >= 0", -1),
    "rate": ("Hz > 0", -1),
    "restitution": (">= 0", -1),
}


def path_of(trajectory, F: int) -> tuple[Callable, float, np.ndarray]:
    """Return finger positions as a function of time, duration [s], parked fingers (F,).

    Raises OptionError for a malformed trajectory.
    """
    from scipy.interpolate import PchipInterpolator

    time = as_floats(getattr(trajectory, "time", None))
    position = as_floats(getattr(trajectory, "finger_position", None))
    good = time.ndim == 1 and len(time) > 1 and np.isfinite(time).all()
    if not (good and (np.diff(time) > 0).all()):
        expected = "(n,) [s], finite, increasing, n >= 2"
        raise world_error("time", expected, f"shape {time.shape}", kind=OptionError)
    if time[-1] - time[0] > LONGEST_ACTION:
        got = f"{time[-1] - time[0]:g} s"
        raise world_error(
            "time", f"at most {LONGEST_ACTION:g} s", got, kind=OptionError
        )
    if position.shape != (len(time), F, 3) or not np.isfinite(position).all():
        expected, got = f"{(len(time), F, 3)} [m], finite", f"shape {position.shape}"
        raise world_error("finger_position", expected, got, kind=OptionError)
    parked = np.ptp(position, axis=0).max(axis=1) < PARKED_MOTION
    return PchipInterpolator(time - time[0], position), time[-1] - time[0], parked


def pose_of(position, quaternion, corners: np.ndarray, ground: float | None):
    """Return the pose (7,) of a body whose corners (V, 3) [m] are above the ground."""
    quaternion = checked_argument("quaternion", quaternion, "unit length", 4)
    if not np.isclose(np.linalg.norm(quaternion), 1, atol=1e-6):
        raise world_error("quaternion", "unit length", quaternion, "the order is wxyz")
    R_wo = rotation_of(quaternion).as_matrix()
    lowest = (corners @ R_wo.T)[:, 2].min()
    position = checked_argument("position", position, "m", None)
    if len(position) == 2 and ground is not None:
        position = np.append(position, ground - lowest)
    if len(position) != 3:
        raise world_error("position", "(3,) [m], or (2,) with a ground", position)
    if ground is not None and position[2] + lowest < ground - MAX_DEPTH:
        fix = "give two coordinates to set the body down on the ground"
        raise world_error("position", "a body above the ground", position, fix)
    return np.concatenate([position, quaternion / np.linalg.norm(quaternion)])


def centred_hull(vertices) -> np.ndarray:
    """Return the vertices of the convex hull (V, 3) [m] about its centroid."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        points = as_floats(getattr(vertices, "vertices", vertices))
        hull = ConvexHull(points.reshape(len(points), 3))
    except (QhullError, TypeError, ValueError) as bad:
        expected, fix = "(V, 3) [m] with a volume", "give corners of a convex body"
        raise world_error("vertices", expected, vertices, fix) from bad
    return points[np.sort(hull.vertices)] - centroid(points)


def checked_argument(name: str, value, unit: str, length: int | None = -1):
    """Return a finite number or array (length,), above the zero that the unit names."""
    low = {"> 0": np.finfo(float).tiny, "= 0": 0.0}.get(unit[-3:], -np.inf)
    array = as_floats(value)
    array = np.atleast_1d(array) if length is None else array
    shape = () if length == -1 else (length or max(array.size, 1),)
    if array.shape != shape or not (np.isfinite(array) & (array >= low)).all():
        raise world_error(name, f"finite, shape {shape}, [{unit}]", value)
    if name == "side_lengths" and array.max() > MAX_SIDE:
        raise world_error(
            name, f"at most {MAX_SIDE} m", value, "divide by 1000 if in mm"
        )
    if name == "settle" and array > LONGEST_REST:
        raise world_error(name, f"at most {LONGEST_REST:g} s", value)
    return array if shape else float(array)


def world_error(
    where: str, expected: str, got: object, next: str = "", kind=SceneError
):
    got = shortened(got, str, 80)
    parts = {"where": where, "expected": expected, "got": got, "next": next}
    return kind("cannot be simulated", **parts)
