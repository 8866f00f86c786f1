"""What this scene does not need, dropped: from Measurements to a Window.

A Window carries plain arrays and index lists; pages never branch on data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formulations.finger import SPHERE, Finger
from formulations.rigid_body import PLANAR, Motion


@dataclass(frozen=True, eq=False)
class Samples:
    """Finger samples (M,): which sample and finger, which pose, where the finger is."""

    sample: np.ndarray
    finger: np.ndarray
    knot: np.ndarray
    p_wf: np.ndarray
    radius: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True, eq=False)
class Steps:
    """Time steps (S,) in which the object may move: poses now, before, before that."""

    sample: np.ndarray
    knot: np.ndarray
    before: np.ndarray
    before_2: np.ndarray
    dt: np.ndarray


@dataclass(frozen=True, eq=False)
class Pushes:
    """Finger contacts (P,) that may carry an impulse, each in one step."""

    sample: np.ndarray
    finger: np.ndarray
    step: np.ndarray
    knot: np.ndarray
    p_wf: np.ndarray
    p_wf_1: np.ndarray
    radius: np.ndarray
    tangent: np.ndarray


@dataclass(frozen=True, eq=False)
class Corners:
    """Ground contacts (C,), each in one step, each at one corner of the shape."""

    step: np.ndarray
    signs: np.ndarray


@dataclass(frozen=True, eq=False)
class Group:
    """Steps with the same number of pushing fingers, and which those are."""

    steps: np.ndarray
    pushes: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, eq=False)
class Window:
    """What a page sees of the data."""

    motion: Motion
    finger: Finger
    knots: int
    knot: np.ndarray
    touch: Samples
    free: Samples
    step: Steps
    gap: Steps
    push: Pushes
    corner: Corners
    steps_by_pushes: dict
    ceiling: float
    small: float


def window_of(data, scene, motion=PLANAR, merge=True, corners=()):
    contact = data.contact & data.valid
    first = np.r_[True, data.action[1:] != data.action[:-1]]
    settle = settling_samples(data, scene)
    moving = first.copy()
    start = 0
    for t in range(len(data.time)):
        if first[t]:
            start = t
        else:
            moving[t] = contact[max(start, t - settle) : t + 1].any() or not merge
    knot = np.cumsum(moving) - 1
    sample, finger = np.nonzero(data.valid)
    felt = contact[sample, finger]

    def samples(which):
        s, f = sample[which], finger[which]
        return Samples(
            s, f, knot[s], data.finger_position[s, f], data.finger_radius[f],
            data.normal[s, f],
        )

    step = np.nonzero(moving & ~first)[0]
    before = knot[step - 1]
    two = np.where(first[step - 1], step - 1, step - 2)
    gap = np.nonzero(first)[0][1:]
    index = np.full(len(data.time), -1)
    index[step] = np.arange(len(step))
    pushing = felt & (index[sample] >= 0)
    ps, pf = sample[pushing], finger[pushing]
    n = data.normal[ps, pf]
    side = np.cross([0.0, 0.0, 1.0], n)
    tangent = np.where(
        (np.abs(n[:, 2]) < 0.7)[:, None],
        side / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9),
        [1.0, 0.0, 0.0],
    )
    push = Pushes(
        ps, pf, index[ps], knot[ps], data.finger_position[ps, pf],
        data.finger_position[ps - 1, pf], data.finger_radius[pf], tangent,
    )
    signs = np.array(corners, float)
    corner = Corners(
        np.repeat(np.arange(len(step)), len(signs)), np.tile(signs, (len(step), 1))
    )
    groups = {}
    members = [np.nonzero(push.step == i)[0] for i in range(len(step))]
    counts = np.array([len(m) for m in members])
    for count in sorted(set(counts.tolist())):
        chosen = np.nonzero(counts == count)[0]
        groups[count] = Group(
            chosen,
            np.array([members[i] for i in chosen], int).reshape(len(chosen), count),
            chosen[:, None] * len(signs) + np.arange(len(signs)),
        )
    return Window(
        motion=motion,
        finger=SPHERE,
        knots=int(knot[-1]) + 1,
        knot=knot,
        touch=samples(felt),
        free=samples(~felt),
        step=Steps(step, knot[step], before, knot[two], data.time[step] - data.time[step - 1]),
        gap=Steps(gap, knot[gap], knot[gap - 1], knot[gap - 1], data.time[gap] - data.time[gap - 1]),
        push=push,
        corner=corner,
        steps_by_pushes=groups,
        ceiling=7.0,
        small=float(data.finger_radius.min()) / 10,
    )


def settling_samples(data, scene):
    """Samples a pushed object may go on sliding after the last contact."""
    return 2
