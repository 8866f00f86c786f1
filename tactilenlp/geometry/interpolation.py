"""Gaps of time series, filled on a straight line between what is known."""

from __future__ import annotations

import numpy as np


def fill_gaps(values: np.ndarray, time: np.ndarray, group: np.ndarray, gone) -> None:
    """Fill values (T, F, n) in place where they are gone (T, F), linearly in time.

    Within a group (T,), such as an action; before the first and after the last known
    value of a group that one holds, and a group without any stays as it is.
    """
    for f in np.flatnonzero(gone.any(axis=0)):
        for number in np.unique(group[gone[:, f]]):
            rows = group == number
            to, known = (np.flatnonzero(rows & b) for b in (gone[:, f], ~gone[:, f]))
            for column in values[:, f].T if len(known) else ():
                column[to] = np.interp(time[to], time[known], column[known])
