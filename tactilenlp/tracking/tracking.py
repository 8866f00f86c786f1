"""Multi-hypothesis tracking of a body with sizes through what the fingers felt.

A track is a Gaussian of sizes and planar pose.  Each sample predicts all tracks by
quasi-static pushing, with its slopes in the covariance, and corrects them by gaps and
normals (iterated extended Kalman filter); the innovations add up to the log evidence
(filter_steps.py).  Process noise is Student's t (process_noise.py).  After an action
tracks are selected and split (tracks.py).  What was recorded is smoothed backward.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..data.contact_segments import first_onset
from .filter_steps import corrections, prediction
from .process_noise import (
    ADDED_VARIANCE,
    GAP_FREEDOM,
    GAP_POSE,
    RELEASED,
    STEP_FREEDOM,
    STOP_ERROR,
    deviation,
    drawn_scales,
    way_of,
)
from .tracks import KalmanFilter, SmootherStep, Tracks, split_tracks, surviving

PASSES = 2  # of the iterated filter
STOPPED = 1e-6  # [m] in a step: a body that moves less has stopped
LONGEST_UPDATE = 8e-3, 8e-3, 0.3  # [m, m, rad] a pass: of sizes, place, yaw


def tracks_after(ekf: KalmanFilter, tracks: Tracks, samples, rng, replaced=None):
    """Return the tracks after the samples of an action, and the records.

    They are split at its end, unless it is the last one.  At the deadline it stops.
    replaced: tracks at the first sample and slopes (3, n + 3, S) of how these moved
    since the action before, by default at rest.
    """
    records, end = [], samples[-1]
    for before, t in _steps(ekf, samples):
        if ekf.deadline.left <= 0:
            break
        if replaced is None:
            tracks, slopes, moves = predicted_tracks(ekf, tracks, before, t, rng)
        else:
            (tracks, slopes), moves, replaced = replaced, True, None
        predicted, predicted_P = tracks.z, tracks.P
        tracks, corrected = _corrected(ekf, tracks, t)
        tracks, rows = _selected(ekf, tracks, t, t == end, rng)
        if moves or corrected or rows is not None:
            records.append(
                SmootherStep(
                    before, t, predicted, predicted_P, slopes, tracks.z, tracks.P, rows
                )
            )
    return tracks, records


def explaining_first_touch(ekf, tracks) -> Tracks:
    """Return tracks that were drawn to explain the first touch: it is no evidence."""
    t, _ = first_onset(ekf.data)
    evidence = _corrected(ekf, tracks, t)[0].evidence
    return replace(tracks, evidence=np.where(np.isfinite(evidence), -evidence, 0.0))


def _selected(ekf, tracks, t, ends: bool, rng):
    """Return the tracks that go on after sample t, and which rows they were, if others.

    All do before the first touch.  ends: the action, at whose end tracks are split.
    """
    if not ekf.felt[: t + 1].any():
        return tracks, None
    if ends:
        return split_tracks(ekf, tracks, t == len(ekf.felt) - 1, rng)
    rows = surviving(tracks)
    return (tracks if rows is None else tracks.pick(rows)), rows


def _steps(ekf, samples) -> list[tuple[int, int]]:
    """Return pairs of tracked samples of an action, about PERIOD apart, ends included.

    The first pair is the sample before the action and its first one.
    """
    chosen = samples[ekf.tracked[samples]]
    if chosen[0] != samples[0]:
        chosen = np.r_[samples[0], chosen]
    return list(zip(np.r_[chosen[0] - 1, chosen[:-1]], chosen, strict=True))


def predicted_tracks(ekf, tracks, before, t, rng):
    """Return tracks before sample t is seen, slopes of the motion, whether it moved.

    before: the sample that was tracked before, negative: none.
    """
    data, felt = ekf.data, ekf.felt
    if before < 0:
        return tracks, None, False
    if data.action[t] != data.action[before]:
        return between_actions(tracks, rng), None, True
    active = felt[t] | (felt[before] & data.valid[t]) | ekf.hidden[t]
    noise = drawn_scales(STEP_FREEDOM, tracks.z.shape[1], rng) * ekf.process_noise
    if not active.any():
        way = way_of(np.hypot(*tracks.motion[:2]), tracks.motion[2])
        if way.max() < STOPPED:
            return tracks, None, False
        off = noise * deviation(RELEASED, STOP_ERROR, way)
        if ekf.coasts:
            z = np.vstack([tracks.z[:-3], tracks.z[-3:] + tracks.motion])
            return _with_noise(replace(tracks, z=z), off), None, True
        tracks = replace(tracks, motion=np.zeros_like(tracks.motion))
        return _with_noise(tracks, off), None, True
    return *_after_push(ekf, tracks, before, t, np.flatnonzero(active), noise), True


def _after_push(ekf, tracks, before, t, active, noise):
    """Return tracks after a push of active fingers, slopes of motion (3, n + 3, S)."""
    p, radius = ekf.data.finger_position, ekf.data.finger_radius
    ways = np.concatenate([[*p[before, f], *p[t, f], radius[f]] for f in active])
    factors = np.vstack([*(np.full_like(noise, mu) for mu in ekf.friction), noise])
    state = tracks.z, _triangles(tracks.P), tracks.motion, tracks.press[active]
    predict = prediction(ekf.geometry.shape, len(active))
    z, P, motion, slopes = predict(*state, ways, factors)
    tracks = replace(tracks, z=z, P=_matrices(P, len(z)), motion=motion)
    return tracks, slopes.reshape(len(z), 3, -1).swapaxes(0, 1)


def between_actions(tracks, rng) -> Tracks:
    """Return tracks after the fingers retracted: at rest.

    How the retraction moved them has the density of formulations/between_actions.py:
    they stopped or went one more step on, of which these are mean and covariance.
    """
    half, z, P = tracks.motion / 2, tracks.z.copy(), tracks.P.copy()
    z[-3:] += half
    P[-3:, -3:] += half[:, None] * half[None]
    resting = replace(tracks, z=z, P=P, motion=np.zeros_like(tracks.motion))
    scale = drawn_scales(GAP_FREEDOM, tracks.z.shape[1], rng)
    return _with_noise(resting, scale * GAP_POSE)


def _with_noise(tracks, deviation) -> Tracks:
    """Return tracks with process noise on the pose, of a deviation (3, S)."""
    P = tracks.P.copy()
    for i in range(3):
        P[i - 3, i - 3] += deviation[i] ** 2 + ADDED_VARIANCE
    return replace(tracks, P=P)


def _corrected(ekf, tracks, t):
    """Return tracks corrected by sample t, and whether anything was to correct."""
    z, longest = tracks.z, ekf.geometry.each(*LONGEST_UPDATE)[:, None]
    fingers = _informative(ekf, z, t)
    for _ in range(PASSES):
        off, P, evidence, informative = tracks.z - z, _triangles(tracks.P), 0.0, False
        for felt, correct, finger in fingers:
            off, P, added, gap = correct(z, off, P, *finger)
            evidence = evidence + added[0]
            informative |= felt or (gap < 0).any()
        if not informative:
            return tracks, False
        with np.errstate(invalid="ignore"):  # slopes too steep to follow
            z = np.maximum(z + np.clip(off, -longest, longest), ekf.low)
    evidence = tracks.evidence + evidence
    evidence[~np.isfinite(evidence)] = -np.inf
    return replace(tracks, z=z, P=_matrices(P, len(z)), evidence=evidence), True


def _informative(ekf, z, t) -> list[tuple]:
    """Return corrections by fingers at or near a body: felt, function, arguments."""
    data, geometry, telling = ekf.data, ekf.geometry, []
    touch, overlap = corrections(geometry.shape)
    sigma, reach, height = np.array(ekf.noise), geometry.reach(z), None
    for f in np.flatnonzero(data.valid[t] | ekf.hidden[t]):
        p, radius = data.finger_position[t, f], data.finger_radius[f]
        sphere = p, np.array([radius])
        if ekf.felt[t, f]:
            felt = data.normal[t, f]
            across = np.linalg.svd(felt[None])[2][1:]  # two directions
            telling.append((True, touch, (*sphere, felt, across.ravel(), sigma)))
            continue
        far = (np.abs(z[-3:-1] - p[:2, None]) >= reach + radius).any(axis=0).all()
        if far or (data.contact[t, f] and not ekf.hidden[t, f]):
            continue
        height = geometry.height(z).max() if height is None else height
        if p[2] <= height + radius:
            telling.append((False, overlap, (*sphere, sigma)))
    return telling


def smoothed_states(records, samples: int, rows):
    """Return the states (S, n + 3, samples) of the tracks `rows`, given all samples.

    By the smoother of Rauch, Tung and Striebel; and the rows that these were before the
    first record.  records: one for each sample at which something changed.
    """
    last = records[-1]
    state = last.z[:, rows].T
    states = np.empty((*state.shape, samples))
    states[:, :, last.sample :] = state[..., None]
    for before, after in zip(records[-2::-1], records[:0:-1], strict=True):
        rows = rows if after.parents is None else after.parents[rows]
        P = np.moveaxis(before.P[..., rows], -1, 0)
        gain = P
        if after.slopes is not None:
            gain = P.copy()
            gain[:, :, -3:] += np.einsum("sij,kjs->sik", P, after.slopes[..., rows])
        predicted_P = np.moveaxis(after.predicted_P[..., rows], -1, 0)
        off = state - after.predicted[:, rows].T
        change = np.linalg.solve(predicted_P, off[..., None])
        state, end = before.z[:, rows].T + (gain @ change)[..., 0], state
        states[:, :, before.sample : after.sample] = state[..., None]
        within = np.arange(after.since + 1, after.sample)  # samples that were left out
        share = (within - after.since) / (after.sample - after.since)
        states[:, :, within] += (end - state)[..., None] * share
    first = records[0]
    states[:, :, : first.sample] = state[..., None]
    return states, rows if first.parents is None else first.parents[rows]


def _triangles(P) -> np.ndarray:
    """Return the upper triangles by rows of covariances (k, k, S)."""
    return P[np.triu_indices(len(P))]


def _matrices(upper, k: int) -> np.ndarray:
    """Return covariances (k, k, S) from their upper triangles by rows."""
    P, (i, j) = np.empty((k, k, upper.shape[1])), np.triu_indices(k)
    P[i, j] = P[j, i] = upper
    return P
