"""What sensors lose, report wrongly or are told wrongly.

Functions (strength, data, rng) -> data, which change Measurements of an ideal
recording; those of one strength only are functions (data, rng) -> data.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

BURST = 5  # samples in a row, on average, that are lost in a burst


def without(data, lost):
    """Return the data without the samples that are lost (T, F)."""
    valid = data.valid & ~lost
    normal = np.where(valid[..., None], data.normal, 0.0)
    return replace(data, valid=valid, contact=data.contact & valid, normal=normal)


def at_random(share: float, data, rng):
    """Lose a share of all fingers' samples of an instant, at random."""
    lost = rng.random(data.samples) < share
    return without(data, np.repeat(lost[:, None], data.fingers, axis=1))


def per_finger(share: float, data, rng):
    """Lose a share of each finger's samples, at random."""
    return without(data, rng.random(data.valid.shape) < share)


def in_bursts(share: float, data, rng):
    """Lose a share of each finger's samples, in bursts of BURST on average."""
    begin = share / BURST / (1 - share)
    lost, gone = np.zeros(data.valid.shape, bool), np.zeros(data.fingers, bool)
    for t in range(data.samples):
        draw = rng.random(data.fingers)
        gone = np.where(gone, draw > 1 / BURST, draw < begin)
        lost[t] = gone
    return without(data, lost)


def gap(data, rng):
    """Lose half an action of all fingers, of one action in the middle."""
    rows = np.flatnonzero(data.action == np.unique(data.action)[data.actions // 2])
    first = int(rng.integers(0, len(rows) // 2 + 1))
    lost = np.zeros(data.valid.shape, bool)
    lost[rows[first : first + len(rows) // 2]] = True
    return without(data, lost)


def dies(data, rng):
    """Lose the last finger's samples from the middle of the recording on."""
    lost = np.zeros(data.valid.shape, bool)
    lost[data.samples // 2 :, -1] = True
    return without(data, lost)


def radius(error: float, data, rng):
    """Tell a fingertip radius that is wrong by an error [m]."""
    return replace(data, finger_radius=data.finger_radius + error)


def with_normals(data, normal):
    """Return the data with other normals (T, F, 3) where contact is felt."""
    return replace(data, normal=np.where(data.contact[..., None], normal, 0.0))


def turned(deviation: float, data, rng):
    """Turn a finger's normals by one rotation; deviation of each component [deg]."""
    w = np.radians(deviation) * rng.normal(size=(data.fingers, 3))
    return _rotated(data, np.tile(w, (data.samples, 1)))


def noisy_normals(deviation: float, data, rng):
    """Turn every normal by a rotation of its own; deviation [deg] of each component."""
    w = np.radians(deviation) * rng.normal(size=(data.contact.size, 3))
    return _rotated(data, w)


def _rotated(data, w):
    """Turn the normals, in order of samples and fingers, by w (T F, 3) [rad]."""
    n = Rotation.from_rotvec(w).apply(np.array(data.normal).reshape(-1, 3))
    return with_normals(data, n.reshape(data.normal.shape))


def normals_in_steps(step: float, data, rng):
    """Round azimuth and elevation of the normals to whole steps [deg]."""
    q, (x, y, z) = np.radians(step), np.moveaxis(data.normal, -1, 0)
    a = q * np.round(np.arctan2(y, x) / q)
    e = q * np.round(np.arcsin(np.clip(z, -1, 1)) / q)
    n = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
    return with_normals(data, n)


def moved(data, change):
    """Return the data with positions changed (T, F, 3) or (F, 3) [m]."""
    return replace(data, finger_position=data.finger_position + change)


def noisy_positions(deviation: float, data, rng):
    """Add noise [m] to every position."""
    return moved(data, deviation * rng.normal(size=data.finger_position.shape))


def displaced(deviation: float, data, rng):
    """Displace each finger by a constant; deviation [m] of each coordinate."""
    return moved(data, deviation * rng.normal(size=(data.fingers, 3)))


def drifting(deviation: float, data, rng):
    """Let positions drift, a random walk of a deviation [m] in 30 samples."""
    steps = rng.normal(size=data.finger_position.shape)
    return moved(data, deviation * np.cumsum(steps, axis=0) / 30**0.5)


def spikes(deviation: float, data, rng):
    """Add an error of a deviation [m] to one in a hundred positions."""
    rows = rng.random(data.contact.shape) < 0.01
    noise = deviation * rng.normal(size=data.finger_position.shape)
    return moved(data, rows[..., None] * noise)


def positions_in_steps(step: float, data, rng):
    """Round positions to whole steps [m]."""
    rounded = step * np.round(data.finger_position / step)
    return replace(data, finger_position=rounded)


def unsteady_clock(most: float, data, rng):
    """Report times that are wrong by up to `most` [s], in order."""
    time = data.time + most * rng.uniform(-1, 1, data.samples)
    time = np.maximum.accumulate(time) + 1e-6 * np.arange(data.samples)
    return replace(data, time=time)


def late_release(samples: int, data, rng):
    """Report contact for up to so many samples after it has ended."""
    contact, normal = data.contact.copy(), data.normal.copy()
    for f in range(data.fingers):
        ends = np.flatnonzero(data.contact[:-1, f] & ~data.contact[1:, f])
        for t in ends:
            until = t + 1 + rng.integers(0, samples + 1)
            rows = np.arange(t + 1, min(until, data.samples))
            rows = rows[data.action[rows] == data.action[t]]
            contact[rows, f], normal[rows, f] = True, normal[t, f]
    return replace(data, contact=contact, normal=normal)


def chattering(share: float, data, rng):
    """Report no contact for a share of the touched samples."""
    contact = data.contact & (rng.random(data.contact.shape) >= share)
    normal = np.where(contact[..., None], data.normal, 0.0)
    return replace(data, contact=contact, normal=normal)


def false_touches(share: float, data, rng):
    """Report contact with any normal in a share of the samples without one."""
    hit = ~data.contact & data.valid & (rng.random(data.contact.shape) < share)
    normal = np.where(hit[..., None], _anywhere(data, rng), data.normal)
    return replace(data, contact=data.contact | hit, normal=normal)


def wrong_normals(share: float, data, rng):
    """Report any normal in a share of the touched samples."""
    hit = rng.random(data.contact.shape) < share
    normal = np.where(hit[..., None], _anywhere(data, rng), data.normal)
    return with_normals(data, normal)


def _anywhere(data, rng) -> np.ndarray:
    """Return unit normals (T, F, 3) of every direction alike."""
    n = rng.normal(size=data.normal.shape)
    return n / np.linalg.norm(n, axis=-1, keepdims=True)


def repeating(share: float, data, rng):
    """Repeat all that a finger reported, in bursts of BURST samples on average."""
    lost = ~in_bursts(share, data, rng).valid & data.valid
    lost[np.r_[True, np.diff(data.action) != 0]] = False
    row = np.where(lost, 0, np.arange(data.samples)[:, None])
    row, finger = np.maximum.accumulate(row), np.arange(data.fingers)
    names = "finger_position", "contact", "normal", "valid"
    old = {name: getattr(data, name)[row, finger] for name in names}
    return replace(data, **old)
