"""Touch an object first: aim at where it may be, else sweep until it is met."""

from __future__ import annotations

import logging

import numpy as np

from .errors import NoContactError, OptionError
from .measurements import Measurements
from .sweep import sweep
from .workspace import Workspace

log = logging.getLogger("tactilenlp")

LEVEL = 0.02  # [m] above the ground, aimed at where no estimate says more


def first_touch(world, space: Workspace, centre, rng):
    """Return action, data and trajectories of a first touch: one finger, or a sweep."""
    alone, told = tuple(f == 0 for f in range(space.fingers)), []
    if centre is not None:
        centre = _checked_centre(centre)
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


def _checked_centre(centre) -> np.ndarray:
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
