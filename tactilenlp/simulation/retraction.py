"""Plan the retraction of fingers: along the contact normal, then back on the path."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .mujoco_plant import TIME_STEP

BACK_OFF, BACK_OFF_TIME = 0.008, 0.2  # [m], [s] first, along the contact normal
RETURN_TIME = 0.4  # [s] then, back along the path
PARKED_MOTION = 1e-9  # [m] a finger whose path is shorter is parked


def retraction(
    here: np.ndarray, normal: np.ndarray, path: Callable, duration: float, parked
) -> np.ndarray:
    """Return the references (n, F, 3) [m] out along the normal, then back on the path.

    here: (F, 3) [m], positions of the fingers; normal: (F, 3), outward contact normals;
    path: positions (F, 3) [m] as a function of time [s] up to duration [s]; parked:
    (F,), fingers that do not move.  The offset from the path at its end decreases to
    zero along the way back.
    """
    out = here + BACK_OFF * _smooth(BACK_OFF_TIME) * normal
    back = path(duration * (1 - _smooth(RETURN_TIME)[:, 0, 0]))
    steps = np.diff(back, axis=0, prepend=back[:1])
    way = np.linalg.norm(steps, axis=-1).cumsum(axis=0)
    left = 1 - way / np.maximum(way[-1], PARKED_MOTION)
    back = back + left[:, :, None] * (out[-1] - back[0])
    return np.where(parked[:, None], path(0.0), np.concatenate([out, back[1:]]))


def _smooth(duration: float) -> np.ndarray:
    """Return the minimum-jerk profile from 0 to 1 at every step, (n, 1, 1)."""
    s = np.linspace(0, 1, round(duration / TIME_STEP) + 1)
    return (s**3 * (10 - 15 * s + 6 * s**2))[:, None, None]
