"""Where a body may be by its first touch: Gaussians of size and pose of boxes.

The touched point is on a face, on an edge beside it, or on the top; sides are drawn
about their prior.  Tracks start from these, or from a user's guess.

A box may also be carried between two actions, where nothing is recorded: the prior of
that motion is a Cauchy density (formulations/between_actions.py).  Tracks stay where
they are.  Where an action costs them more than to be carried would, it is tracked also
from where its own first touch may be, with the sizes of the tracks; if that explains it
better, all actions are.  Soft fingertips, which tracks take for rigid, cost as much as
a body that was carried: the action must be explained better by as much again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations.between_actions import CAUCHY, GAP

from ..data.contact_segments import lasting_contacts
from .tracking import between_actions, tracked
from .tracks import KalmanFilter, Tracks

DRAWN = 1000  # boxes that explain the first touch; 300 miss some
SIZE_SPREAD = 15e-3  # [m] deviation of drawn sides about their prior mean
SMALLEST, LARGEST = 15e-3, 90e-3  # [m] sides drawn
LARGE, LARGE_DRAWN = (60e-3, 200e-3), 300  # [m] sides of large boxes, and how many
YAW = 0.15  # [rad] deviation of a face from the normal felt
# [-] share of draws that are touched on a face, not on an edge: with 0.7, and edges
# from 15 degrees on, 10 of 89 noisy boxes miss the best optimum known by 0.5 nats, so 6
ON_FACE = 0.5
EDGE_TURN = np.radians([8.0, 82.0])  # [rad] of a face from the normal at an edge
NORMAL_SAMPLES = 2  # whose normals are averaged: later ones show a body that turned
START_SIGMA = np.r_[6e-3, 6e-3, 4e-3, 3e-3, 3e-3, 0.15]  # [m, rad] of drawn boxes
OPEN_GAP = 3e-3  # [m] touches of one rim agree this well
BELOW_TOP = 5e-3  # [m] a side touch is at least this far below the top
TOP_TILT = 0.14  # [-] sine of the tilt (8 degrees) up to which a normal is the top's
REACH = 0.05  # [m] a body that is carried is about so far from where it was
CARRIED = CAUCHY * np.log(1 + (REACH / GAP) ** 2)  # [nats] by the prior of the motion
FARTHEST_PLACE = 20.0  # [REACH] of a place without a touch
PLACES = 2  # of each track, one per naming of the horizontal sides
RIM_NORMAL, RIM_SIGMAS = 0.25, 3.0  # [-], [sigma] n_z of a touch of the rim: at least


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


def from_first_touch(data, shape, rng, sigma: float):
    """Return states z (6, S) and covariances P (6, 6, S) at the first touch.

    sigma [rad]: noise of the normals.  Large boxes are added to those about the prior's
    mean, since the prior of sizes has heavy tails.
    """
    mean, contact = shape.typical_size, first_contact(data)
    usual = np.clip(rng.normal(mean, SIZE_SPREAD, (2, DRAWN)), SMALLEST, LARGEST)
    poses = places_of(*usual, contact, rng)
    large = np.exp(rng.uniform(*np.log(LARGE), (2, LARGE_DRAWN)))
    poses = np.hstack([poses, places_of(*large, contact, rng)])
    sides = np.hstack([usual, large])
    height = np.full(sides.shape[1], body_height(data, shape, mean, sigma))
    P = np.repeat(np.diag(START_SIGMA**2)[..., None], sides.shape[1], axis=2)
    P[[0, 1], [0, 1]] *= np.maximum(1.0, sides / LARGEST) ** 2
    return np.array([*sides, height, *poses]), P


def from_guess(guess, geometry, rng):
    """Return states and covariances about a user's guess (n + 3,): theta and pose."""
    sigma = START_SIGMA
    if not geometry.shape.faced:
        sigma = geometry.each(START_SIGMA[0], *START_SIGMA[4:])
    off = sigma[:, None] * rng.normal(size=(len(sigma), DRAWN))
    off[:, 0] = 0.0
    z = guess[:, None] + off
    z[:-3] = np.maximum(z[:-3], SMALLEST / 2)
    return z, np.repeat(np.diag(sigma**2)[..., None], DRAWN, axis=2)


def centred(data, shape, sigma: float) -> tuple:
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
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([p[0] - c * u + s * v, p[1] - s * u - c * v, yaw])


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


def carried_away(ekf: KalmanFilter, before: Tracks, after: Tracks, samples) -> bool:
    """Tell whether an action is explained better by a body that was carried.

    before, after: the tracks without and with the samples of the action.
    """
    if before.evidence.max() - after.evidence.max() < CARRIED:
        return False
    rng = np.random.default_rng(0)
    *begun, _ = with_carried(ekf, before, ekf.data.action[samples[0]], rng)
    either, _ = tracked(ekf, before, samples, rng, begun)
    return either.evidence.max() > after.evidence.max() + CARRIED


def with_carried(ekf: KalmanFilter, tracks: Tracks, action: int, rng):
    """Return tracks at the first sample of an action, slopes of the motion, parents.

    Tracks that stayed, then those that were carried to where the first touch of the
    action may be, or anywhere if nothing was touched; slopes (3, n + 3, S): minus one
    where the place is forgotten.
    """
    n, S = len(tracks.z) - 3, tracks.z.shape[1]
    rows = np.repeat(np.arange(S), PLACES)
    theta, carried = tracks.z[:n, rows], tracks.pick(rows)
    if ekf.felt[ekf.data.action == action].any():
        swapped = np.arange(len(rows)) % PLACES == 1  # the side y was touched
        a, b = (np.where(swapped, theta[i], theta[1 - i]) for i in (1, 0))
        pose = places_of(a, b, first_contact(ekf.data, [action]), rng)
        pose[2] -= np.where(swapped, np.pi / 2, 0.0)
    else:
        away = REACH * np.clip(
            rng.standard_cauchy((2, len(rows))), -FARTHEST_PLACE, FARTHEST_PLACE
        )
        turned = rng.uniform(-np.pi, np.pi, len(rows))
        pose = carried.z[n:] + np.vstack([away, turned])
    P = carried.P.copy()
    P[n:], P[:, n:] = 0.0, 0.0
    P[n:, n:] = np.diag(START_SIGMA[3:] ** 2)[..., None]
    carried = replace(
        carried, z=np.vstack([theta, pose]), P=P, evidence=carried.evidence - CARRIED
    )
    slopes = np.zeros((3, n + 3, S + len(rows)))
    slopes[:, n:, S:] = -np.eye(3)[..., None]
    pairs = zip(vars(tracks).values(), vars(carried).values(), strict=True)
    both = Tracks(*(np.concatenate(pair, axis=-1) for pair in pairs))
    return between_actions(both, rng), slopes, np.r_[np.arange(S), rows]
