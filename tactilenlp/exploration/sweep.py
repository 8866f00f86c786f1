"""Touch an unknown object for the first time: aim at a given place, else sweep.

`check_reach` raises, before the first command, if a world cannot make the motions of a
workspace.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from itertools import pairwise, product
from typing import Protocol, runtime_checkable

import numpy as np

from formulations.shape_fields import takes

from ..common.validation import checked_place
from ..data.contact_segments import consecutive_contacts
from ..data.ground import frame_of
from ..data.measurements import Measurements
from ..errors import NoContactError, OptionError, shortened
from ..interface.result import Estimate
from .action_space import POINT_RATE, Trajectory, Workspace

SWEEP_SPACING = 0.03  # [m] between lines: a 1 cm finger meets what is above 1 cm wide
SEGMENT_LENGTH = 0.05  # [m] of one motion: a touched object is not pushed farther
OVERLAP = 0.01  # [m] of two motions: one may end as it touches, in its last sample
SWEEP_LIFT = 0.005  # [m] of the fingertip above its least height
AIM_HEIGHT = 0.02  # [m] from the ground, where the centre has no third coordinate
log = logging.getLogger("tactilenlp")


@runtime_checkable
class TouchedWorld(Protocol):
    """What `explore` asks of a world, simulated or real.

    Optional members, used where they exist: finger_radius [m], a number or (F,), from
    which the workspace is made; check(trajectory), which raises for what is out of
    reach, before the first command; true_body(time), the truth (evaluation/).
    """

    def execute(self, trajectory: Trajectory) -> Measurements:
        """Move the fingers along a path and back; return what was felt on the way."""


def sweep(space: Workspace, centre=None) -> Iterator[Trajectory]:
    """Yield motions of the first finger along parallel lines through the workspace.

    centre: (3,) [m], of a square of width 2 radius; by default the world's origin, or
    its projection onto the ground.  The other fingers are parked outside.
    """
    frame = frame_of(space.ground)
    middle = frame.to_ground(np.zeros(3) if centre is None else centre)
    height = middle[2]
    if space.ground is not None:
        height = space.finger_radius + space.clearance + SWEEP_LIFT
        middle[2] = 0.0 if centre is None else max(middle[2], 0.0)
    parked = space.parked(middle, 3 * space.radius)
    parked[:, 2] = np.maximum(parked[:, 2], height)  # no lower than the sweep
    pieces = int(np.ceil(2 * space.radius / SEGMENT_LENGTH))
    ends = np.linspace(-space.radius, space.radius, pieces + 1)
    n = max(2, round(space.duration * POINT_RATE) + 1)
    share = np.linspace(0, 1, n)[:, None]
    lines = 2 * int(np.ceil(space.radius / SWEEP_SPACING)) + 1
    offsets = sorted(np.linspace(-space.radius, space.radius, lines), key=abs)
    for line, y in enumerate(offsets):  # from the middle one outwards
        along = ends if line % 2 == 0 else ends[::-1]
        for a, b in pairwise(along):
            begin = a if a == along[0] else a - OVERLAP * np.sign(b - a)
            x = begin + (b - begin) * share
            line_y, line_z = np.full_like(x, middle[1] + y), np.full_like(x, height)
            way = np.hstack([middle[0] + x, line_y, line_z])
            position = np.repeat(way[:, None], space.fingers, axis=1)
            position[:, 1:] = parked[1:]
            position = frame.from_ground(position)
            if not space.blocked(position):
                yield Trajectory(share[:, 0] * space.duration, position)


def first_touch(world, space: Workspace, centre, rng):
    """Return action (None after a sweep), measurements and trajectories executed.

    One finger aims at centre (3,) [m], if one is given; without contact, the workspace
    is swept.  Raises NoContactError.
    """
    alone, trajectories = tuple(f == 0 for f in range(space.fingers)), []
    if centre is not None:
        centre = aim(space, centre)
        action = space.random(rng, alone, centre)
        trajectories.append(action.trajectory(centre))
        data = execute(world, trajectories[-1])
        if lasting_touch(data):
            return action, data, tuple(trajectories)
        log.warning("no contact at the given centre: sweeping the workspace")
    for trajectory in sweep(space, centre):
        trajectories.append(trajectory)
        data = execute(world, trajectory)
        if lasting_touch(data):
            return None, data, tuple(trajectories)
    raise NoContactError(
        "no contact",
        where="explore",
        got=f"a sweep of {2 * space.radius:.2g} m without contact",
        expected="an object in the workspace",
        next="give centre=(x, y) [m], a place on the object"
        if centre is None
        else "give centre=(x, y, z) [m], of a flat object its middle",
    )


def aim(space: Workspace, centre) -> np.ndarray:
    """Return the point (3,) [m] at which the first finger aims, world frame.

    Of a centre (2,) the one AIM_HEIGHT from the ground, at these x and y.
    """
    return frame_of(space.ground).point(checked_place("centre", centre), AIM_HEIGHT)


def execute(world, trajectory) -> Measurements:
    """Return what a world measured on a trajectory; OptionError if it is nothing."""
    data = world.execute(trajectory)
    if not isinstance(data, Measurements):
        raise OptionError(
            "returned no measurements", where="world.execute",
            got=shortened(data, most=80), expected="Measurements",
            next="return what was felt on the way (tactilenlp.TouchedWorld)",
        )  # fmt: skip
    return data


def lasting_touch(data: Measurements) -> bool:
    """Tell whether two successive samples have contact: one may be a wrong boolean."""
    return bool(consecutive_contacts(data).any())


def check_reach(world, space: Workspace, centre, estimate: Estimate | None) -> None:
    """Raise what `world.check(trajectory)` raises for a motion that may be asked of it.

    Checked are actions at the bounds of the angles and between, towards the last known
    position of the object or else `centre`; without either, the sweep.  What meets an
    obstacle is not asked.  A world without `check` is not asked.
    """
    check = getattr(world, "check", None)
    if check is None:
        return
    motions = sweep(space)
    if not (estimate is None and centre is None):
        target = aim(space, centre) if estimate is None else estimate.position[-1]
        lower, upper = space.lower[:2], space.upper[:2]  # of every finger alike
        bounds = zip(lower, (lower + upper) / 2, upper, strict=True)
        actions = (space.action(np.tile(a, space.fingers)) for a in product(*bounds))
        free = (action for action in actions if not action.blocked(target))
        motions = (action.trajectory(target) for action in free)
    for trajectory in motions:
        check(trajectory)


def check_world(world) -> None:
    """Raise OptionError unless a world has the methods of a TouchedWorld."""
    if isinstance(world, type):
        raise OptionError(
            "a class, not a world", where="world", got=world.__name__,
            expected="an object with execute(trajectory) -> Measurements",
            next=f"make one: {world.__name__}(...)",
        )  # fmt: skip
    if not (isinstance(world, TouchedWorld) and takes(world.execute, 1)):
        raise OptionError(
            "not a world", where="world", got=repr(world)[:80],
            expected="an object with execute(trajectory) -> Measurements",
            next="see tactilenlp.TouchedWorld",
        )  # fmt: skip
    for name in ("execute", "check", "true_body"):
        member = getattr(world, name, None)
        if member is not None and not callable(member):
            raise OptionError(
                "not a method", where=f"world.{name}", got=repr(member)[:80],
                expected=f"a method, as tactilenlp.TouchedWorld has it, or no {name}",
            )  # fmt: skip
