"""First guess of a box from the heights of its origin: its support function.

The lowest corner of a box with half widths h is at the height

    z - sum_i h_i |R_3i|

over the ground, z that of its centre: linear in h.  It is positive in free flight, not
positive at some sample of an impact, and zero at rest.  Least absolute violations of
these (in)equalities are a linear programme: its optimum is global, and a ground that
yields in impacts does not bias it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .impacts import SURFACE, Steps, begins, steps_since

PULL = 0.02  # [samples] on each half width
LARGEST_HALF = 1.0  # [m]
SAME = 1e-3  # [m] boxes that differ less are one start
WIDEST = 2.0  # [1] of the box most like a cube: where nothing bounds a half width
DEEPEST = 20e-3  # [m] that a ground yields
REST_WEIGHT = 0.03  # [samples] of a sample at rest: many are alike
REST_DEPTH = 0.2e-3  # [m] that a ground yields below a body at rest
LEAST_HALF = 1e-3  # [m]
RELEASE = 0.08  # [s]
SETTLED = 0.1  # [s]
LOOSE = 0.5  # [g dt] a greater change of velocity than that of free fall: an impact


@dataclass(frozen=True)
class Support:
    """Half widths (3,) [m] that explain the heights equally well.

    Those most like a cube, the least and the largest.
    """

    like_cube: np.ndarray
    least: np.ndarray
    largest: np.ndarray

    def starts(self) -> list[np.ndarray]:
        """Return half widths (3,) [m] to start from."""
        largest = np.minimum(self.largest, WIDEST * self.like_cube)
        middle = (self.least + largest) / 2
        near = abs(largest - self.least).max() < SAME
        return [middle] if near else [middle, self.like_cube, largest]


def support_of(steps: Steps, gravity: float, dt: float) -> Support | None:
    """Return the boxes that fit the heights of the centre; None if nothing touches."""
    touching = phases_of(steps, gravity, dt)[0]
    if not touching.any():
        return None
    R = np.stack([steps.R_wo_1, steps.R_wo, steps.R_wo_next], axis=1)
    extent = abs(R.reshape(-1, 3, 3, 3)[..., 2])
    height = np.stack([steps.p_wo_1, steps.p_wo, steps.p_wo_next], axis=1)[..., 2]
    cube = np.full(3, max(height[touching].min(), LEAST_HALF))
    rows = _rows_of(steps, extent, height, gravity, dt)
    alike = zip(rows, (np.eye(3), cube, [PULL] * 3), strict=True)
    alike = zip([np.concatenate(pair) for pair in alike],
                (-np.eye(3), -cube, [PULL] * 3), strict=True)  # fmt: skip
    like_cube = _solved(*[np.concatenate(pair) for pair in alike], 0.0)
    return Support(like_cube, _solved(*rows, PULL), _solved(*rows, -PULL))


def with_soft_ground(steps: Steps, corners, gravity: float, dt: float) -> Steps:
    """Return steps whose corners may sink in impacts as deep as they ever do.

    corners (3, V) [m] of a box.
    """
    _, hit, _ = phases_of(steps, gravity, dt)
    lowest = steps.corners(corners.T)[:, :, 0, 2].min(axis=1)
    depth = np.clip(-lowest[hit].min(initial=0.0), SURFACE, DEEPEST)
    return replace(steps, depth=np.where(hit, depth, steps.depth))


def phases_of(steps: Steps, gravity: float, dt: float) -> tuple:
    """Return which steps (n,) touch, are of impacts or their end, and lie still."""
    pushed = np.linalg.norm(steps.dv + np.array([0, 0, gravity * dt]), axis=1)
    touching = pushed > LOOSE * gravity * dt
    calm_for = steps_since(~steps.calm | begins(steps.toss)) * dt
    still = touching & (calm_for > SETTLED)  # on a face
    return touching, _recent(touching, steps.toss, dt) & ~still, still


def tilt_at_rest(steps: Steps, gravity: float, dt: float) -> float:
    """Return how far a box is from lying on a face at rest [deg], median of tosses."""
    _, _, still = phases_of(steps, gravity, dt)
    up = abs(steps.R_wo.reshape(-1, 3, 3)[:, :, 2]).max(axis=1)
    tilt = np.degrees(np.arccos(np.minimum(up, 1.0)))
    tosses = np.unique(steps.toss[still])
    if not len(tosses):
        return 0.0
    return float(
        np.median([np.median(tilt[still & (steps.toss == k)]) for k in tosses])
    )


def _rows_of(steps, extent, height, gravity, dt) -> tuple:
    """Return A (m, 3), b (m,) and weights (m,): violations max(A h - b, 0)."""
    touching, _, still = phases_of(steps, gravity, dt)
    free, impact = ~_recent(touching, steps.toss, dt), touching & ~steps.calm
    size = height[touching].min()
    lowest = (height - size * extent.sum(axis=2)).argmin(axis=1)
    low = np.arange(len(steps)), lowest
    rest, level = extent[still, 1], height[still, 1]
    parts = [
        (extent[free].reshape(-1, 3), height[free].ravel(), 1 / 3),
        (-extent[low][impact], -height[low][impact], 1.0),
        (rest, level + REST_DEPTH, REST_WEIGHT),
        (-rest, -level + REST_DEPTH, REST_WEIGHT),
    ]
    A, b = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return A, b, np.concatenate([np.full(len(part[1]), part[2]) for part in parts])


def _solved(A, b, weight, pull: float) -> np.ndarray:
    """Return half widths (3,) of least violation, pulled to small or large ones."""
    from scipy.optimize import linprog
    from scipy.sparse import hstack, identity

    rows = hstack([A, -identity(len(b))]).tocsr()
    bounds = [(LEAST_HALF, LARGEST_HALF)] * 3 + [(0, None)] * len(b)
    return linprog(np.r_[np.full(3, pull), weight], rows, b, bounds=bounds).x[:3]


def _recent(touching, toss, dt: float) -> np.ndarray:
    """Return which steps touch or follow a touch of their toss within RELEASE.

    A body that a soft ground throws up feels no more force while it is still below.
    """
    since = steps_since(touching)
    return (since <= steps_since(begins(toss))) & (since * dt <= RELEASE)
