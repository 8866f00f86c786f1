"""Departures from the world that the estimator assumes, by name and strength.

A `Departure` is how the world differs (foreign_world.py), what the sensors lose or are
told wrongly, and what the estimator is told wrongly of the scene.
"""

from collections import ChainMap
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import foreign_sensors as sensors
import numpy as np
from foreign_world import DEFAULT, GEL


@dataclass(frozen=True)
class Departure:
    """What is different: world, sensors (data, rng) -> data, told: factors of a Scene.

    world: arguments of ForeignWorld.
    """

    world: dict = field(default_factory=dict)
    sensors: Callable | None = None
    told: dict = field(default_factory=dict)

    def of(self, number: int) -> "Departure":
        """Return how the world of box `number` departs: the same for every box."""
        return self

    def measured(self, data, number: int):
        """Return what the sensors report of the measurements of box `number`."""
        rng = np.random.default_rng([2030, number])
        return data if self.sensors is None else self.sensors(data, rng)

    def scene(self, scene):
        """Return what the estimator is told of the scene."""
        wrong = {name: by * getattr(scene, name) for name, by in self.told.items()}
        return replace(scene, **wrong)


@dataclass(frozen=True)
class Combined:
    """Several departures at once, of different names, drawn anew for every box."""

    count: int
    names: tuple[str, ...]

    def of(self, number: int) -> Departure:
        """Return the departures of box `number` as one."""
        rng = np.random.default_rng([2031, number])
        drawn = rng.choice(self.names, self.count, replace=False)
        kinds = [rng.choice([*DEPARTURES[name].values()]) for name in drawn]
        made = [kind.sensors for kind in kinds if kind.sensors is not None]

        def sensors(data, rng):
            for one in made:
                data = one(data, rng)
            return data

        worlds = dict(ChainMap(*[kind.world for kind in kinds]))
        return Departure(worlds, sensors, dict(ChainMap(*[k.told for k in kinds])))


def of_sensors(change: Callable, **strengths) -> dict[str, Departure]:
    made = {name: partial(change, value) for name, value in strengths.items()}
    return {name: Departure(sensors=one) for name, one in made.items()}


def of_world(name: str, **strengths) -> dict[str, Departure]:
    return {strength: Departure({name: v}) for strength, v in strengths.items()}


LOST = {"25 %": 0.25, "50 %": 0.5}
SHARES = {"20 %": 0.2, "40 %": 0.4}
FRICTIONS = ("friction_ground", "friction_finger")
DEPARTURES: dict[str, dict[str, Departure]] = {
    "none": {"": Departure()},
    "contact": {
        "default": Departure({"contact": DEFAULT}),
        "gel": Departure({"contact": DEFAULT, "tip": GEL}),
    },
    "servo": of_world("stiffness", **{"1000 N/m": 1e3, "300 N/m": 300.0}),
    "centre of mass": {
        f"{100 * share:.0f} %": Departure({"centre": (share, -share, 0.0)})
        for share in (0.05, 0.1, 0.2)
    },
    "friction by face": of_world("by_face", **SHARES),
    "friction by direction": of_world("by_direction", **SHARES),
    "edges": of_world("edge", **{"1 mm": 1e-3, "3 mm": 3e-3}),
    "ground tilted": of_world(
        "tilt", **{f"{angle:g} deg": angle for angle in (0.5, 1.0, 2.0, 5.0)}
    ),
    "pushed high": of_world("heights", **{"0.7": (0.5, 0.7), "0.9": (0.7, 0.9)}),
    "begins in contact": of_world("touching", **{"every second": True}),
    "rate": of_world(
        "rate", **{"20 Hz": 20.0, "50 Hz": 50.0, "100 Hz": 100.0, "200 Hz": 200.0}
    ),
    "latency": of_world("latency", **{"10 ms": 0.01, "30 ms": 0.03, "60 ms": 0.06}),
    "radius": of_sensors(
        sensors.radius, **{f"{e:+g} mm": 1e-3 * e for e in (0.2, 0.5, -0.5, 1)}
    ),
    "dropped at random": of_sensors(sensors.at_random, **LOST),
    "dropped per finger": of_sensors(sensors.per_finger, **LOST),
    "dropped in bursts": of_sensors(sensors.in_bursts, **LOST),
    "gap": {
        "half an action": Departure(sensors=sensors.gap),
        "dead": Departure(sensors=sensors.dies),
    },
    "normals turned": of_sensors(sensors.turned, **{"2 deg": 2.0, "5 deg": 5.0}),
    "normals noisy": of_sensors(
        sensors.noisy_normals, **{"5 deg": 5.0, "15 deg": 15.0}
    ),
    "normals in steps": of_sensors(sensors.normals_in_steps, **{"15 deg": 15.0}),
    "positions displaced": of_sensors(sensors.displaced, **{"0.5 mm": 0.5e-3}),
    "positions noisy": of_sensors(
        sensors.noisy_positions, **{"0.2 mm": 0.2e-3, "1 mm": 1e-3}
    ),
    "positions in steps": of_sensors(
        sensors.positions_in_steps, **{"0.1 mm": 0.1e-3, "1 mm": 1e-3}
    ),
    "positions drift": of_sensors(sensors.drifting, **{"1 mm": 1e-3}),
    "position spikes": of_sensors(sensors.spikes, **{"10 mm": 10e-3}),
    "clock": of_sensors(sensors.unsteady_clock, **{"5 ms": 5e-3, "15 ms": 15e-3}),
    "late release": of_sensors(sensors.late_release, **{"2": 2, "5": 5}),
    "chatter": of_sensors(sensors.chattering, **{"5 %": 0.05, "20 %": 0.2}),
    "false touches": of_sensors(
        sensors.false_touches, **{"0.5 %": 0.005, "2 %": 0.02}
    ),
    "normals wrong": of_sensors(sensors.wrong_normals, **{"2 %": 0.02, "10 %": 0.1}),
    "repeated": of_sensors(sensors.repeating, **{"5 %": 0.05, "20 %": 0.2}),
    "speed": of_world("speed", **{"20 mm/s": 0.02, "100 mm/s": 0.1}),
    "threshold": of_world("felt", **{"0.3 N": 0.3, "0.8 N": 0.8}),
    "carried": of_world("carried", **{"5 mm": (5e-3, 0.1), "50 mm": (0.05, 3.0)}),
    "size": of_world("scale", **{"x0.5": 0.5, "x2.5": 2.5}),
    "fingertip": of_world("radius", **{"4 mm": 4e-3, "20 mm": 20e-3}),
    "wall": of_world("wall", **{"5 mm": 5e-3}),
    "torsion": of_world("torsion", **{"10 mm": 10e-3}),
    "from above": of_world("above", **{"0.5 rad": 0.5, "1.2 rad": 1.2}),
    "path": of_world("path", **{p: p for p in ("arc", "stopped", "twice", "aside")}),
    "duration": of_world("duration", **{"0.5 s": 0.5, "3 s": 3.0}),
    "fingers": of_world("fingers", **{"1": 1, "3": 3, "5": 5}),
    "mass": of_world("mass", **{"x0.1": 0.1, "x4": 4.0}),
    "frictions": of_world("friction", **{"x0.2": 0.2, "x2": 2.0}),
    "bumped": of_world("bumped", **{"50 mm/s": 0.05}),
    "mass told": {f"x{by:g}": Departure(told={"mass": by}) for by in (0.5, 2.0)},
    "frictions told": {
        f"x{by:g}": Departure(told=dict.fromkeys(FRICTIONS, by)) for by in (0.5, 2.0)
    },
}  # fmt: skip
# A bench has several of these at once; not among them is what no touch can tell.
TOGETHER = (
    "contact", "servo", "centre of mass", "friction by face", "friction by direction",
    "edges", "ground tilted", "pushed high", "rate", "dropped at random",
    "dropped per finger", "normals turned", "normals noisy", "positions noisy", "clock",
    "late release", "chatter", "threshold", "fingertip", "torsion", "from above",
    "mass told", "frictions told",
)  # fmt: skip
DEPARTURES["combined"] = {f"{n}": Combined(n, TOGETHER) for n in (2, 4)}
