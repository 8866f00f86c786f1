"""Turn what a tactile sensor measures into touches: contact, and the normal.

A touch starts when the strength rises above `on` and ends when it falls below `off`,
both learnt from samples without contact.  The normal is the outward normal of the
object: it points from object to finger, against the outward normal of the skin.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from .errors import FrameError, StaleStreamError
from .serial_tactile import FieldFrame, ForceFrame

ON, OFF = 6.0, 4.0  # [1], standard deviations of the strength above its mean
REST = 100  # [samples] of which the zero of a sensor is the mean
# R_ts (3, 3): the sensor's z, out of its top, goes down along the last link, or
# inwards to the middle of the robot (TriFingerEdu: the tip's +y at any joint angles).
DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
INWARD = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """One sample of a fingertip.

    time:    [s] of the host
    contact: whether it touches
    normal:  (3,) outward normal of the object in the tip's frame; zeros without
             contact, and where the sensor cannot tell it
    strength: what the contact was decided on, in the unit of the sensor
    valid:   False where the sensor could not tell whether it touches
    """

    time: float
    contact: bool
    normal: np.ndarray
    strength: float
    valid: bool = True


class Toucher(Protocol):
    """What makes a touch of a frame and its time [s]: ForceTouch, FieldTouch."""

    def __call__(self, time: float, frame) -> Touch | None: ...


@dataclass
class Hysteresis:
    """Contact begins above `on`, ends below `off`; in between it stays as it is."""

    on: float
    off: float
    contact: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        if not 0 < self.off <= self.on < np.inf:
            raise FrameError(
                "no thresholds",
                where="Hysteresis",
                got=f"on {self.on}, off {self.off}",
                expected="0 < off <= on",
                next="learn them from samples without contact",
            )

    @classmethod
    def learn(cls, quiet: np.ndarray, least: float) -> Hysteresis:
        """Return thresholds above all strengths (n,) of samples without contact.

        least: the smallest `on` that makes sense for the sensor, in its unit.
        """
        quiet = np.asarray(quiet, float)
        if quiet.size < 2 or not np.isfinite(quiet).all():
            expected, fix = "two finite strengths or more", "record without contact"
            raise FrameError("nothing to learn", expected=expected, next=fix)
        mean, sigma = quiet.mean(), quiet.std()
        on = max(mean + ON * sigma, quiet.max(), least)
        return cls(on, max(mean + OFF * sigma, OFF / ON * on))

    def __call__(self, strength: float) -> bool:
        """Return whether there is contact, with this strength as the newest."""
        self.contact = strength > (self.off if self.contact else self.on)
        return self.contact


class Tare:
    """The mean of the first samples, at rest, is zero."""

    def __init__(self, samples: int = REST) -> None:
        self.samples = samples
        self._sum, self._count = 0.0, 0

    def __call__(self, values: np.ndarray) -> np.ndarray | None:
        """Return the values without their zero, None while it is being found."""
        if self._count < self.samples:
            self._sum, self._count = self._sum + values, self._count + 1
            return None
        return values - self._sum / self._count


class ForceTouch:
    """Touches of an OptoForce dome: the force decides, and its direction is the normal.

    The force lies within the friction cone about the normal, not along it: with
    friction 0.5 it may be off by 27 degrees.  Say so in the sigma of the scene.

    scale:   (3,) [counts/N], on the sensor's data sheet
    on, off: [N]
    mount:   R_ts (3, 3), from the sensor's frame to the tip's
    """

    def __init__(
        self,
        scale: tuple = (400.9, 400.9, 400.9),  # OMD-20-SE-40N: 16037 counts at 40 N
        on: float = 0.15,
        off: float = 0.08,
        mount: tuple = DOWN,
        rest: int = REST,
    ) -> None:
        self.scale, self.R_ts = np.array(scale, float), np.array(mount, float)
        self.decide, self.tare = Hysteresis(on, off), Tare(rest)

    def __call__(self, time: float, frame: ForceFrame) -> Touch | None:
        """Return the touch, None while the zero is being found."""
        counts = self.tare(np.array(frame.counts, float))
        if counts is None:
            return None
        if frame.fault:
            return Touch(time, False, np.zeros(3), np.nan, valid=False)
        force = counts / self.scale
        strength = float(np.linalg.norm(force))
        contact = self.decide(strength)
        normal = self.R_ts @ (force / strength) if contact else np.zeros(3)
        return Touch(time, contact, normal, strength)


class FieldTouch:
    """Touches of a magnetic skin: whether, not where; the normal stays zero.

    on, off: [uT], norm of the change of the whole field; they depend on the skin
    """

    def __init__(self, on: float = 60.0, off: float = 40.0, rest: int = REST) -> None:
        self.decide, self.tare = Hysteresis(on, off), Tare(rest)

    def __call__(self, time: float, frame: FieldFrame) -> Touch | None:
        """Return the touch, None while the zero is being found."""
        change = self.tare(frame.field)
        if change is None:
            return None
        strength = float(np.linalg.norm(change))
        return Touch(time, self.decide(strength), np.zeros(3), strength)


def check_age(name: str, age: float, limit: float, why: str = "") -> None:
    """Raise StaleStreamError where the newest sample is older [s] than the limit."""
    if not age <= limit:
        raise StaleStreamError(
            "no touch is sensed",
            where=name,
            got=f"silence for {age:.3f} s" + (f" ({why})" if why else ""),
            expected=f"a sample every {limit} s",
            next="is the sensor plugged in and powered?",
        )


class Skin:
    """Collect the touches of one fingertip: from a reader's frames, by a toucher.

    Of the touches only the newest is kept, but between `remember` and `forget`.

    reader: has `take()` -> [(time [s], frame)], `check(stale)` and can be entered
    """

    def __init__(self, reader, toucher: Toucher) -> None:
        self.reader, self.toucher = reader, toucher
        self.touches: list[Touch] = []
        self._remembers = False

    def __enter__(self) -> Skin:
        self.reader.__enter__()
        return self

    def __exit__(self, *exception) -> None:
        self.reader.__exit__(*exception)

    def poll(self) -> None:
        """Take in what the sensor has sent; raises what the toucher raises."""
        for time, frame in self.reader.take():
            touch = self.toucher(time, frame)
            if touch is not None:
                if not self._remembers:
                    self.touches.clear()
                self.touches.append(touch)

    def check(self, stale: float) -> None:
        """Raise where the sensor has been silent for longer [s]."""
        self.reader.check(stale)

    def remember(self) -> None:
        """Drop all touches but the newest, and keep all that come."""
        self.forget()
        self._remembers = True

    def forget(self) -> None:
        """Drop all touches but the newest, and keep only the newest."""
        self._remembers = False
        del self.touches[:-1]
