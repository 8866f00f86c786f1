"""Find mistakes in a recording before it is solved: axes, signs, units, fingers, time.

Every mistake is a transformation of the data, and is undone by another.  A likelihood
ratio test compares the measurements as they are with each of the repaired ones
(`mistakes_of`), by the composite likelihood of plausibility.py:

    max_h log L(T_h data) - log L(data) > log(N / alpha).

Each T_h keeps volumes, so that L(T_h data) is a density of the data as well.  For
correct data each ratio exceeds N / alpha with a probability of at most alpha / N
(Markov's inequality), one of all N with at most alpha (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations, product

import numpy as np

from ..errors import MistakeError
from .contact_segments import tracked_samples
from .measurements import Measurements
from .plausibility import TERMS, jumps_of, log_likelihood, most_log_likelihood
from .scene import Scene
from .sensor_noise import precision_of
from .touch_events import Record

# [1] alpha: an exploration checks every step; the limit is 11.8 nats for two fingers.
# The largest gain of 74 correct recordings is 4.8 nats, of 80 first touches 8.5, of 129
# in worlds that were made to deceive 9.9.
FALSE_ALARM = 1e-3
# [1] alpha where touches fit no body well: a mistake as likely as not is named only.
# No correct recording of 73 reaches that limit, 5.6 nats.
SUSPICION = 0.5
# [nats] that other terms than kinks must gain: a programme that is repeated stops its
# fingers a while after each touch, as if all touches were too early.
BY_OTHERS = 1.0
MOST_SAMPLES = 400  # whole actions up to these are read: 13 s, within 0.2 s
# Shifts in time, of two samples or more: one sample is within the latency.
LONGEST_SHIFT, SHIFTS = 10 / 30, 9  # [s]; each way
RADIUS_FACTORS = (10.0, 100.0, 1000.0, 0.1, 0.01, 0.001)
FRAME_TERMS = ("onsets", "releases", "planes", "passages")
RADIUS_TERMS = ("planes", "passages", "overlaps", "radii")
HOW_TO_SKIP = "Options(check_mistakes=False) solves the data as they are"


@dataclass(frozen=True, eq=False)
class Mistake:
    """A mistake that data may have, and how it is undone.

    name: in a few words; where: the key; remedy: in a sentence; repaired: makes the
    Record in which it is undone; terms: those of the likelihood that the repair
    changes, its events as they are, by default all.
    """

    name: str
    where: str
    remedy: str
    repaired: Callable[[], Record]
    terms: Sequence[str] | None = None


def check_mistakes(data: Measurements, scene: Scene) -> None:
    """Raise MistakeError where a mistake explains the data much better than none.

    A body without a ground moves by itself; its recordings are not checked.
    """
    if scene.ground is None:
        return
    mistake, gain, limit = most_likely(record_of(data, scene), every=False)
    if gain > limit:
        raise MistakeError(
            mistake.name, mistake=mistake.name, nats=gain, where=mistake.where,
            got=f"data that are {gain:.0f} nats more likely once this is undone",
            expected=f"at most {limit:.0f} nats",
            next=f"{mistake.remedy}; {HOW_TO_SKIP}",
        )  # fmt: skip


def suspicion(data: Measurements, scene: Scene) -> str:
    """Return in words a mistake in data that fit no body well; "" where none is likely.

    Its gain need not be enough to refuse the data before they are solved.
    """
    if scene.ground is None:
        return ""
    mistake, gain, limit = most_likely(record_of(data, scene), False, SUSPICION)
    return f"{mistake.name} ({gain:.0f} nats more likely)" if gain > limit else ""


def most_likely(
    record: Record, every=True, alpha: float = FALSE_ALARM
) -> tuple[Mistake | None, float, float]:
    """Return the most likely mistake, its gain [nats], and the limit of a gain.

    None, with a gain of minus infinity, where none was evaluated.  every: evaluate also
    mistakes whose gain cannot exceed the limit, since the terms that they change are
    near the most that they can be, or since no others than kinks gain by them; alpha
    [1]: of a false alarm.
    """
    recorded, mistakes = log_likelihood(record), [*mistakes_of(record)]
    limit = float(np.log(len(mistakes) / alpha))
    best, most = None, -np.inf
    for one in mistakes:
        names = [*(TERMS if one.terms is None else one.terms)]
        if not every and one.terms is not None:
            now = sum(recorded[name] for name in names)
            if most_log_likelihood(record, names) - now < limit:
                continue
        repaired, others = one.repaired(), [n for n in names if n != "kinks"]
        told = log_likelihood(repaired, others)
        gain = sum(told[name] - recorded[name] for name in others)
        if len(others) < len(names):
            if not every and gain <= BY_OTHERS:
                continue
            kinks = log_likelihood(repaired, ["kinks"])["kinks"] - recorded["kinks"]
            gain += min(kinks, limit - BY_OTHERS)
        if gain > most:
            best, most = one, gain
    return best, most, limit


def record_of(data: Measurements, scene: Scene) -> Record:
    """Return the first actions of the measurements as the check takes them."""
    rows = tracked_samples(data)  # what is counted below are samples of 30 Hz
    if len(rows) > MOST_SAMPLES:  # whole actions, unless the first is longer
        action = data.action[rows]
        begins = np.searchsorted(action, action[MOST_SAMPLES])
        rows = rows[: int(begins) or MOST_SAMPLES]
    precision = precision_of(data, scene)
    return Record(
        position=data.finger_position[rows], normal=data.normal[rows],
        felt=data.contact[rows], valid=data.valid[rows],
        radius=data.finger_radius, action=data.action[rows], time=data.time[rows],
        sigma_position=precision.position, sigma_normal=precision.normal,
        up=np.array(scene.ground.normal), level=scene.ground.height,
        slack=scene.finger_length + 2 * scene.typical_offset,
    )  # fmt: skip


def mistakes_of(record: Record) -> Iterator[Mistake]:
    """Yield every mistake that is tried: the table of this module."""
    yield from _of_axes(record)
    yield from _of_radius(record)
    yield from _of_fingers(record)
    yield from _of_time(record)
    yield Mistake(
        "contact is inverted", "contact", "give ~contact, and its normals",
        partial(
            replace, record, felt=record.valid & ~record.felt,
            normal=np.zeros_like(record.normal),
        ),
    )  # fmt: skip


def _of_axes(record: Record) -> Iterator[Mistake]:
    """Yield all 47 changes of axes and signs, of normals and of positions."""
    turns = [
        np.diag(signs)[list(order)]
        for order, signs in product(permutations(range(3)), product((1, -1), repeat=3))
    ]
    turns = [Q for Q in turns if not np.array_equal(Q, np.eye(3))]
    for Q in sorted(turns, key=lambda Q: not np.array_equal(Q, -np.eye(3))):
        mistake = "the axes of normals and positions differ"
        fix = f"give normals {_axes(Q)}, or positions {_axes(Q.T)} if those are wrong"
        if np.array_equal(Q, -np.eye(3)):
            mistake = "normals point into the object"
            fix = "give -normal: it points from the object to the finger"
        repaired = partial(record.with_same_touches, normal=record.normal @ Q.T)
        yield Mistake(mistake, "normal", fix, repaired, FRAME_TERMS)
    for Q in turns:
        repaired = partial(record.with_same_touches, position=record.position @ Q.T)
        mistake = "the axes of positions are swapped or mirrored"
        fix = f"give positions {_axes(Q)}"
        terms = (*FRAME_TERMS, "heights")
        yield Mistake(mistake, "finger_position", fix, repaired, terms)


def _axes(Q: np.ndarray) -> str:
    """Return a signed permutation in words, such as (y, -x, z)."""
    at, sign = abs(Q).argmax(axis=1), Q.sum(axis=1)
    names = ["-xyz"[0 : int(s < 0)] + "xyz"[i] for i, s in zip(at, sign, strict=True)]
    return f"({', '.join(names)})"


def _of_radius(record: Record) -> Iterator[Mistake]:
    """Yield every other unit of the radii of fingers."""
    for factor in RADIUS_FACTORS:
        resized = partial(record.with_same_touches, radius=record.radius * factor)
        mistake = "the radius is in the wrong unit"
        fix = f"multiply it by {factor:g}: it is in metres"
        yield Mistake(mistake, "finger_radius", fix, resized, RADIUS_TERMS)


def _of_fingers(record: Record) -> Iterator[Mistake]:
    """Yield every pair of fingers swapped, in position or in what they feel.

    Of three or more also all of them rotated, and the axes of their array swapped.
    """
    fingers = len(record.radius)
    for f, g in combinations(range(fingers), 2):
        order = np.arange(fingers)
        order[[f, g]] = g, f
        mistake, fix = f"fingers {f} and {g} are swapped", "swap their columns"
        repaired = partial(replace, record, position=record.position[:, order])
        where, fix = "finger_position", f"{fix} of finger_position, or of all others"
        yield Mistake(mistake, where, fix, repaired)
        felt = record.felt[:, order] & record.valid
        repaired = partial(replace, record, felt=felt, normal=record.normal[:, order])
        yield Mistake(mistake, "contact", fix, repaired)
    for shift in range(1, fingers) if fingers > 2 else ():
        order = np.roll(np.arange(fingers), shift).tolist()
        repaired = partial(replace, record, position=record.position[:, order])
        fix = f"give finger_position[:, {order}], or order all others so"
        yield Mistake("fingers are in another order", "finger_position", fix, repaired)
    if fingers == 3:
        repaired = partial(replace, record, position=record.position.transpose(0, 2, 1))
        mistake, fix = "fingers and coordinates are swapped", "give (T, F, 3)"
        yield Mistake(mistake, "finger_position", fix, repaired)


def _of_time(record: Record) -> Iterator[Mistake]:
    """Yield what a finger feels shifted against where it is, and jumps of its path."""
    jumped = jumps_of(record)
    for f in range(len(record.radius)):
        for shift in _shifts(record):
            late = "early" if shift > 0 else "late"
            yield Mistake(
                f"what finger {f} feels is {abs(shift)} samples too {late}", "contact",
                "give position, contact and normal of a finger at the same times, or "
                "Scene(latency=...) if all contacts are late",
                partial(_felt_later, record, shift, f),
            )  # fmt: skip
        if jumped[f]:
            at_rest = record.position.copy()
            at_rest[:, f] = at_rest[0, f]
            yield Mistake(
                f"finger {f} jumps within actions", "finger_position",
                "check that its samples have the time and action of the other fingers",
                partial(replace, record, position=at_rest), ("jumps",),
            )  # fmt: skip


def _felt_later(record: Record, shift: int, f: int) -> Record:
    """Return the record with what one finger feels so many samples later."""
    first, last = record.bounds
    source, arrays = np.clip(np.arange(len(first)) - shift, first, last), {}
    for key in ("felt", "valid", "normal"):
        arrays[key] = getattr(record, key).copy()
        arrays[key][:, f] = arrays[key][source, f]
    return replace(record, **arrays)


def _shifts(record: Record) -> list[int]:
    """Return the shifts in samples that are tried, of both signs."""
    same = record.action[1:] == record.action[:-1]
    dt = np.median(np.diff(record.time)[same]) if same.any() else LONGEST_SHIFT
    most = max(2, round(LONGEST_SHIFT / dt))
    each = np.unique(np.linspace(2, most, SHIFTS).round())
    return [*(-each[::-1]).astype(int).tolist(), *each.astype(int).tolist()]
