"""Check before the first command that a world can make the motions of a workspace."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..estimation.result import Estimate
from .action_space import Trajectory, Workspace
from .first_touch import checked_centre, sweep


def check_reach(world, space: Workspace, centre, estimate: Estimate | None) -> None:
    """Raise what `world.check(trajectory)` raises for a motion that may be asked of it.

    Checked are actions at the bounds of the angles and between, towards the last known
    position of the object or else `centre`; without either, the sweep.  A world without
    `check` is not asked.
    """
    check = getattr(world, "check", None)
    if not callable(check):
        return
    for trajectory in _extreme(space, centre, estimate):
        check(trajectory)


def _extreme(space: Workspace, centre, estimate) -> list[Trajectory]:
    """Return the motions that reach farthest."""
    if estimate is not None:
        target = estimate.position[-1]
    elif centre is not None:
        target = checked_centre(centre)
    else:
        return [*sweep(space)]
    lower, upper = space.lower[:2], space.upper[:2]  # of every finger alike
    bounds = zip(lower, (lower + upper) / 2, upper, strict=True)
    return [
        space.action(np.tile(angles, space.fingers)).trajectory(target)
        for angles in product(*bounds)
    ]
