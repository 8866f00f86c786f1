"""Where a body may be by its first touch: Gaussians of size and pose of boxes.

The touched point is on a face, on an edge beside it, or on the top; sides are drawn
about their prior.  Tracks start from these, or from a user's guess.
"""

from __future__ import annotations

import numpy as np

from ..data.contact_segments import first_contact, lasting_contacts
from ..geometry.transforms import rotate_planar

DRAWN = 1000  # boxes that explain the first touch; 300 miss some
SIZE_SPREAD = 15e-3  # [m] deviation of drawn sides about their prior mean
SHORTEST_SIDE, LONGEST_SIDE = 15e-3, 90e-3  # [m] sides drawn
LARGE, LARGE_DRAWN = (60e-3, 200e-3), 300  # [m] sides of large boxes, and how many
YAW = 0.15  # [rad] deviation of a face from the normal felt
# [-] share of draws that are touched on a face, not on an edge: with 0.7, and edges
# from 15 degrees on, 10 of 89 noisy boxes miss the best optimum known by 0.5 nats, so 6
ON_FACE = 0.5
EDGE_TURN = np.radians([8.0, 82.0])  # [rad] of a face from the normal at an edge
START_SIGMA = np.r_[6e-3, 6e-3, 4e-3, 3e-3, 3e-3, 0.15]  # [m, rad] of drawn boxes
OPEN_GAP = 3e-3  # [m] touches of one rim agree this well
BELOW_TOP = 5e-3  # [m] a side touch is at least this far below the top
TOP_TILT = 0.14  # [-] sine of the tilt (8 degrees) up to which a normal is the top's
RIM_NORMAL, RIM_SIGMAS = 0.25, 3.0  # [-], [sigma] n_z of a touch of the rim: at least


def box_states(data, shape, rng, sigma: float):
    """Return states z (6, S) and covariances P (6, 6, S) at the first touch.

    sigma [rad]: noise of the normals.  Large boxes are added to those about the prior's
    mean, since the prior of sizes has heavy tails.
    """
    mean, contact = shape.typical_size, first_contact(data)
    usual = np.clip(
        rng.normal(mean, SIZE_SPREAD, (2, DRAWN)), SHORTEST_SIDE, LONGEST_SIDE
    )
    poses = places_of(*usual, contact, rng)
    large = np.exp(rng.uniform(*np.log(LARGE), (2, LARGE_DRAWN)))
    poses = np.hstack([poses, places_of(*large, contact, rng)])
    sides = np.hstack([usual, large])
    height = np.full(sides.shape[1], body_height(data, shape, mean, sigma))
    P = np.repeat(np.diag(START_SIGMA**2)[..., None], sides.shape[1], axis=2)
    P[[0, 1], [0, 1]] *= np.maximum(1.0, sides / LONGEST_SIDE) ** 2
    return np.array([*sides, height, *poses]), P


def from_guess(guess, geometry, rng):
    """Return states and covariances about a user's guess (n + 3,): theta and pose."""
    sigma = START_SIGMA
    if not geometry.shape.faced:
        sigma = geometry.each(START_SIGMA[0], *START_SIGMA[4:])
    off = sigma[:, None] * rng.normal(size=(len(sigma), DRAWN))
    off[:, 0] = 0.0
    z = guess[:, None] + off
    z[:-3] = np.maximum(z[:-3], SHORTEST_SIDE / 2)
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

    sigma [rad]: noise of the normals, which alone may look like a rim.
    """
    felt = lasting_contacts(data)
    n_z = data.normal[..., 2]
    z = data.finger_position[..., 2] - data.finger_radius * n_z
    rim = z[felt & (n_z > max(RIM_NORMAL, RIM_SIGMAS * sigma))]
    if rim.size and np.median(np.abs(rim - np.median(rim))) < OPEN_GAP:  # else it tilts
        return float(np.clip(np.median(rim), *shape.bounds))
    side = z[felt & (np.abs(n_z) < TOP_TILT)]
    return (
        max(otherwise, np.quantile(side, 0.9) + BELOW_TOP) if side.size else otherwise
    )
