"""Interpolation in time: paths of fingers, and gaps of recorded series."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..common.validation import checked_trajectory

PARKED_MOTION = 1e-9  # [m] a finger whose path is shorter is parked


def path_of(trajectory, *limits) -> tuple[Callable, float, np.ndarray]:
    """Return finger positions as a function of time, duration [s], parked fingers (F,).

    The path is interpolated by PCHIP and begins at time 0.  limits, and errors raised:
    see checked_trajectory.
    """
    from scipy.interpolate import PchipInterpolator  # lazily: import stays light

    time, p_wf = checked_trajectory(trajectory, *limits)
    parked = np.ptp(p_wf, axis=0).max(axis=1) < PARKED_MOTION
    return PchipInterpolator(time - time[0], p_wf), float(time[-1] - time[0]), parked


def fill_gaps(values: np.ndarray, time: np.ndarray, group: np.ndarray, gone) -> None:
    """Fill values (T, F, n) in place where they are gone (T, F), linearly in time.

    Each group (T,), such as an action, is filled from its own values.  Before its first
    and after its last known value that one holds; without any, nothing is filled.
    """
    for f in np.flatnonzero(gone.any(axis=0)):
        for number in np.unique(group[gone[:, f]]):
            rows = group == number
            gaps, knots = (np.flatnonzero(rows & b) for b in (gone[:, f], ~gone[:, f]))
            for column in values[:, f].T if len(knots) else ():
                column[gaps] = np.interp(time[gaps], time[knots], column[knots])
