"""Tell where a finger may have pushed although its sample is missing.

Where `valid` is False nothing was felt, but the position is known.  A run of missing
samples of a finger, within one action, may hold a contact if the finger felt contact
right before or after it, or if it moved by more than LONG_WAY in between: an unseen
touch may begin and end there.  A finger that stands still takes no part, nor does one
that never measures anything.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

LONG_WAY = 10e-3  # [m] of a finger in a run, in which it may meet and leave an object


def possible_contact(data) -> np.ndarray:
    """Tell where a finger felt contact, or nothing is known beside such samples (T, F).

    Samples that were not measured may have been contact where the last one before them,
    or the next one after them, was.
    """
    felt, action = data.contact, data.action[:, None]
    before = _last(data.valid, felt, action)
    after = _last(data.valid[::-1], felt[::-1], action[::-1])[::-1]
    return felt | before | after


def unseen_contact(data) -> np.ndarray:
    """Tell which missing samples may hide a contact (T, F)."""
    hidden = possible_contact(data) | _travels(data)
    return ~data.valid & hidden & data.valid.any(axis=0)


def _last(valid, felt, action) -> np.ndarray:
    """Tell whether the last valid sample, of the same action, was felt (T, F)."""
    t = np.arange(len(valid))[:, None]
    last = np.maximum.accumulate(np.where(valid, t, 0), axis=0)
    same = np.take_along_axis(np.broadcast_to(action, valid.shape), last, 0) == action
    return same & np.take_along_axis(felt, last, 0)


def _travels(data) -> np.ndarray:
    """Tell which missing samples belong to runs in which their finger moves far (T, F).

    A run counts with the samples right before and after it.  How far it moves is the
    range of its positions from the tenth to the ninetieth percentile, because a parked
    finger whose position is noisy moves as well.
    """
    begins = np.r_[True, data.action[1:] != data.action[:-1]]
    missing, far = ~data.valid, np.zeros_like(data.valid)
    for f in range(data.fingers):
        edge = np.r_[True, missing[1:, f] != missing[:-1, f]] | begins
        bounds = np.r_[np.flatnonzero(edge), len(missing)]
        for first, end in pairwise(bounds.tolist()):
            if not missing[first, f]:
                continue
            before = first - (not begins[first])
            after = end + (end < len(missing) and not begins[end])
            p = np.quantile(data.finger_position[before:after, f], (0.1, 0.9), axis=0)
            far[first:end, f] = np.linalg.norm(p[1] - p[0]) > LONG_WAY
    return far


def last_felt_normal(data, sample, finger) -> np.ndarray:
    """Return the normal that each finger felt last in the action, or next (n, 3).

    Zero where it felt none.
    """
    felt, out = data.contact, np.zeros((len(sample), 3))
    for i, (t, f) in enumerate(zip(sample, finger, strict=True)):
        rows = np.flatnonzero(felt[:, f] & (data.action == data.action[t]))
        if len(rows):
            nearest = rows[max(0, np.searchsorted(rows, t) - 1)]
            out[i] = data.normal[nearest, f]
    return out
