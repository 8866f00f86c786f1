"""Departures from the world that the estimator assumes, by name and strength.

A `Departure` is how the world differs (foreign_world.py), what the sensors lose or are
told wrongly, and what the estimator is told wrongly of the scene.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from foreign_world import DEFAULT, GEL

BURST = 5  # samples in a row, on average, that are lost in a burst


@dataclass(frozen=True)
class Departure:
    """What is different: world, sensors (data, rng) -> data, told: factors of a Scene.

    world: arguments of ForeignWorld.
    """

    world: dict = field(default_factory=dict)
    sensors: Callable | None = None
    told: dict = field(default_factory=dict)

    def measured(self, data, number: int):
        """Return what the sensors report of the measurements of box `number`."""
        rng = np.random.default_rng([2030, number])
        return data if self.sensors is None else self.sensors(data, rng)

    def scene(self, scene):
        """Return what the estimator is told of the scene."""
        wrong = {name: by * getattr(scene, name) for name, by in self.told.items()}
        return replace(scene, **wrong)


def without(data, lost):
    """Return the data without the samples that are lost (T, F)."""
    valid = data.valid & ~lost
    normal = np.where(valid[..., None], data.normal, 0.0)
    return replace(data, valid=valid, contact=data.contact & valid, normal=normal)


def at_random(share: float):
    """Lose all fingers' samples of an instant, at random."""

    def lose(data, rng):
        lost = rng.random(data.samples) < share
        return without(data, np.repeat(lost[:, None], data.fingers, axis=1))

    return lose


def per_finger(share: float):
    """Lose each finger's samples at random."""

    def lose(data, rng):
        return without(data, rng.random(data.valid.shape) < share)

    return lose


def in_bursts(share: float):
    """Lose samples of each finger in bursts of BURST samples on average."""

    def lose(data, rng):
        begin = share / BURST / (1 - share)
        lost, gone = np.zeros(data.valid.shape, bool), np.zeros(data.fingers, bool)
        for t in range(data.samples):
            draw = rng.random(data.fingers)
            gone = np.where(gone, draw > 1 / BURST, draw < begin)
            lost[t] = gone
        return without(data, lost)

    return lose


def gap(data, rng):
    """Lose half an action of all fingers, of one action in the middle."""
    rows = np.flatnonzero(data.action == np.unique(data.action)[data.actions // 2])
    first = int(rng.integers(0, len(rows) // 2 + 1))
    lost = np.zeros(data.valid.shape, bool)
    lost[rows[first : first + len(rows) // 2]] = True
    return without(data, lost)


def dies(data, rng):
    """Lose the last finger's samples from the middle of the recording on."""
    lost = np.zeros(data.valid.shape, bool)
    lost[data.samples // 2 :, -1] = True
    return without(data, lost)


def radius(error: float):
    """Tell a fingertip radius that is wrong by an error [m]."""
    return lambda data, rng: replace(data, finger_radius=data.finger_radius + error)


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
    "ground tilted": of_world("tilt", **{"0.5 deg": 0.5, "1 deg": 1.0, "2 deg": 2.0}),
    "pushed high": of_world("heights", **{"0.7": (0.5, 0.7), "0.9": (0.7, 0.9)}),
    "begins in contact": of_world("touching", **{"every second": True}),
    "rate": of_world(
        "rate", **{"20 Hz": 20.0, "50 Hz": 50.0, "100 Hz": 100.0, "200 Hz": 200.0}
    ),
    "latency": of_world("latency", **{"10 ms": 0.01, "30 ms": 0.03, "60 ms": 0.06}),
    "radius": {
        f"{e:+g} mm": Departure(sensors=radius(1e-3 * e)) for e in (0.2, 0.5, -0.5, 1)
    },
    "dropped at random": {s: Departure(sensors=at_random(v)) for s, v in LOST.items()},
    "dropped per finger": {
        s: Departure(sensors=per_finger(v)) for s, v in LOST.items()
    },
    "dropped in bursts": {s: Departure(sensors=in_bursts(v)) for s, v in LOST.items()},
    "gap": {"half an action": Departure(sensors=gap), "dead": Departure(sensors=dies)},
    "mass told": {f"x{by:g}": Departure(told={"mass": by}) for by in (0.5, 2.0)},
    "frictions told": {
        f"x{by:g}": Departure(told=dict.fromkeys(FRICTIONS, by)) for by in (0.5, 2.0)
    },
}  # fmt: skip
