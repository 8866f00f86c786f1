"""Group the touches of a finger into runs that lie on one plane of the body.

A finger that stays on a face feels one normal, up to noise, while the body hardly
turns; where the normal changes by more than noise explains, a new run begins.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from .measurements import Measurements

SAME = 0.005  # [rad] normals of exact sensors that are one
AGREE = 0.5  # [rad] a touch that turns further from all its neighbours is a wrong one
REACH = 2  # samples: a flipped boolean may part two touches of a run
SPAN = 4  # touches on either side whose mean normals are compared
DOUBT = 3.5  # [sigma] by which means of one face differ at most


def credible(data: Measurements, sigma: float) -> Measurements:
    """Return the data less what a flipped boolean makes: samples that stand alone.

    A touch stands alone without another of its finger nearby with a normal like it,
    sigma [rad] being the normals' noise; a silence stands alone between two touches.
    """
    felt, n = data.contact & data.valid, data.normal
    limit = np.cos(min(np.pi / 2, AGREE + DOUBT * sigma))
    backed = np.zeros_like(felt)
    for step in range(1, REACH + 1):
        same = (data.action[step:] == data.action[:-step])[:, None]
        alike = (n[step:] * n[:-step]).sum(axis=2) > limit
        pair = felt[step:] & felt[:-step] & same & alike
        backed[step:] |= pair
        backed[:-step] |= pair
    wrong = felt & ~backed
    within = (data.action[2:] == data.action[:-2])[:, None] & felt[2:] & felt[:-2]
    wrong[1:-1] |= within & ~data.contact[1:-1]
    return replace(data, valid=data.valid & ~wrong)


def runs(touch, sigma: float) -> np.ndarray:
    """Return the run (touches,) of each touch, numbered from 0.

    touch: samples with contact; sigma [rad]: noise of their normals.
    """
    order = np.lexsort((touch.sample, touch.finger))
    t, f, n = touch.sample[order], touch.finger[order], touch.normal[order]
    begins = np.ones(len(order), bool)
    begins[1:] = (f[1:] != f[:-1]) | (np.diff(t) > REACH)
    starts = np.nonzero(begins)[0]
    for first, last in pairwise([*starts, len(begins)]):
        begins[_breaks(n[first:last], sigma) + first] = True
    run = np.empty(len(order), int)
    run[order] = np.cumsum(begins) - 1
    return run


def _breaks(n, sigma: float) -> np.ndarray:
    """Return where in a row of normals (k, 3) another run begins, worst break first."""
    excess = np.zeros(len(n))
    for i in range(1, len(n)):
        before, after = n[max(0, i - SPAN) : i], n[i : i + SPAN]
        doubt = DOUBT * sigma * np.sqrt(1 / len(before) + 1 / len(after))
        apart = np.linalg.norm(before.mean(axis=0) - after.mean(axis=0))
        excess[i] = apart / np.hypot(SAME, doubt)
    if excess.max(initial=0.0) <= 1:
        return np.zeros(0, int)
    i = int(np.argmax(excess))
    left, right = _breaks(n[:i], sigma), _breaks(n[i:], sigma)
    return np.r_[left, i, right + i].astype(int)
