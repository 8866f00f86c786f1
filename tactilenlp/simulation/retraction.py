"""Plan how fingers leave an object: out along the normal, then back as they came."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .mujoco_plant import TIME_STEP

BACK_OFF, BACK_OFF_TIME = 0.008, 0.2  # [m], [s] first, out along the contact normal
RETURN_TIME = 0.4  # [s] back the way it came
STILL = 1e-9  # [m] a finger that is to move less than this is parked


def retraction(
    here: np.ndarray, normal: np.ndarray, path: Callable, duration: float, parked
) -> np.ndarray:
    """Return the references (n, F, 3) [m] out along the normal, then back on the path.

    here, normal (F, 3): where the fingers are [m], outward normals of what they touch;
    path: their positions (F, 3) [m] by time, duration [s]; parked (F,) do not move.
    The path is moved to where the finger is; the offset fades with the way left.
    """
    out = here + BACK_OFF * _smooth(BACK_OFF_TIME) * normal
    back = path(duration * (1 - _smooth(RETURN_TIME)[:, 0, 0]))
    steps = np.diff(back, axis=0, prepend=back[:1])
    way = np.linalg.norm(steps, axis=-1).cumsum(axis=0)
    left = 1 - way / np.maximum(way[-1], STILL)
    back = back + left[:, :, None] * (out[-1] - back[0])
    return np.where(parked[:, None], path(0.0), np.concatenate([out, back[1:]]))


def _smooth(duration: float) -> np.ndarray:
    """Return the minimum-jerk profile from 0 to 1 at every step, (n, 1, 1)."""
    s = np.linspace(0, 1, round(duration / TIME_STEP) + 1)
    return (s**3 * (10 - 15 * s + 6 * s**2))[:, None, None]
