"""Where a body of any shape may be by its first touch: Gaussians of sizes and pose.

The finger's centre is at the distance of its radius from the surface.  So for each
draw of theta, and of the direction in which the finger lies from the body's axis, that
point is found by bisection along a horizontal ray at the height of the finger; the
normal there and the one that was felt tell which way the body is turned.
"""

from __future__ import annotations

import numpy as np

from ..data.contact_segments import first_contact, first_onset
from ..geometry.transforms import rotate_planar
from .box_states import DRAWN, TOP_TILT, YAW
from .geometry import geometry_of

SHARE = 0.75  # [prior deviations] of drawn sizes about the mean: 15 mm of a cuboid
SMALLEST, LARGEST = 1 / 3, 2.0  # [mean of the prior] sizes drawn
TRIED = 10  # draws for each that is kept, at most
SIZE_HALVINGS = 30
SLOPE = 0.3  # [-] deviation of the vertical part of a normal
SAME_HEIGHT = 2e-3  # [m] of a top and of a finger that touches it
SIGMA = 6e-3, 3e-3, 0.15  # [m, m, rad] of sizes, place, yaw of a draw


def surface_states(data, shape, rng):
    """Return DRAWN states z (n + 3, S) and their covariances P at the first touch."""
    geometry = geometry_of(shape)
    (t, f), (_, n) = first_onset(data), first_contact(data)
    centre, radius = data.finger_position[t, f], data.finger_radius[f]
    theta = _drawn(shape, rng, TRIED * DRAWN)
    around, top = rng.uniform(0, 2 * np.pi, theta.shape[1]), np.hypot(*n[:2]) < TOP_TILT
    if top and not shape.rolls:
        theta = _as_high(geometry, theta, centre[2] - radius)
        z, met = _under(geometry, theta, around, centre, radius, rng)
    else:
        z, met = _beside(geometry, theta, around, centre, radius)
    _, normal = geometry.contact(z, np.array([0.0, 0.0, centre[2]]), radius)
    if top:
        z[-1] = rng.uniform(0, 2 * np.pi, len(around))
    else:
        z[-1] = np.arctan2(n[1], n[0]) - np.arctan2(normal[1], normal[0])
        z[-1] += 0.0 if shape.round else YAW * rng.normal(size=len(around))
    z[-3:-1] = centre[:2, None] - rotate_planar(z[-1], *-z[-3:-1])
    if shape.round:
        z[-1] = 0.0
    likely = np.exp(-(((normal[2] - n[2]) / SLOPE) ** 2) / 2)
    weight = np.where(met, likely, 0.0) + np.finfo(float).tiny
    rows = rng.choice(len(weight), DRAWN, p=weight / weight.sum())
    P = np.diag(geometry.each(*SIGMA) ** 2)
    return z[:, rows], np.repeat(P[..., None], DRAWN, axis=2)


def _drawn(shape, rng, count: int) -> np.ndarray:
    """Return theta (n, count), drawn about the mean of the prior."""
    mean, deviation = (
        np.broadcast_to(v, shape.theta)[:, None] for v in shape.size_prior
    )
    low, high = (np.broadcast_to(v, shape.theta)[:, None] for v in shape.bounds)
    theta = mean + SHARE * deviation * rng.normal(size=(shape.theta, count))
    low, high = np.maximum(low, SMALLEST * mean), np.minimum(high, LARGEST * mean)
    return np.clip(theta, low, high)


def _as_high(geometry, theta, height: float):
    """Return theta (n, S), its entries that make a body high such that it is `height`.

    Heights are taken to be proportional to these entries.
    """
    still = np.zeros((3, theta.shape[1]))
    now, out = geometry.height(np.vstack([theta, still])), theta.copy()
    for i, row in enumerate(theta):
        more = theta.copy()
        more[i] = 1.01 * row
        if np.abs(geometry.height(np.vstack([more, still])) - now).max() > 0:
            out[i] *= height / now
    return out


def _under(geometry, theta, around, centre, radius, rng):
    """Return states with yaw 0 whose top the finger touches, as of `_beside`."""
    way = geometry.reach(np.vstack([theta, np.zeros((3, theta.shape[1]))]))
    way = way * np.sqrt(rng.random(theta.shape[1]))  # evenly over a disc
    z = np.vstack([theta, -way * np.cos(around), -way * np.sin(around), 0 * around])
    gap, n = geometry.contact(z, np.array([0.0, 0.0, centre[2]]), radius)
    return z, (np.abs(gap) < SAME_HEIGHT) & (n[2] > 1 - SLOPE)


def _beside(geometry, theta, around, centre, radius):
    """Return states (n + 3, count) with yaw 0 that the finger touches, and which do.

    Their place is relative to the finger's centre, of which the height counts.
    """
    ahead = np.stack([np.cos(around), np.sin(around)])
    point = np.array([0.0, 0.0, centre[2]])
    top = 2 * np.linalg.norm(np.abs(theta).max(axis=1)) + radius
    low, high = np.zeros(theta.shape[1]), np.full(theta.shape[1], top)

    def state(way):
        return np.vstack([theta, -way * ahead, np.zeros_like(way)])

    met = geometry.contact(state(low), point, radius)[0] < 0
    met &= geometry.contact(state(high), point, radius)[0] > 0
    for _ in range(SIZE_HALVINGS):
        middle = (low + high) / 2
        inside = geometry.contact(state(middle), point, radius)[0] < 0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return state(low), met
