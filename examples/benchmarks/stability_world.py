"""Axes of the stress suite that vary the world: objects, contacts, time steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from stability_judge import RULE, Axis, Case, estimated
from stability_scenes import SIDES, act, box, case_of, move, reach, recorded, turned

from tactilenlp import Ground
from tactilenlp.geometry.transforms import quaternion_of, rotation_of

EASY = 0.03  # [m] that a finger travels to or past a face
GRAZE = 0.2e-3  # [m] by which a grazing finger overlaps a face
PLACE = 0.5, 0.3  # [m] where the ground's frame is, in x and y


def friction(value: str) -> Case:
    contact, mu = value.split()
    return recorded(**{f"friction_{contact}": float(mu)})


def mass(value: str) -> Case:
    return recorded(mass=float(value.split()[0]))


def radius(value: str) -> Case:
    rho = 1e-3 * float(value.split()[0])
    return recorded(finger_radius=(rho, rho))


def size(value: str) -> Case:
    longest = 1e-2 * float(value.split()[0])
    return recorded(sides=tuple(longest * side / max(SIDES) for side in SIDES))


def restitution(value: str) -> Case:
    return recorded(restitution=float(value))


def rate(value: str) -> Case:
    return recorded(3, rate=float(value.split("/")[1].split()[0]))


def leaning(value: str) -> Case:
    """Turn the world about a place far from its origin: the ground leans, told or not.

    It is told to pass through that place.
    """
    case, (lean, told, up) = recorded(), GROUNDS[value]
    true, known = (Rotation.from_rotvec([0, np.radians(a), 0]) for a in (lean, told))
    place, normal = np.array([*PLACE, up]), known.as_matrix()[:, 2]
    turned = true * rotation_of(case.truth.quaternion)
    truth = replace(
        case.truth, position=true.apply(case.truth.position) + place,
        quaternion=quaternion_of(turned),
    )  # fmt: skip
    ground = Ground(float(normal @ place), tuple(normal))
    return replace(
        case, data=case.data.transformed(true.as_matrix(), place), truth=truth,
        scene=replace(case.scene, ground=ground),
    )  # fmt: skip


def contacts(value: str) -> Case:
    """Squeeze x, touch in the way that the value names, squeeze y, press the top."""
    world = box()
    act(world, 0)
    middle, x, y = axes_of(world)
    away = middle - 3 * reach(world).radius * x
    first, *second = CONTACTS[value](world, middle, x, y)
    move(world, first, *(second or [(away, away)]))  # a finger without a way is parked
    act(world, 2)
    act(world, 3)
    return case_of(world)


def axes_of(world):
    """Return the box's middle (3,) [m], and unit vectors along its x and y (3,)."""
    yaw = turned(world)
    x = np.r_[np.cos(yaw), np.sin(yaw), 0]
    return world.pose[:3], x, np.r_[-x[1], x[0], 0]


# The ways of one finger, or of both: from one point (3,) [m] to another.
def grazing(world, middle, x, y):
    a, b, _ = np.array(world.side_lengths) / 2
    beside = middle + (b + world.finger_radius[0] - GRAZE) * y
    return [(beside - (a + EASY) * x, beside + (a + EASY) * x)]


def edge(world, middle, x, y):
    out = (x + y) / np.sqrt(2)
    edge = middle + world.side_lengths[0] / 2 * x + world.side_lengths[1] / 2 * y
    return [(edge + EASY * out, edge - EASY / 3 * out)]


def corner(world, middle, x, y):
    a, b, c = np.array(world.side_lengths) / 2
    out = (x + y + [0, 0, 1]) / np.sqrt(3)
    tip = middle + a * x + b * y + [0, 0, c]
    return [(tip + EASY * out, tip - EASY / 4 * out)]


def face(world, middle, x) -> np.ndarray:
    """Return where a fingertip touches the face that looks along x (3,) [m]."""
    return middle + (world.side_lengths[0] / 2 + world.finger_radius[0]) * x


def first_sample(world, middle, x, y):
    at = face(world, middle, x)
    return [(at + 1e-6 * x, at - EASY / 2 * x)]


def last_sample(world, middle, x, y):
    at = face(world, middle, x)
    return [(at + EASY * x, at - 1e-3 * x)]


def one_face(world, middle, x, y):
    at, apart = face(world, middle, x), 1.2 * world.finger_radius[0] * y
    return [(at + EASY * x + s * apart, at - EASY / 2 * x + s * apart) for s in (1, -1)]


CONTACTS = {
    "grazing": grazing, "edge": edge, "corner": corner, "first sample": first_sample,
    "last sample": last_sample, "two fingers on a face": one_face,
}  # fmt: skip

GROUNDS = {  # [deg, deg, m]: how far the ground leans, is told to lean, and is up
    "leans 2 deg": (2, 0, 0.0), "leans 4 deg": (4, 0, 0.0),
    "0.8 m up, leans 3 deg": (3, 0, 0.8), "told 20 deg": (20, 20, 0.3),
    "told 20 deg, leans 22": (22, 20, 0.3),
}  # fmt: skip

AXES = (
    Axis(
        "time step", RULE, ("1/15 s", "1/30 s", "1/60 s", "1/120 s", "1/1020 s"),
        estimated(rate),
        {"cuboid": True, "polytope": ("1/15 s", "1/60 s"),
         "multiple shooting": ("1/60 s",), "complementarity": ("1/60 s",)},
    ),
    Axis(
        "friction", RULE,
        tuple(f"{of} {mu}" for of in ("ground", "finger") for mu in (0, 0.05, 1, 3)),
        estimated(friction),
        {"cuboid": True, "polytope": ("ground 0.05", "ground 1", "finger 0"),
         "shooting": ("ground 0.05", "finger 3"), "complementarity": ("ground 1",)},
    ),
    Axis(
        "mass", RULE, ("0.001 kg", "0.02 kg", "2 kg", "10 kg", "100 kg"),
        estimated(mass),
        {"cuboid": True, "polytope": ("0.001 kg", "100 kg"),
         "shooting": ("0.001 kg", "100 kg"), "complementarity": ("0.001 kg", "10 kg")},
    ),
    Axis(
        "finger radius", RULE, ("2 mm", "5 mm", "20 mm", "30 mm"), estimated(radius),
        {"cuboid": True, "polytope": ("2 mm", "30 mm"), "shooting": ("2 mm",)},
    ),
    Axis(
        "object size", RULE, ("1 cm", "2 cm", "10 cm", "20 cm", "30 cm"),
        estimated(size),
        {"cuboid": True, "polytope": ("2 cm", "10 cm"), "shooting": ("2 cm", "10 cm")},
    ),
    Axis(
        "ground", RULE, tuple(GROUNDS), estimated(leaning),
        {"cuboid": True, "polytope": ("0.8 m up, leans 3 deg", "told 20 deg"),
         "shooting": ("told 20 deg",)},
    ),
    Axis(
        "restitution", RULE, ("0.1", "0.3", "0.5"), estimated(restitution),
        {"cuboid": True, "polytope": ("0.5",), "multiple shooting": ("0.5",)},
    ),
    Axis(
        "contacts", RULE, tuple(CONTACTS), estimated(contacts),
        {"cuboid": True, "polytope": ("grazing", "corner"),
         "shooting": ("edge", "two fingers on a face"), "complementarity": ("corner",)},
    ),
)  # fmt: skip
