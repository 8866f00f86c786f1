"""Rauch-Tung-Striebel smoother: the paths of tracks given all samples."""

from __future__ import annotations

import numpy as np


def smoothed(records, samples: int, rows):
    """Return the smoothed states (S, n + 3, samples) of the tracks `rows` at the end.

    And the rows that these were before the first record.
    records: of tracking.tracked, one for each sample at which something changed.
    """
    last = records[-1]
    state = last.z[:, rows].T
    path = np.empty((*state.shape, samples))
    path[:, :, last.sample :] = state[..., None]
    for before, after in zip(records[-2::-1], records[:0:-1], strict=True):
        rows = rows if after.parents is None else after.parents[rows]
        P = np.moveaxis(before.P[..., rows], -1, 0)
        gain = P
        if after.slopes is not None:
            gain = P.copy()
            gain[:, :, -3:] += np.einsum("sij,kjs->sik", P, after.slopes[..., rows])
        predicted_P = np.moveaxis(after.predicted_P[..., rows], -1, 0)
        off = state - after.predicted[:, rows].T
        change = np.linalg.solve(predicted_P, off[..., None])
        state, end = before.z[:, rows].T + (gain @ change)[..., 0], state
        path[:, :, before.sample : after.sample] = state[..., None]
        within = np.arange(after.since + 1, after.sample)  # samples that were left out
        share = (within - after.since) / (after.sample - after.since)
        path[:, :, within] += (end - state)[..., None] * share
    first = records[0]
    path[:, :, : first.sample] = state[..., None]
    return path, rows if first.parents is None else first.parents[rows]
