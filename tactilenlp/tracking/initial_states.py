"""Where a body may be by its first touch: Gaussians of sizes and pose; or by a guess.

Boxes: the touched point is on a face, on an edge beside it, or on the top; sides are
drawn about their prior.

Other shapes: the finger's centre is at the distance of its radius from the surface.  So
for each draw of theta, and of the direction in which the finger lies from the body's
axis, that point is found by bisection along a horizontal ray at the height of the
finger; the normal there and the one that was felt tell which way the body is turned.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ..data.contact_segments import (
    ends_of_actions,
    first_contact,
    first_onset,
    lasting_contacts,
)
from ..geometry.transforms import rotate_planar
from .geometry import geometry_of

DRAWN = 1000  # boxes that explain the first touch; 300 miss some
DOUBTFUL_DRAWN = 4  # [DRAWN] where the trajectory is doubtful: one in 119 ends 14 nats
#                     lower
LARGE_SHARE = 0.3  # [-] of these: large boxes besides
LARGE = np.array([4 / 3, 40 / 9])  # [mean of the prior] sides of these: 60 to 200 mm
YAW = 0.15  # [rad] deviation of a face from the normal felt
# [-] share of draws that are touched on a face, not on an edge: with 0.7, and edges
# from 15 degrees on, 10 of 89 noisy boxes miss the best optimum known by 0.5 nats, so 6
ON_FACE = 0.5
EDGE_TURN = np.radians([8.0, 82.0])  # [rad] of a face from the normal at an edge
START_SIGMA = np.r_[6e-3, 6e-3, 4e-3, 3e-3, 3e-3, 0.15]  # [m, rad] of drawn boxes
OPEN_GAP = 3e-3  # [m] touches of one rim agree this well
BELOW_TOP = 5e-3  # [m] a side touch is at least this far below the top
MOST_TOUCHES = 0.9  # [-] quantile of heights and widths: single ones may be wrong
TOP_TILT = 0.14  # [-] sine of the tilt (8 degrees) up to which a normal is the top's
RIM_NORMAL, RIM_SIGMAS = 0.25, 3.0  # [-], [sigma] n_z of a touch of the rim: at least
SHARE = 0.75  # [prior deviations] of drawn sizes about the mean: 15 mm of a cuboid
SMALLEST, LARGEST = 1 / 3, 2.0  # [mean of the prior] sizes drawn
# Of other shapes than boxes:
TRIED = 10  # draws for each that is kept, at most
SIZE_HALVINGS = 30
SLOPE = 0.3  # [-] deviation of the vertical part of a normal
SAME_HEIGHT = 2e-3  # [m] of a top and of a finger that touches it
SIGMA = 6e-3, 3e-3, 0.15  # [m, m, rad] of sizes, place, yaw of a draw


def initial_states(data, shape, rng, sigma: float, drawn: int = DRAWN):
    """Return states z (n + 3, S) and covariances (n + 3, n + 3, S) at the first touch.

    sigma [rad]: noise of the normals; drawn: how many, without large boxes.
    """
    if shape.faced:
        return box_states(data, shape, rng, sigma, drawn)
    return surface_states(data, shape, rng, drawn)


def box_states(data, shape, rng, sigma: float, drawn: int = DRAWN):
    """Return the states and covariances of boxes.

    Large boxes are added to those about the prior's mean, since the prior of sizes has
    heavy tails: up to LARGE, and to twice the extent that was felt.
    """
    mean, contact = shape.typical_size, first_contact(data)
    shortest, longest = SMALLEST * mean, LARGEST * mean
    usual = rng.normal(mean, SHARE * shape.typical_deviation, (2, drawn))
    usual = np.clip(usual, shortest, longest)
    poses = places_of(*usual, contact, rng)
    scale = max(1.0, 2 * felt_extent(data) / (mean * LARGE[1]))
    number = round(LARGE_SHARE * drawn)
    large = np.exp(rng.uniform(*np.log(scale * mean * LARGE), (2, number)))
    poses = np.hstack([poses, places_of(*large, contact, rng)])
    sides = np.hstack([usual, large])
    height = np.full(sides.shape[1], body_height(data, shape, mean, sigma))
    P = np.repeat(np.diag(START_SIGMA**2)[..., None], sides.shape[1], axis=2)
    P[[0, 1], [0, 1]] *= np.maximum(1.0, sides / longest) ** 2
    return np.array([*sides, height, *poses]), P


def felt_extent(data) -> float:
    """Return how large [m] a body is at least: how high it was felt, and how wide.

    Width: between two fingers that feel it at once.  Single touches may be wrong.
    """
    felt, point = lasting_contacts(data), _touched_points(data)
    extents = [point[felt][:, 2]]
    for f, g in combinations(range(data.fingers), 2):
        both = felt[:, f] & felt[:, g]
        across = point[both, f] - point[both, g]
        extents.append(np.linalg.norm(across[:, :2], axis=1))
    most = (float(np.quantile(v, MOST_TOUCHES)) for v in extents if v.size)
    return max(most, default=0.0)


def _touched_points(data) -> np.ndarray:
    """Return where fingers touch (T, F, 3) [m]; their centres where they do not."""
    return data.finger_position - data.finger_radius[:, None] * data.normal


def from_guess(guess, geometry, rng):
    """Return states and covariances about a user's guess (n + 3,): theta and pose."""
    sigma = START_SIGMA
    if not geometry.shape.faced:
        sigma = geometry.each(START_SIGMA[0], *START_SIGMA[4:])
    off = sigma[:, None] * rng.normal(size=(len(sigma), DRAWN))
    off[:, 0] = 0.0
    z = guess[:, None] + off
    z[:-3, 1:] = np.maximum(z[:-3, 1:], SMALLEST / 2 * geometry.shape.typical_size)
    return z, np.repeat(np.diag(sigma**2)[..., None], DRAWN, axis=2)


def mid_face_guess(data, shape, sigma: float) -> tuple:
    """Return theta (3,) and pose (3,) of a typical box, touched in mid-face."""
    p, n = first_contact(data)
    mean, top = shape.typical_size, np.linalg.norm(n[:2]) < TOP_TILT
    height = body_height(data, shape, mean, sigma)
    level = n[:2] / max(np.linalg.norm(n[:2]), 1e-9)
    place = p[:2] if top else p[:2] - mean / 2 * level
    yaw = 0.0 if top else np.arctan2(n[1], n[0])
    return np.array([mean, mean, height]), np.r_[place, yaw]


def places_of(a, b, contact, rng) -> np.ndarray:
    """Return poses (3, S) of boxes with sides a, b (S,) that explain one touch.

    contact: point and normal.  It is on the face +x, on an edge beside it, or on top.
    """
    p, n = contact
    count = len(a)
    if np.linalg.norm(n[:2]) < TOP_TILT:
        yaw = rng.uniform(0, np.pi / 2, count)
        u, v = rng.uniform(-0.5, 0.5, (2, count)) * [a, b]
    else:
        on_face = rng.random(count) < ON_FACE
        turn = np.where(
            on_face, YAW * rng.normal(size=count), rng.uniform(*EDGE_TURN, count)
        )
        yaw = np.arctan2(n[1], n[0]) + turn
        along = np.where(on_face, rng.uniform(-0.5, 0.5, count), -0.5)
        u, v = a / 2, along * b
    return np.vstack([*rotate_planar(yaw, -u, -v, origin=p), yaw])


def body_height(data, shape, otherwise: float, sigma: float) -> float:
    """Return the height [m]: of the rim if it was touched, else above all touches.

    sigma [rad]: noise of the normals, which alone may look like a rim.  A touch of the
    top alone, in the last sample of an action, is no flipped boolean.
    """
    felt = lasting_contacts(data)
    n_z, z = data.normal[..., 2], _touched_points(data)[..., 2]
    rim = z[felt & (n_z > max(RIM_NORMAL, RIM_SIGMAS * sigma))]
    if not rim.size:
        ends = ends_of_actions(data)
        rim = z[ends][data.contact[ends] & (n_z[ends] > np.sqrt(1 - TOP_TILT**2))]
    if rim.size and np.median(np.abs(rim - np.median(rim))) < OPEN_GAP:  # else it tilts
        low, high = (np.broadcast_to(b, shape.theta)[2] for b in shape.bounds)
        return float(np.clip(np.median(rim), low, high))
    side = z[felt & (np.abs(n_z) < TOP_TILT)]
    if not side.size:
        return otherwise
    return max(otherwise, np.quantile(side, MOST_TOUCHES) + BELOW_TOP)


def surface_states(data, shape, rng, drawn: int = DRAWN):
    """Return the states and covariances of bodies of any shape."""
    geometry = geometry_of(shape)
    (t, f), (_, n) = first_onset(data), first_contact(data)
    centre, radius = data.finger_position[t, f], data.finger_radius[f]
    theta = _drawn(shape, rng, TRIED * drawn)
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
    rows = rng.choice(len(weight), drawn, p=weight / weight.sum())
    P = np.diag(geometry.each(*SIGMA) ** 2)
    return z[:, rows], np.repeat(P[..., None], drawn, axis=2)


def _drawn(shape, rng, count: int) -> np.ndarray:
    """Return theta (n, count), drawn about the mean of the prior."""
    mean, deviation = (
        np.broadcast_to(v, shape.theta)[:, None] for v in shape.size_prior
    )
    low, high = (np.broadcast_to(v, shape.theta)[:, None] for v in shape.bounds)
    theta = mean + SHARE * deviation * rng.normal(size=(shape.theta, count))
    length = (mean > 0) & (low >= 0)  # an angle, say, is within its bounds alone
    low = np.where(length, np.maximum(low, SMALLEST * mean), low)
    high = np.where(length, np.minimum(high, LARGEST * mean), high)
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
