"""Axes of the stress suite that corrupt the measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from stability_judge import RULE, Axis, Case, estimated
from stability_scenes import noisy, recorded

LATE = 1e-3  # [s] after which a sample comes a second time
BLIND = 10  # samples that are lost in a row, a third of a second
FAST = 120.0  # [Hz] of a record of which some samples are taken
STEPS = {  # fewest and most of its steps between two samples
    "10 to 20 ms": (1, 2), "10 to 60 ms": (1, 7), "30 to 130 ms": (4, 16),
    "15 Hz, then 60 Hz": (2, 8), "since 1970": (4, 4),
}  # fmt: skip
EPOCH = 1.7e9  # [s]


def normals(value: str) -> Case:
    return noisy(normal=np.radians(float(value.split()[0])))


def flips(value: str) -> Case:
    return noisy(flips=1e-2 * float(value.split()[0]))


def positions(value: str) -> Case:
    kind, size, *told = value.split()
    size = 1e-3 * float(size)
    case = noisy(**{{"white": "position"}.get(kind, kind): size})
    if "told" not in told:
        return case
    return replace(case, scene=replace(case.scene, sigma_offset=size))


def together(value: str) -> Case:
    """All noises of the paper at once, in another draw for every value."""
    seed = int(value.split()[1])
    return noisy(seed, position=1e-3, normal=np.radians(5), flips=0.01)


def repeated(value: str) -> Case:
    """Every tenth sample comes twice: at the same time, or a moment later."""
    case, every = recorded(), np.arange(recorded().data.samples)
    rows = np.sort(np.r_[every, every[5::10]])
    again = np.r_[False, np.diff(rows) == 0]
    time = case.data.time[rows] + LATE * again * (value == "a moment later")
    return of_samples(case, rows, time)


def of_samples(case: Case, rows, time) -> Case:
    """Return the case of some of its samples, at other times (n,) [s]."""
    arrays = {
        name: array[rows] for name, array in vars(case.data).items()
        if name not in ("time", "finger_radius") and array is not None
    }  # fmt: skip
    truth = replace(
        case.truth, position=case.truth.position[rows],
        quaternion=case.truth.quaternion[rows],
    )  # fmt: skip
    return replace(case, data=replace(case.data, time=time, **arrays), truth=truth)


def times(value: str) -> Case:
    """Sample at uneven times, or count them from long ago: of a record at FAST."""
    case, rng = recorded(rate=FAST), np.random.default_rng(0)
    n, (least, most) = case.data.samples, STEPS[value]
    steps = rng.integers(least, most + 1, size=n)
    if value == "15 Hz, then 60 Hz":
        steps = np.where(np.arange(n) < n / 2 / most, most, least)
    rows = np.cumsum(steps)
    rows = rows[rows < n]
    since = EPOCH if value == "since 1970" else 0.0
    return of_samples(case, rows, case.data.time[rows] + since)


def stuck(value: str) -> Case:
    """Finger 1, or all, say always or never that they feel contact."""
    who, when = value.split(", ")
    case = recorded()
    contact, normal = case.data.contact.copy(), case.data.normal.copy()
    fingers = slice(None) if who == "all" else slice(1, 2)
    if when == "never":
        contact[:, fingers], normal[:, fingers] = False, 0.0
    else:  # the normal that was felt first stays as well
        first = np.argmax(contact, axis=0)
        held = normal[first, np.arange(len(first))]
        normal[:, fingers] = np.where(
            contact[:, fingers, None], normal[:, fingers], held[fingers]
        )
        contact[:, fingers] = True
    return replace(case, data=replace(case.data, contact=contact, normal=normal))


def dropped(value: str) -> Case:
    """Samples are lost: in a row, of one finger, or anywhere."""
    if value == "a tenth at random":
        return noisy(dropped=0.1)
    case = recorded()
    data, valid = case.data, case.data.valid.copy()
    for action in np.unique(data.action):
        rows = np.nonzero(data.action == action)[0]
        onset = np.argmax(data.contact[rows].any(axis=1))
        first = {"around onset": onset - BLIND // 2, "the end": len(rows) - BLIND}
        if value in first:
            valid[rows[max(0, first[value]) :][:BLIND]] = False
    if value == "a finger in an action":
        valid[data.action == 2, 0] = False
    return replace(case, data=replace(data, valid=valid))


AXES = (
    Axis(
        "noise of normals", RULE, ("1 deg", "5 deg", "15 deg", "30 deg"),
        estimated(normals),
        {"cuboid": True, "polytope": ("5 deg", "15 deg"), "shooting": ("5 deg",)},
    ),
    Axis(
        "flips", RULE, ("1 %", "3 %", "10 %"), estimated(flips),
        {"cuboid": True, "polytope": ("3 %",), "shooting": ("3 %",),
         "complementarity": ("3 %",)},
    ),
    Axis(
        "noise of positions", RULE,
        ("white 0.3 mm", "white 1 mm", "white 3 mm", "bias 1 mm", "bias 3 mm",
         "bias 5 mm", "bias 1 mm told", "bias 3 mm told", "bias 5 mm told"),
        estimated(positions),
        {"cuboid": True, "polytope": ("white 1 mm", "bias 1 mm"),
         "shooting": ("bias 1 mm",), "complementarity": ("white 0.3 mm",)},
        # Hard constraints: noise of finger positions enters as it is.
        may_refuse=(("white 0.3 mm", "complementarity"),),
    ),
    Axis(
        "all noises", RULE, tuple(f"draw {k}" for k in range(6)), estimated(together),
        {"cuboid": True, "polytope": ("draw 0", "draw 1")},
    ),
    Axis(
        "samples twice", RULE, ("same time", "a moment later"), estimated(repeated),
        {"cuboid": True, "polytope": True},
        may_refuse=(("same time", "*"),),  # two samples of one instant: no velocity
    ),
    Axis(
        "times", RULE, tuple(STEPS), estimated(times),
        {"cuboid": True, "polytope": ("10 to 60 ms", "since 1970"),
         "complementarity": ("10 to 60 ms",)},
    ),
    Axis(
        "stuck sensor", RULE,
        ("finger 1, never", "finger 1, always", "all, never", "all, always"),
        estimated(stuck), {"cuboid": True, "polytope": ("finger 1, never",)},
        # Nothing felt at all, or contact in mid-air: no body explains it.
        may_refuse=(
            ("all, never", "*"), ("all, always", "*"), ("finger 1, always", "*"),
        ),
    ),
    Axis(
        "dropped spans", RULE,
        ("around onset", "the end", "a finger in an action", "a tenth at random"),
        estimated(dropped), {"cuboid": True, "polytope": ("around onset",)},
    ),
)  # fmt: skip
