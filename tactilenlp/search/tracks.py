"""Search by tracking: hypotheses of all actions of a job, from the first touch on.

Boxes that explain the first touch are drawn and tracked (tracking.py), smoothed, and
tracked once more from their smoothed starts.  Of both passes the best track and those
that are good and far from it, as paths, are returned.
"""

from __future__ import annotations

import numpy as np

from .hypothesis import Hypothesis
from .proposals import TOP_TILT, body_height, spherical, touch_onsets
from .smoother import smoothed
from .tracking import filter_of, started, tracked

DRAWN = 1000  # boxes that explain the first touch
SIZE_SPREAD = 15e-3  # [m] deviation of drawn sides about their prior mean
SMALLEST, LARGEST = 15e-3, 90e-3  # [m] sides drawn
YAW = 0.15  # [rad] deviation of a face from the normal felt
ON_FACE = 0.7  # [-] share of draws that are touched on a face, not on an edge
EDGE_TURN = np.radians([15.0, 75.0])  # [rad] of a face from the normal at an edge
START_SIGMA = np.r_[6e-3, 6e-3, 4e-3, 3e-3, 3e-3, 0.15]  # [m, rad]
NORMAL_SAMPLES = 2  # whose normals are averaged: later ones show a body that turned
SHARP = 0.5  # [-] unused
AGAIN = 24  # tracks that run a second time, from their smoothed starts
AGAIN_SIGMA = np.r_[5e-4, 5e-4, 5e-4, 2e-3, 2e-3, 0.05]  # [m, rad]
POLISHED = 2  # paths of each pass that are solved
SMOOTHED = 60  # tracks of the first pass that are smoothed
NEAR, WORTH, BEHIND = 4e-3, 6.0, 25.0  # [m] far paths; [nats] their bonus; too far behind


def drawn(data, shape, rng, count=DRAWN):
    """Return boxes z (6, count) that explain the first touch, and where it begins."""
    touches = (touch_onsets(data, action) for action in np.unique(data.action))
    t, f = next(touch[0] for touch in touches if touch)
    rows = np.arange(t, min(t + NORMAL_SAMPLES, len(data.time)))
    rows = rows[data.contact[rows, f]]
    n = data.normal[rows, f].mean(axis=0)
    n /= max(np.linalg.norm(n), 1e-9)
    p = data.finger_position[t, f] - data.finger_radius[f] * n
    mean = shape.size_prior[0]
    a, b = np.clip(rng.normal(mean, SIZE_SPREAD, (2, count)), SMALLEST, LARGEST)
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
    h = np.full(count, body_height(data, shape, mean))
    return np.array([a, b, h, p[0] - c * u + s * v, p[1] - s * u - c * v, yaw])


def searched(job, seed=0, timing=None):
    """Return hypotheses for all actions of a job, best first of each pass."""
    import time
    began = time.process_time()
    data, window = spherical(job)
    rng = np.random.default_rng(seed)
    z = drawn(data, job.shape, rng)
    P = np.repeat(np.diag(START_SIGMA**2)[..., None], z.shape[1], axis=2)
    start = started(z, P, data.fingers, rng)
    first = _paths(filter_of(job, window, data), start, SMOOTHED, rng)
    one = time.process_time()
    again = _again(job, window, data, first, rng)
    if timing is not None:
        timing += [one - began, time.process_time() - one]
    if timing is not None:
        return [*again, *first]
    return [*distant(again, POLISHED), *distant(first, POLISHED)]


def _again(job, window, data, first, rng):
    tracks = first[:AGAIN]
    z = np.array([np.r_[h.theta, h.x[:, 0]] for h in tracks]).T
    P = np.repeat(np.diag(AGAIN_SIGMA**2)[..., None], z.shape[1], axis=2)
    filter = filter_of(job, window, data, split=False)
    return _paths(filter, started(z, P, data.fingers, rng), AGAIN, rng)


def _paths(filter, start, count, rng):
    tracks, records = tracked(filter, start, rng)
    rows = np.argsort(-tracks.evidence, kind="stable")[:count]
    paths = smoothed(records, len(filter.data.time), rows)
    return [
        Hypothesis(tracks.z[:3, i], path[3:], -tracks.evidence[i], ("track",))
        for i, path in zip(rows, paths, strict=True)
    ]


def distant(hypotheses, count: int) -> list[Hypothesis]:
    """Return the best hypothesis, then good ones whose paths are far from those."""
    corners = np.array([_path_corners(h) for h in hypotheses])
    cost = np.array([h.objective for h in hypotheses])
    chosen, apart = [int(np.argmin(cost))], np.full(len(cost), np.inf)
    while len(chosen) < min(count, len(cost)):
        way = [np.roll(corners, k, 1) - corners[chosen[-1]] for k in range(4)]
        way = np.min([np.sqrt((w**2).sum(2).mean(axis=(1, 2))) for w in way], axis=0)
        apart = np.minimum(apart, way)
        score = cost - WORTH * np.minimum(1.0, apart / NEAR)
        score[chosen] = np.inf
        i = int(np.argmin(score))
        if cost[i] > cost[chosen[0]] + BEHIND or not np.isfinite(score[i]):
            break
        chosen.append(i)
    return [hypotheses[i] for i in chosen]


def _path_corners(h):
    """Return the corners (4, 2, T) [m] along a path, in order around the box."""
    c, s = np.cos(h.x[2]), np.sin(h.x[2])
    out = []
    for i, k in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        u, v = i * h.theta[0] / 2, k * h.theta[1] / 2
        out.append([h.x[0] + c * u - s * v, h.x[1] + s * u + c * v])
    return np.array(out)
