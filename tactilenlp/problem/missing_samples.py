"""Tell where a finger may have pushed although its sample is missing.

Where `valid` is False nothing was felt, but the position is known.  A run of missing
samples of a finger, within one action, may hold a contact if the finger felt contact
right before or after it, or if it moved by more than LONG_WAY in between: an unseen
touch may begin and end there.  A finger that stands still takes no part, nor does one
that never measures anything.
"""

from __future__ import annotations

import numpy as np

from .fingertips import finger_poses
from .window import Samples

LONG_WAY = (
    10e-3  # [m] of a finger in a run, in which it may meet an object and leave it
)


def possible_contact(data) -> np.ndarray:
    """Tell where a finger felt contact, or nothing is known beside such samples (T, F).

    Samples that were not measured may have been contact where the last one before them,
    or the next one after them, was.
    """
    felt, action = data.contact & data.valid, data.action[:, None]
    before = _last(data.valid, felt, action)
    after = _last(data.valid[::-1], felt[::-1], action[::-1])[::-1]
    return felt | before | after


def unseen_contact(data) -> np.ndarray:
    """Tell which missing samples may hide a contact (T, F)."""
    if data.valid.all():
        return np.zeros_like(data.valid)
    hidden = possible_contact(data) | _travels(data)
    return ~data.valid & hidden & data.valid.any(axis=0)


def hidden_samples(data, scene, pose) -> Samples:
    """Return the missing samples that may hide a contact, as those that were measured.

    Their normals are those that the finger felt last in the action, or next.
    """
    sample, finger = np.nonzero(unseen_contact(data))
    return Samples(
        sample, finger, pose[sample], finger_poses(data, scene)[sample, finger],
        data.finger_radius[finger], last_felt_normal(data, sample, finger),
        np.zeros(len(sample)),
    )  # fmt: skip


def _last(valid, felt, action) -> np.ndarray:
    """Tell whether the last valid sample, of the same action, was felt (T, F)."""
    t = np.arange(len(valid))[:, None]
    last = np.maximum.accumulate(np.where(valid, t, 0), axis=0)
    same = np.take_along_axis(np.broadcast_to(action, valid.shape), last, 0) == action
    return same & np.take_along_axis(felt, last, 0)


def _travels(data) -> np.ndarray:
    """Tell which missing samples belong to runs in which their finger moves far (T, F).

    Its way counts from the last sample before the run to the first one after it.
    """
    goes_on = np.r_[False, data.action[1:] == data.action[:-1]][:, None]
    way = np.linalg.norm(np.diff(data.finger_position, axis=0, prepend=0), axis=2)
    way = np.where(goes_on, way, 0.0)
    lost = ~data.valid
    found = np.zeros_like(lost)
    for f in range(data.fingers):
        begins = lost[:, f] & np.r_[True, data.valid[:-1, f] | ~goes_on[1:, 0]]
        for first in np.flatnonzero(begins):
            ends = np.flatnonzero(data.valid[first:, f] | ~goes_on[first:, 0])
            ends = ends[ends > 0]
            end = first + ends[0] if len(ends) else len(lost)
            inside = way[first : min(end + 1, len(way)), f]
            found[first:end, f] = inside.sum() > LONG_WAY
    return found


def last_felt_normal(data, sample, finger) -> np.ndarray:
    """Return the normal that each finger felt last in the action, or next (n, 3).

    Zero where it felt none.
    """
    felt, out = data.contact & data.valid, np.zeros((len(sample), 3))
    for i, (t, f) in enumerate(zip(sample, finger, strict=True)):
        rows = np.flatnonzero(felt[:, f] & (data.action == data.action[t]))
        if len(rows):
            before = rows[rows < t]
            nearest = before[-1] if len(before) else rows[0]
            out[i] = data.normal[nearest, f]
    return out
