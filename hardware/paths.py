"""Compute joint paths (n, 3) [rad]: to the start of an action, and back."""

from __future__ import annotations

import numpy as np

from tactilenlp.geometry.interpolation import path_of

from .errors import LimitError
from .kinematics import FAR, Finger

PEAK = 1.875  # [1], peak by mean speed of a minimum-jerk motion


def tip_paths(
    trajectory, fingers: int, longest: float, control: float
) -> tuple[list[np.ndarray | None], float]:
    """Return the paths (n, 3) [m] of all tips at `control` [Hz], and the duration [s].

    None stands for the path of a parked finger.  Raises LimitError.
    """
    given = trajectory, fingers, longest, FAR, LimitError
    path, duration, parked = path_of(*given)
    rows = path(np.linspace(0, duration, max(round(duration * control), 2) + 1))
    return [None if parked[k] else rows[:, k] for k in range(fingers)], duration


def way_there(
    geometry: Finger, here: np.ndarray, goal: np.ndarray, steps: int
) -> np.ndarray:
    """Return a minimum-jerk path between joint angles (3,), straight in joint space.

    A finger hangs from its base: a sideways motion lowers the tip in the middle.  Where
    the tip would be below the straight line between both ends, it is raised.
    """
    s = np.linspace(0, 1, steps)[:, None]
    smooth = s**3 * (10 - 15 * s + 6 * s**2)
    path = here + smooth * (goal - here)
    p_wf = geometry.forward(path)
    height = p_wf[0, 2] + smooth[:, 0] * (p_wf[-1, 2] - p_wf[0, 2])
    low = p_wf[:, 2] < height
    p_wf[low, 2] = height[low]
    path[low] = geometry.inverse(p_wf[low])
    return path


def way_back(path: np.ndarray, here: np.ndarray) -> np.ndarray:
    """Return the path from the present angles of a finger back to its start, reversed.

    It begins at the measured angles: a finger that an object stopped pushes no more.
    """
    left = np.linspace(1, 0, len(path))[:, None]
    return path[::-1] + left * (here - path[-1])


def row_of(path: np.ndarray, row: float) -> np.ndarray:
    """Return a row (3,) between two rows of a path, not beyond its ends."""
    row = min(max(row, 0.0), len(path) - 1.0)
    low = min(int(row), len(path) - 2)
    return path[low] + (row - low) * (path[low + 1] - path[low])
