"""Record the scenes of the stress suite, in which fingers squeeze and push a box."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
from stability_judge import Case, Truth

from tactilenlp import Noise, Scene, Workspace, World
from tactilenlp.data.noise_model import add_noise

SIDES, YAW = (0.055, 0.038, 0.045), -0.6  # [m], [rad]
SPEED = 0.2  # [m/s] of the fingers
SEED = 7  # of actions after the fourth
TOP, FLAT = 1.2, 0.2  # [rad] how steeply fingers come from above, from the side
KNOWN = ("mass", "friction_ground", "friction_finger", "gravity")


def box(sides=SIDES, **known) -> World:
    """Return a world with a box that is turned by YAW."""
    turn = [np.cos(YAW / 2), 0, 0, np.sin(YAW / 2)]
    return World(sides, position=(0.01, -0.005), quaternion=turn, **known)


def turned(world) -> float:
    """Return the box's yaw now [rad]."""
    w, *_, z = world.pose[3:]
    return 2 * np.arctan2(z, w)


def reach(world) -> Workspace:
    """Return a workspace whose fingers start outside the box."""
    size, radius = np.linalg.norm(world.side_lengths), world.finger_radius.max()
    away = max(0.1, 0.75 * size + 2 * radius)
    return Workspace(
        fingers=len(world.finger_radius), radius=away, duration=away / 0.1,
        finger_radius=float(radius),
    )  # fmt: skip


def act(world, k: int) -> None:
    """Let the fingers act: squeeze x, push y off its middle, squeeze y, press the top.

    Later actions are drawn, and aim beside the middle.
    """
    space, yaw = reach(world), turned(world)
    across = (yaw + np.pi / 2 + np.pi / 2) % np.pi - np.pi / 2  # of y, within a quarter
    along = (yaw + np.pi / 2) % np.pi - np.pi / 2
    n = space.fingers
    rng = np.random.default_rng([SEED, k])
    aside = 0.1 * world.side_lengths[0] * np.r_[np.cos(yaw), np.sin(yaw), 0]
    active, way = None, np.zeros(3)
    if k == 0:
        angles, way = [along, FLAT] * n, aside[[1, 0, 2]] / 3
    elif k == 1:
        angles, way = [across, FLAT] * n, aside
        active = (True,) + (False,) * (n - 1)
    elif k == 2:
        angles, way = [across, FLAT] * n, -aside / 2
    elif k == 3:
        angles = [along / 2, TOP] * n
    else:
        angles = rng.uniform(space.lower, space.upper)
        way = 0.2 * world.side_lengths * rng.uniform(-1, 1, 3) * [1, 1, 0]
    angles = np.clip(angles, space.lower, space.upper)
    target = world.pose[:3] + way
    world.execute(space.action(angles, active).trajectory(target))


def move(world, *ways) -> None:
    """Let every finger move on a straight line from one point (3,) [m] to another."""
    length = max(np.linalg.norm(np.subtract(b, a)) for a, b in ways)
    share = np.linspace(0, 1, 101)[:, None, None]
    start, end = (np.array([way[i] for way in ways], float) for i in (0, 1))
    path = start + share * (end - start)
    time = np.linspace(0, max(0.3, length / SPEED), 101)
    world.execute(SimpleNamespace(time=time, finger_position=path))


def case_of(world, scene: Scene | None = None, **more) -> Case:
    """Return the case of all that a world recorded, its scene known unless given."""
    true = world.truth
    truth = Truth(world.side_lengths, true.object_position, true.object_quaternion)
    known = Scene(**{name: getattr(world, name) for name in KNOWN})
    return Case(world.measurements, scene or known, truth, **more)


@cache
def recorded(actions: int = 4, sides=SIDES, **known) -> Case:
    """Return the case of the first actions on a box; equal arguments record once."""
    world = box(sides, **known)
    for k in range(actions):
        act(world, k)
    return case_of(world)


def noisy(seed: int = 0, **noise) -> Case:
    """Return the case with noise on what the fingers feel."""
    case = recorded()
    return replace(case, data=add_noise(case.data, Noise(seed=seed, **noise)))
