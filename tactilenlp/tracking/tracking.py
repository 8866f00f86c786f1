"""Multi-hypothesis tracking of an upright box through what the fingers felt.

A track is a Gaussian of size and planar pose.  Each sample predicts all tracks by
quasi-static pushing (pushing.py), with its slopes in the covariance, and corrects them
by gaps and normals (iterated extended Kalman filter); the innovations add up to the
log evidence.  After an action tracks are selected and split (tracks.py).  What was
recorded is smoothed backward (smoother.py).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations.rigid_body import ARM

from .pushing import Move, pushed
from .tracks import Filter, Record, Tracks, split_tracks, surviving

PUSH_ERROR = 0.10  # [-] of a predicted motion
STOP_ERROR = 0.20  # [-] of the motion before, where fingers leave
TURN_LENGTH = np.array([1.0, 1.0, 1 / ARM])[:, None]  # [m, rad] of a way [m]
TOUCHED = np.array([1e-4, 1e-4, 5e-3])[:, None]  # [m, rad] process noise of a sample
RELEASED = np.array([5e-5, 5e-5, 2e-3])[:, None]
GAP_SIGMA_POSE = np.array([2e-4, 2e-4, 1e-2])[
    :, None
]  # [m, rad] of a gap between actions
OUTLIER = 8.0  # [nats] most that one finger costs in one sample
PASSES = 2  # of the iterated filter
PERIOD = 1 / 30  # [s] of tracked samples: process noise and slopes are of such steps
LONGEST_UPDATE = 8e-3, 8e-3, 0.3  # [m, m, rad] a pass: of sizes, place, yaw
DIFFERENCE = 1e-5, 1e-5, 5e-4  # [m, m, rad] likewise


def tracked(filter: Filter, tracks: Tracks, samples, rng, replaced=None):
    """Return the tracks after the samples of an action, and the records.

    They are split at its end, unless it is the last one.  At the deadline it stops.
    replaced: tracks at the first sample and slopes (3, n + 3, S) of how these moved
    since the action before, by default at rest.
    """
    felt = filter.felt
    records, end = [], samples[-1]
    for before, t in _steps(filter.data, samples):
        if filter.deadline.left <= 0:
            break
        if replaced is None:
            tracks, slopes, moved = predicted_tracks(filter, tracks, before, t)
        else:
            (tracks, slopes), moved, replaced = replaced, True, None
        predicted, predicted_P = tracks.z, tracks.P
        tracks, corrected = _corrected(filter, tracks, t)
        rows = None
        if felt[: t + 1].any():
            if t == end:
                tracks, rows = split_tracks(filter, tracks, t == len(felt) - 1, rng)
            elif (rows := surviving(tracks)) is not None:
                tracks = tracks.pick(rows)
        if moved or corrected or rows is not None:
            records.append(
                Record(
                    before, t, predicted, predicted_P, slopes, tracks.z, tracks.P, rows
                )
            )
    return tracks, records


def stride_of(data) -> int:
    """Return every how many samples a recording is tracked."""
    return max(1, round(PERIOD / data.dt))


def tracked_samples(data, samples) -> np.ndarray:
    """Return the samples of an action that are tracked, about PERIOD apart.

    samples: of the action; the last one is among them.
    """
    return samples[::-1][:: stride_of(data)][::-1]


def _steps(data, samples) -> list[tuple[int, int]]:
    """Return pairs of tracked samples of an action, about PERIOD apart, ends included.

    The first pair is the sample before the action and its first one.
    """
    chosen = tracked_samples(data, samples)
    if chosen[0] != samples[0]:
        chosen = np.r_[samples[0], chosen]
    return list(zip(np.r_[chosen[0] - 1, chosen[:-1]], chosen, strict=True))


def predicted_tracks(filter, tracks, before, t):
    """Return tracks before sample t is seen, slopes of the motion, whether it moved.

    before: the sample that was tracked before, negative: none.
    """
    data, felt = filter.data, filter.felt
    if before < 0:
        return tracks, None, False
    if data.action[t] != data.action[before]:
        return between_actions(tracks), None, True
    active = felt[t] | (felt[before] & data.valid[t]) | filter.hidden[t]
    way = _way(tracks.motion)
    if not active.any():
        if way.max() < 1e-6:
            return tracks, None, False
        deviation = filter.process_noise * (RELEASED + STOP_ERROR * way * TURN_LENGTH)
        if filter.coasts:
            moved = np.vstack([tracks.z[:-3], tracks.z[-3:] + tracks.motion])
            return _noisier(replace(tracks, z=moved), deviation), None, True
        tracks = replace(tracks, motion=np.zeros_like(tracks.motion))
        return _noisier(tracks, deviation), None, True
    motion, slopes = _motion(filter, tracks, before, t, np.flatnonzero(active))
    error = PUSH_ERROR * np.maximum(_way(motion), 0.5 * way)
    z, P = tracks.z.copy(), tracks.P.copy()
    z[-3:] += motion
    added = np.einsum("ijs,jks->iks", slopes, tracks.P)
    P[-3:] += added
    P[:, -3:] += added.swapaxes(0, 1)
    P[-3:, -3:] += np.einsum("ijs,kjs->iks", added, slopes)
    tracks = replace(tracks, z=z, P=P, motion=motion)
    deviation = filter.process_noise * (TOUCHED + error * TURN_LENGTH)
    return _noisier(tracks, deviation), slopes, True


def _motion(filter, tracks, before, t, active):
    """Return motion (3, S), and its slopes (3, n + 3, S) by differences."""
    p, radius = filter.data.finger_position, filter.data.finger_radius
    moves = [Move(p[before, f], p[t, f], radius[f]) for f in active]
    difference = filter.geometry.each(*DIFFERENCE)
    steps = np.hstack([np.zeros((len(difference), 1)), np.diag(difference)])
    D = pushed(
        filter.geometry,
        tracks.z[:, None] + steps[..., None], moves, tracks.press[active][:, None],
        tracks.motion[:, None], filter.friction,
    )  # fmt: skip
    slopes = (D[:, 1:] - D[:, :1]) / difference[:, None]
    return D[:, 0], slopes


def between_actions(tracks) -> Tracks:
    """Return tracks after the fingers retracted: at rest."""
    S = tracks.z.shape[1]
    return _noisier(replace(tracks, motion=np.zeros((3, S))), GAP_SIGMA_POSE)


def _noisier(tracks, deviation) -> Tracks:
    """Return tracks with process noise (3, S) on the pose."""
    P = tracks.P.copy()
    for i in range(3):
        P[i - 3, i - 3] += deviation[i] ** 2 + 1e-14
    return replace(tracks, P=P)


def _way(motion):
    """Return the way (S,) [m] of motions (3, S)."""
    return np.hypot(motion[0], motion[1]) + ARM * np.abs(motion[2])


def _corrected(filter, tracks, t):
    """Return tracks corrected by sample t, and whether anything was to correct."""
    mean, P_0 = tracks.z, tracks.P
    z, longest = mean, filter.geometry.each(*LONGEST_UPDATE)[:, None]
    for _ in range(PASSES):
        rows = _measured(filter, z, t)
        if not rows:
            return tracks, False
        with np.errstate(over="ignore", invalid="ignore"):  # slopes too steep to follow
            y, P, evidence = _updated(mean, P_0, z, rows)
        z = z + np.clip(y - z, -longest, longest)
        z = np.maximum(z, filter.low)
    evidence = tracks.evidence + evidence
    evidence[~np.isfinite(evidence)] = -np.inf
    return replace(tracks, z=z, P=P, evidence=evidence), True


def _updated(mean, P, z, rows):
    """Return mean and covariance by sequential scalar updates, linearised at z.

    rows: fingers, each a list of (residual (S,), slopes (6, S)), in deviations.
    Returns the change of log evidence, too, bounded by finger.
    """
    x, P, evidence = mean - z, P.copy(), 0.0
    for fixed, finger in rows:
        cost, spread = fixed, 0.0
        for residual, slopes in finger:
            PH = (P * slopes).sum(axis=1)
            S = 1.0 + np.maximum((slopes * PH).sum(axis=0), 0.0)  # rounding
            error = residual + (slopes * x).sum(axis=0)
            K = PH / S
            x = x - K * error
            P -= K[:, None] * PH
            cost = cost + 0.5 * error**2 / S
            spread = spread + 0.5 * np.log(S)
        evidence = evidence - np.minimum(cost, OUTLIER) - spread
    return x + z, P, evidence


def _measured(filter, z, t):
    """Return for each finger that tells something: a cost, [(residual, slopes)]."""
    data, geometry, rows = filter.data, filter.geometry, []
    for f in np.flatnonzero(data.valid[t] | filter.hidden[t]):
        p, radius = data.finger_position[t, f], data.finger_radius[f]
        if filter.felt[t, f]:
            rows.append(_touch(filter, z, p, radius, data.normal[t, f]))
        elif filter.hidden[t, f] or not data.contact[t, f]:
            reach = geometry.reach(z) + radius
            near = (np.abs(z[-3] - p[0]) < reach) & (np.abs(z[-2] - p[1]) < reach)
            if p[2] > geometry.top(z).max() + radius or not near.any():
                continue
            gap, _ = geometry.contact(z, p, radius)
            if (overlap := gap < 0).any():
                gap, _, slopes, _ = geometry.slopes(z, p, radius)
                scale = overlap / filter.noise[0]
                rows.append((0.0, [(scale * gap, scale * slopes)]))
    return rows


def _touch(filter, z, p, radius, felt):
    """Return cost and rows of a touch: its gap, and its normal across the one felt."""
    gap, n, gap_slopes, n_slopes = filter.geometry.slopes(z, p, radius)
    sigma, sigma_n = filter.noise
    across = np.linalg.svd(felt[None])[2][1:]  # two directions
    rows = [(gap / sigma, gap_slopes / sigma)]
    for e in across / sigma_n:
        rows.append((np.tensordot(e, n, 1), np.tensordot(e, n_slopes, 1)))
    along = (1.0 - np.tensordot(felt, n, 1)) / sigma_n
    return 0.5 * along**2, rows
