"""Predict the motion of a body of unknown shape by quasi-static pushing.

Paths through a new action are predicted for drawn centres of mass and supports, each a
hypothesis of its own; along a path that was found, the motion of every step, for the
usual ones.  What a page then prices is the motion other than predicted
(formulations/quasi_static.py).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..data.scene import typical_friction
from ..geometry.transforms import moved_origin, rotate_planar
from ..tracking.felt_pushes import pushed_paths, pushed_steps

PATHS = 15  # paths of an action that are predicted
# What differs between these; sizes are the typical one:
CENTRE = 0.15  # [sizes] deviation of a centre of mass
NEAREST = 0.4  # [-] of the typical distance from the first touch to it; to 1 / this
BEARING = 0.7  # [rad] from the normal of the first touch, most; its deviation in costs
FOOT = 0.25, 0.9  # [sizes] half the width of the support
ONSET = 0.3, 1.0  # [-] part of a sample during which a touch that begins pushes
USUAL_FOOT = 0.5  # [sizes] half the width of the support of a body that is known


class PredictedPath(NamedTuple):
    """Poses x (3, T) of a centre of mass that is drawn, and what it costs [nats].

    off (2,) [m]: of this centre from the origin before, body frame.
    """

    x: np.ndarray
    cost: float
    off: np.ndarray | tuple = (0.0, 0.0)


def predicted_paths(job, window, faces, samples: int) -> list[PredictedPath]:
    """Return paths of `samples` poses that a body may have taken through a new action.

    The first one has it at rest.  On the ground others follow from pushes where fingers
    felt it (felt_pushes.py), for centres of mass and supports that are drawn: about the
    origin of `faces`; without any, behind the first touch.
    """
    rest, begin = resting_path(job.shape.size_prior[0], window.touch, faces, samples)
    if job.scene.ground is None:
        return [PredictedPath(rest, 0.0)]
    rng, before = np.random.default_rng(0), rest[:, :begin]
    if faces is None:
        places, costs = behind_touch(job.shape.size_prior, window.touch, rng)
        off = places - rest[:2, [begin]]
    else:
        draws = rng.normal(size=(2, PATHS))
        off, costs = CENTRE * job.shape.size_prior[0] * draws, (draws**2).sum(0) / 2
    foot = job.shape.size_prior[0] * rng.uniform(*FOOT, PATHS)
    pose = rest[:, [begin]] + np.vstack([off, np.zeros(PATHS)])
    paths = pushed_paths(
        job.data, np.arange(begin, samples), np.vstack([foot, pose]),
        rng.uniform(*ONSET, PATHS), typical_friction(job.scene),
    )  # fmt: skip
    if faces is None:
        paths = [np.hstack([np.repeat(x[:, :1], begin, 1), x]) for x in paths]
        return [PredictedPath(rest, 0.0), *map(PredictedPath, paths, costs)]
    off = np.transpose(rotate_planar(-rest[2, begin], *off))
    paths = [
        np.hstack([moved_origin(before, d), x]) for x, d in zip(paths, off, strict=True)
    ]
    return [PredictedPath(rest, 0.0), *map(PredictedPath, paths, costs, off)]


def resting_path(size: float, touch, faces, samples: int):
    """Return the path (3, samples) of a body at rest, and the sample when it begins.

    Before any touch the body is behind the first one by a typical size [m].
    """
    if faces is not None:
        known = faces.x.shape[1]
        stays = np.repeat(faces.x[:, -1:], samples - known, axis=1)
        return np.hstack([faces.x, stays]), known - 1
    x = np.zeros((3, samples))
    behind = (touch.radius[0] + size) * touch.normal[0, :2]
    x[:2] = (touch.p_wf[0, :2] - behind)[:, None]
    return x, touch.sample[0]


def behind_touch(size, touch, rng) -> tuple[np.ndarray, np.ndarray]:
    """Return places (2, PATHS) [m] of the centre of mass behind the first touch.

    Also return the cost (PATHS,) [nats] of each place.
    """
    (mean, deviation), across = size, touch.normal[0, :2]
    way = mean + deviation * rng.normal(size=PATHS)
    way = np.clip(way, mean * NEAREST, mean / NEAREST)
    bearing = rng.uniform(-BEARING, BEARING, PATHS)
    cost = ((way - mean) / deviation) ** 2 / 2 + (bearing / BEARING) ** 2 / 2
    n = across / max(np.hypot(*across), 1e-9)
    point = touch.p_wf[0, :2] - touch.radius[0] * across
    return point[:, None] - way * rotate_planar(bearing, *n), cost


def with_pushes(job, window, x, centre=(0.0, 0.0)):
    """Return a window, with the motion that pushes cause along a path x (3, T).

    centre (2,) [m]: of mass, in the body's frame.  Without a ground the window is
    returned unchanged.
    """
    if job.scene.ground is None:
        return window
    foot = USUAL_FOOT * job.shape.size_prior[0]
    of_centre = np.array([*rotate_planar(x[2], *centre, x[:2]), x[2]])
    motion = pushed_steps(job.data, of_centre, foot, typical_friction(job.scene))
    before = np.roll(x[2], 1)
    motion[:2] -= np.subtract(
        rotate_planar(before + motion[2], *centre), rotate_planar(before, *centre)
    )
    return with_motion(window, motion)


def with_motion(window, motion):
    """Return a window, with how far a body is predicted to move to each sample.

    motion (3, T) [m, m, rad], from the sample before.
    """
    step = window.step
    return replace(window, step=replace(step, motion=motion[:, step.sample].T))
