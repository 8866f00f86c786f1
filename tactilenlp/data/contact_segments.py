"""Contact segments: successive touches of a finger on one plane of the body.

While a finger stays on a face its normal in the body's frame, along a path that the
body may have taken, is constant up to noise; where the mean normal changes by more than
noise explains, a new segment begins.
Touches without a similar neighbour are outliers.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from .measurements import Measurements

CONTACT_LATENCY = 5e-3  # [s] by which a contact is reported too long: sensors average
EQUAL_NORMALS = 0.005  # [rad] normals of exact sensors closer than this are equal
OUTLIER_ANGLE = 0.5  # [rad] from the normals of all neighbours: an outlier
LARGEST_GAP = 2  # samples: a flipped boolean may separate two touches
COMPARED_TOUCHES = 4  # touches on either side whose mean normals are compared
# Of one contact: on an edge the normal turns with every sample.  Contacts of actions of
# a second have 10 at most (six shared hulls).
MOST_SEGMENTS = 12
REPEATED = 0.1  # [sample intervals] sooner than this, a sample has come twice
STANDING = 0.05e-3  # [m] a finger that moves less in a sample is not approaching
NORMAL_SAMPLES = 2  # whose normals are averaged: later ones show a body that turned
NOISE_SIGMAS = 3.5  # [sigma] largest difference of means of one segment
PERIOD = 1 / 30  # [s] of tracked samples: process noise and slopes are of such steps
SIDE_NORMAL = 0.7  # [-] |n_z| below which a normal belongs to a side


def samples_until(data: Measurements, samples: int) -> Measurements:
    """Return the data of the actions, whole, to which the first samples belong."""
    return data.select(np.unique(data.action[:samples]))


def ends_of_actions(data) -> np.ndarray:
    """Return the last sample of every action."""
    return np.flatnonzero(np.diff(data.action, append=np.inf))


def intervals(data: Measurements) -> np.ndarray:
    """Return the median sample interval (T,) [s] of the action of each sample."""
    out = np.empty(len(data.time))
    for action in np.unique(data.action):
        rows = data.action == action
        out[rows] = np.median(np.diff(data.time[rows])) if rows.sum() > 1 else data.dt
    return out


def tracked_samples(data: Measurements) -> np.ndarray:
    """Return the samples that are tracked: of every action, about PERIOD apart.

    The last one of each is among them.
    """
    step, chosen = intervals(data), []
    for action in np.unique(data.action):
        rows = np.flatnonzero(data.action == action)
        stride = max(1, round(PERIOD / step[rows[0]]))
        chosen.append(rows[::-1][::stride][::-1])
    return np.concatenate(chosen)


def consecutive_contacts(data) -> np.ndarray:
    """Tell which fingers feel two consecutive samples of an action (T - 1, F)."""
    felt = data.contact
    return felt[1:] & felt[:-1] & (data.action[1:] == data.action[:-1])[:, None]


def felt_sides(data) -> np.ndarray:
    """Tell which fingers feel a side of the body (T, F); data in the ground's frame."""
    return data.contact & (np.abs(data.normal[..., 2]) < SIDE_NORMAL)


def rate_of(data, values: np.ndarray) -> np.ndarray:
    """Return how fast values (T, ...) change since the sample before, per second.

    Zero where an action begins, and for a sample that has come twice.
    """
    interval, rate = np.diff(data.time), np.zeros_like(values)
    within = data.action[1:] == data.action[:-1]
    within &= interval > REPEATED * intervals(data)[1:]
    shape = (-1, *[1] * (values.ndim - 1))
    rate[1:][within] = np.diff(values, axis=0)[within] / interval[within].reshape(shape)
    return rate


def lasting_contacts(data) -> np.ndarray:
    """Tell which contacts (T, F) have a neighbour in time, unlike a flipped boolean."""
    pair = consecutive_contacts(data)
    none = np.zeros((1, data.fingers), bool)
    return np.vstack([none, pair]) | np.vstack([pair, none])


def first_onset(data, actions=None) -> tuple[int, int]:
    """Return sample and finger of the first touch, of some actions alone if given.

    Of an action in which a touch lasts, it is the first of those.
    """
    actions = np.unique(data.action) if actions is None else actions
    pair = lasting_contacts(data), data.contact
    felt = (k & (data.action == a)[:, None] for a in actions for k in pair)
    return next(tuple(np.argwhere(k)[0].tolist()) for k in felt if k.any())


def first_contact(data, actions=None) -> tuple[np.ndarray, np.ndarray]:
    """Return the point (3,) [m] and the normal (3,) of the first touch."""
    t, f = first_onset(data, actions)
    rows = np.arange(t, min(t + NORMAL_SAMPLES, len(data.time)))
    rows = rows[data.contact[rows, f]]
    n = data.normal[rows, f].mean(axis=0)
    n /= max(np.linalg.norm(n), 1e-9)
    return data.finger_position[t, f] - data.finger_radius[f] * n, n


def without_outliers(data: Measurements, sigma: float) -> Measurements:
    """Return the data with isolated samples marked as not valid: flipped booleans.

    A touch is isolated without another touch of its finger within LARGEST_GAP samples
    that has a similar normal (noise sigma [rad]); a sample without contact is isolated
    between two touches.
    """
    felt, n = data.contact, data.normal
    limit = np.cos(min(np.pi / 2, OUTLIER_ANGLE + NOISE_SIGMAS * sigma))
    backed = np.zeros_like(felt)
    for step in range(1, LARGEST_GAP + 1):
        same = (data.action[step:] == data.action[:-step])[:, None]
        alike = (n[step:] * n[:-step]).sum(axis=2) > limit
        pair = felt[step:] & felt[:-step] & same & alike
        backed[step:] |= pair
        backed[:-step] |= pair
    wrong = felt & ~backed
    within = (data.action[2:] == data.action[:-2])[:, None] & felt[2:] & felt[:-2]
    wrong[1:-1] |= within & ~data.contact[1:-1]
    return replace(data, valid=data.valid & ~wrong)


def lone_touches(touch) -> np.ndarray:
    """Tell which touched samples have no touched neighbour in time (touches,)."""
    rows = list(zip(touch.sample.tolist(), touch.finger.tolist(), strict=True))
    felt = set(rows)
    return np.array([not felt & {(t - 1, f), (t + 1, f)} for t, f in rows])


def contact_segments(touch, sigma: float) -> np.ndarray:
    """Return the segment (touches,) of each touch, numbered from 0.

    touch: samples with contact, with normals in the body's frame along a path; sigma
    [rad]: noise of these.
    """
    order = np.lexsort((touch.sample, touch.finger))
    t, f, n = touch.sample[order], touch.finger[order], touch.normal[order]
    begins = np.ones(len(order), bool)
    begins[1:] = (f[1:] != f[:-1]) | (np.diff(t) > LARGEST_GAP)
    starts = np.nonzero(begins)[0]
    for first, last in pairwise([*starts, len(begins)]):
        begins[[first + i for i in _breaks(n[first:last], sigma)]] = True
    run = np.empty(len(order), int)
    run[order] = np.cumsum(begins) - 1
    return run


def _breaks(n, sigma: float) -> list[int]:
    """Return where in normals (k, 3) new segments begin (binary segmentation).

    The clearest changes come first, until noise explains all others.
    """
    found, parts = [], [_clearest_break(n, 0, len(n), sigma)]
    while len(found) + 1 < MOST_SEGMENTS:
        excess, i, first, last = part = max(parts)
        if excess <= 1:
            break
        parts.remove(part)
        parts += [_clearest_break(n, *ends, sigma) for ends in ((first, i), (i, last))]
        found.append(i)
    return found


def _clearest_break(n, first: int, last: int, sigma: float) -> tuple:
    """Return how clear the clearest break between touches is, where, and both ends.

    It is the difference of the mean normals before and after, over that which noise
    explains.
    """
    excess = np.zeros(last - first)
    for k in range(first + 1, last):
        before = n[max(first, k - COMPARED_TOUCHES) : k]
        after = n[k : min(last, k + COMPARED_TOUCHES)]
        doubt = NOISE_SIGMAS * sigma * np.sqrt(1 / len(before) + 1 / len(after))
        apart = np.linalg.norm(before.mean(axis=0) - after.mean(axis=0))
        excess[k - first] = apart / np.hypot(EQUAL_NORMALS, doubt)
    i = int(np.argmax(excess))
    return excess[i], first + i, first, last


def late_gap(data: Measurements) -> np.ndarray:
    """Return how far off a finger may be that is felt (T, F) [m]: one that just left.

    A boolean is a mean over some milliseconds, a position is that of an instant: a
    finger that feels nothing at the next sample may have parted before this one.
    """
    p, felt = data.finger_position, data.contact
    goes_on = (data.action[1:] == data.action[:-1])[:, None]
    leaves = felt[:-1] & ~data.contact[1:] & data.valid[1:] & goes_on
    share = np.minimum(1.0, CONTACT_LATENCY / np.diff(data.time))[:, None]
    way = share * np.linalg.norm(np.diff(p, axis=0), axis=2)
    return np.vstack([np.where(leaves, way, 0.0), np.zeros(felt.shape[1])])


def gaps_near_touches(data) -> np.ndarray:
    """Return between which gaps (n, 2) [m] free samples are by the touch next to them.

    Of a finger in an action that feels something before or after, with nothing missing
    between; the closer one, if both.  While a finger stands still, its first sample
    counts: what it felt may have left it by any distance.
    """
    ways = data.contact, data.valid, data.finger_position, data.action
    after = _gaps_after(*ways)
    before = _gaps_after(*(k[::-1] for k in ways))[::-1]
    gaps = np.where(after[..., 1:] <= before[..., 1:], after, before)
    return gaps[np.isfinite(gaps).all(axis=2)]


def _gaps_after(felt, valid, p, action) -> np.ndarray:
    """Return the gaps (T, F, 2) of free samples after a touch, infinite for others."""
    t = np.arange(len(p))[:, None]
    begins = np.r_[True, action[1:] != action[:-1]][:, None]
    touch = np.maximum.accumulate(np.where(felt & valid, t, -1))
    broken = np.maximum.accumulate(np.where(begins & ~felt | ~valid, t, -1))
    at = np.take_along_axis(p, np.maximum(touch, 0)[..., None], axis=0)
    now = np.linalg.norm(p - at, axis=2)
    before = np.vstack([np.zeros_like(now[:1]), now[:-1]])
    moves = (touch == t - 1) | (np.abs(now - before) > STANDING)
    free = valid & ~felt & (touch > broken) & moves
    gaps = np.sort(np.stack([before, now], axis=2), axis=2)
    return np.where(free[..., None], gaps, np.inf)
