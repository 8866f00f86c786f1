"""Sweep the workspace with one finger, in short pieces, until something is touched.

Touch an object first: aim at where it may be, else sweep until it is met.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..data.measurements import Measurements
from ..errors import NoContactError, OptionError
from .action_space import TRAJECTORY_RATE, Trajectory, Workspace

APART = 0.03  # [m] between lines: a finger of 1 cm radius then meets all above 1 cm
PIECE = 0.05  # [m] of one motion: what is met is not pushed further
LIFT = 0.005  # [m] of the fingertip above its least height
log = logging.getLogger("tactilenlp")
LEVEL = 0.02  # [m] above the ground, aimed at where no estimate says more


def sweep(space: Workspace, centre=None) -> Iterator[Trajectory]:
    """Yield motions of the first finger along lines through the workspace.

    centre (3,) [m]: of a square of twice the radius; the other fingers wait outside.
    """
    ground = space.ground
    centre = np.zeros(3) if centre is None else np.asarray(centre, float)
    middle = centre if ground is None else ground.to_ground(centre)
    height = middle[2]
    if ground is not None:
        height = space.finger_radius + space.clearance + LIFT
    pieces = int(np.ceil(2 * space.radius / PIECE))
    ends = np.linspace(-space.radius, space.radius, pieces + 1)
    n = round(space.duration * TRAJECTORY_RATE) + 1
    share = np.linspace(0, 1, n)[:, None]
    for line, y in enumerate(_lines(space.radius)):
        along = ends if line % 2 == 0 else ends[::-1]
        for a, b in pairwise(along):
            x = a + (b - a) * share
            way = np.hstack([middle[0] + x, np.full_like(x, middle[1] + y)])
            way = np.hstack([way, np.full_like(x, height)])
            position = np.repeat(way[:, None], space.fingers, axis=1)
            for f in range(1, space.fingers):
                angle = 2 * np.pi * f / space.fingers
                away = 3 * space.radius * np.r_[np.cos(angle), np.sin(angle), 0.5]
                position[:, f] = middle + away
            if ground is not None:
                position = ground.from_ground(position)
            yield Trajectory(share[:, 0] * space.duration, position)


def _lines(radius: float) -> list[float]:
    """Return the offsets [m] of the lines, the middle one first, then outwards."""
    count = int(np.ceil(radius / APART))
    offsets = np.linspace(-radius, radius, 2 * count + 1)
    return sorted(offsets, key=abs)


def first_touch(world, space: Workspace, centre, rng):
    """Return action, data and trajectories of a first touch: one finger, or a sweep."""
    alone, told = tuple(f == 0 for f in range(space.fingers)), []
    if centre is not None:
        centre = checked_centre(centre)
        action = space.random(rng, alone)
        told.append(action.trajectory(centre))
        data = world.execute(told[-1])
        if touched(data):
            return action, data, tuple(told)
        log.warning("the first finger met nothing: the workspace is swept")
    for trajectory in sweep(space, centre):
        told.append(trajectory)
        data = world.execute(trajectory)
        if touched(data):
            return None, data, tuple(told)
    raise NoContactError(
        "nothing was touched",
        where="explore",
        got=f"a sweep of {2 * space.radius:.2g} m without contact",
        expected="an object in the workspace",
        next="give centre=(x, y), where the object may be",
    )


def checked_centre(centre) -> np.ndarray:
    """Return where a first finger aims, (3,) [m]."""
    try:
        place = np.array(centre, float)
    except (TypeError, ValueError):
        place = np.array(np.nan)
    if place.shape in ((2,), (3,)) and np.isfinite(place).all():
        return np.r_[place, LEVEL][:3]
    raise OptionError(
        "no place", where="centre", got=repr(centre)[:80],
        expected="(2,) or (3,) finite numbers [m]",
    )  # fmt: skip


def touched(data: Measurements) -> bool:
    """Tell whether contact was felt for two samples in a row: no flipped boolean."""
    felt = data.contact & data.valid
    return bool((felt[1:] & felt[:-1]).any())
