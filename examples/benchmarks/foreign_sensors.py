"""What sensors lose, report wrongly or are told wrongly: functions (data, rng) -> data.

Each is made by a strength, and changes Measurements of an ideal recording.
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


def at_random(share: float):
    """Lose all fingers' samples of an instant, at random."""

    def lose(data, rng):
        lost = rng.random(data.samples) < share
        return without(data, np.repeat(lost[:, None], data.fingers, axis=1))

    return lose


def per_finger(share: float):
    """Lose each finger's samples at random."""

    def lose(data, rng):
        return without(data, rng.random(data.valid.shape) < share)

    return lose


def in_bursts(share: float):
    """Lose samples of each finger in bursts of BURST samples on average."""

    def lose(data, rng):
        begin = share / BURST / (1 - share)
        lost, gone = np.zeros(data.valid.shape, bool), np.zeros(data.fingers, bool)
        for t in range(data.samples):
            draw = rng.random(data.fingers)
            gone = np.where(gone, draw > 1 / BURST, draw < begin)
            lost[t] = gone
        return without(data, lost)

    return lose


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


def radius(error: float):
    """Tell a fingertip radius that is wrong by an error [m]."""
    return lambda data, rng: replace(data, finger_radius=data.finger_radius + error)


def with_normals(data, normal):
    """Return the data with other normals (T, F, 3) where contact is felt."""
    return replace(data, normal=np.where(data.contact[..., None], normal, 0.0))


def turned(deviation: float):
    """Turn a finger's normals by one rotation; deviation of each component [deg]."""

    def turn(data, rng):
        w = np.radians(deviation) * rng.normal(size=(data.fingers, 3))
        w = np.repeat(w[None], data.samples, axis=0).reshape(-1, 3)
        return _rotated(data, w)

    return turn


def noisy_normals(deviation: float):
    """Turn every normal by a rotation of its own; deviation [deg] of each component."""

    def turn(data, rng):
        return _rotated(
            data, np.radians(deviation) * rng.normal(size=(data.contact.size, 3))
        )

    return turn


def _rotated(data, w):
    """Turn the normals, in order of samples and fingers, by w (T F, 3) [rad]."""
    n = Rotation.from_rotvec(w).apply(np.array(data.normal).reshape(-1, 3))
    return with_normals(data, n.reshape(data.normal.shape))


def normals_in_steps(step: float):
    """Round azimuth and elevation of the normals to whole steps [deg]."""

    def round_off(data, rng):
        q, (x, y, z) = np.radians(step), np.moveaxis(data.normal, -1, 0)
        a = q * np.round(np.arctan2(y, x) / q)
        e = q * np.round(np.arcsin(np.clip(z, -1, 1)) / q)
        n = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
        return with_normals(data, n)

    return round_off


def moved(data, change):
    """Return the data with positions changed (T, F, 3) or (F, 3) [m]."""
    return replace(data, finger_position=data.finger_position + change)


def noisy_positions(deviation: float):
    """Add noise [m] to every position."""
    return lambda data, rng: moved(
        data, deviation * rng.normal(size=data.finger_position.shape)
    )


def displaced(deviation: float):
    """Displace each finger by a constant; deviation [m] of each coordinate."""
    return lambda data, rng: moved(data, deviation * rng.normal(size=(data.fingers, 3)))


def drifting(deviation: float):
    """Let positions drift, a random walk of a deviation [m] in 30 samples."""

    def drift(data, rng):
        steps = rng.normal(size=data.finger_position.shape)
        return moved(data, deviation * np.cumsum(steps, axis=0) / 30**0.5)

    return drift


def spikes(deviation: float, share: float = 0.01):
    """Add an error of a deviation [m] to a share of the positions."""

    def hit(data, rng):
        rows = rng.random(data.contact.shape) < share
        noise = deviation * rng.normal(size=data.finger_position.shape)
        return moved(data, rows[..., None] * noise)

    return hit


def positions_in_steps(step: float):
    """Round positions to whole steps [m]."""
    return lambda data, rng: replace(
        data, finger_position=step * np.round(data.finger_position / step)
    )


def unsteady_clock(most: float):
    """Report times that are wrong by up to `most` [s], in order."""

    def jitter(data, rng):
        time = data.time + most * rng.uniform(-1, 1, data.samples)
        time = np.maximum.accumulate(time) + 1e-6 * np.arange(data.samples)
        return replace(data, time=time)

    return jitter


def late_release(samples: int):
    """Report contact for up to so many samples after it has ended."""

    def stick(data, rng):
        contact, normal = data.contact.copy(), data.normal.copy()
        for f in range(data.fingers):
            ends = np.flatnonzero(data.contact[:-1, f] & ~data.contact[1:, f])
            for t in ends:
                until = t + 1 + rng.integers(0, samples + 1)
                rows = np.arange(t + 1, min(until, data.samples))
                rows = rows[data.action[rows] == data.action[t]]
                contact[rows, f], normal[rows, f] = True, normal[t, f]
        return replace(data, contact=contact, normal=normal)

    return stick


def chattering(share: float):
    """Report no contact for a share of the touched samples."""

    def miss(data, rng):
        contact = data.contact & (rng.random(data.contact.shape) >= share)
        normal = np.where(contact[..., None], data.normal, 0.0)
        return replace(data, contact=contact, normal=normal)

    return miss


def false_touches(share: float):
    """Report contact with any normal in a share of the samples without one."""

    def report(data, rng):
        hit = ~data.contact & data.valid & (rng.random(data.contact.shape) < share)
        normal = np.where(hit[..., None], _anywhere(data, rng), data.normal)
        return replace(data, contact=data.contact | hit, normal=normal)

    return report


def wrong_normals(share: float):
    """Report any normal in a share of the touched samples."""

    def report(data, rng):
        hit = rng.random(data.contact.shape) < share
        normal = np.where(hit[..., None], _anywhere(data, rng), data.normal)
        return with_normals(data, normal)

    return report


def _anywhere(data, rng) -> np.ndarray:
    """Return unit normals (T, F, 3) of every direction alike."""
    n = rng.normal(size=data.normal.shape)
    return n / np.linalg.norm(n, axis=-1, keepdims=True)


def repeating(share: float):
    """Repeat all that a finger reported, in bursts of BURST samples on average."""

    def repeat(data, rng):
        lost = ~in_bursts(share)(data, rng).valid & data.valid
        lost[np.r_[True, np.diff(data.action) != 0]] = False
        row = np.where(lost, 0, np.arange(data.samples)[:, None])
        row, finger = np.maximum.accumulate(row), np.arange(data.fingers)
        names = "finger_position", "contact", "normal", "valid"
        old = {name: getattr(data, name)[row, finger] for name in names}
        return replace(data, **old)

    return repeat
