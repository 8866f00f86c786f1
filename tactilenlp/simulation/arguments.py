"""Check the arguments of a World; convert them to arrays."""

from __future__ import annotations

import numpy as np

from ..common.validation import as_floats, checked_unit, numbers_of
from ..data.measurements import UNIT_TOLERANCE
from ..errors import SceneError, shortened
from ..geometry.convex_hull import centroid
from ..geometry.transforms import rotation_of
from .mujoco_plant import MAX_RESTITUTION, TIME_STEP

MAX_SIDE = 5.0  # [m] of a box: larger values are most likely millimetres
MAX_DEPTH = 1e-5  # [m] below the ground at first: from deeper, the body jumps up
LONGEST_REST = 30.0  # [s] before the first action: 120 000 steps, computed at once
ABOVE_ZERO = np.finfo(float).tiny  # the least number that MuJoCo can divide by
WORLD_NUMBERS = {  # in words, the least and the most
    "mass": ("a mass above 0 kg", ABOVE_ZERO, np.inf),
    "friction_ground": ("a coefficient of 0 or more", 0.0, np.inf),
    "friction_finger": ("a coefficient of 0 or more", 0.0, np.inf),
    "gravity": ("an acceleration of 0 m/s^2 or more", 0.0, np.inf),
    "max_force": ("a force above 0 N", ABOVE_ZERO, np.inf),
    "contact_force": ("a force of 0 N or more", 0.0, np.inf),
    "settle": (
        f"a time of 0 s or more, at most {LONGEST_REST:g} s", 0.0, LONGEST_REST,
    ),
    "rate": (
        f"above 0 Hz, at most {1 / TIME_STEP:.0f} Hz, one sample a step of the solver",
        ABOVE_ZERO, 1 / TIME_STEP,
    ),
    "restitution": (
        f"a coefficient of 0 or more, at most {MAX_RESTITUTION}", 0.0, MAX_RESTITUTION,
    ),
}  # fmt: skip


def pose_of(position, quaternion, corners: np.ndarray, ground: float | None):
    """Return the pose (7,) of a body whose corners (V, 3) [m] are above the ground."""
    quaternion = checked_unit(
        "quaternion", quaternion, 4, UNIT_TOLERANCE, SceneError, "the order is wxyz"
    )
    R_wo = rotation_of(quaternion).as_matrix()
    lowest = (corners @ R_wo.T)[:, 2].min()
    position = numbers_of(
        "position", position, SceneError, "2 or 3", unit="[m]", finite=True
    )
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


def checked_lengths(name: str, value, count: int | None = None) -> np.ndarray:
    """Return lengths (count,) [m] above 0, as many as given for None; or SceneError."""
    lengths = np.atleast_1d(as_floats(value))
    shape = (count or max(lengths.size, 1),)
    if lengths.shape != shape or not ((lengths > 0) & (lengths <= MAX_SIDE)).all():
        expected = f"shape {shape}, above 0, at most {MAX_SIDE} m"
        raise world_error(name, expected, value, "divide by 1000 if in mm")
    return lengths


def world_error(where: str, expected: str, got: object, next: str = "") -> SceneError:
    """Return the error of an argument."""
    return SceneError(
        "cannot be simulated", where=where, expected=expected,
        got=shortened(got, str, 80), next=next,
    )  # fmt: skip
