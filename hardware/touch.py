"""Convert the frames of a tactile sensor to touches: contact and normal.

A touch starts when the strength rises above `on` and ends when it falls below `off`,
both learnt from samples without contact.  The normal is the outward normal of the
object: it points from object to finger, opposite to the outward normal of the skin.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tactilenlp.common.validation import as_number, check_range, check_whole, numbers_of
from tactilenlp.errors import shortened, typed_call

from .errors import FrameError, SensorError
from .ranges import check_ranges, rotation
from .serial_tactile import FieldFrame, ForceFrame

LARGEST = 1e12  # [unit of a strength], beyond any sensor
SCALE = (400.9, 400.9, 400.9)  # [counts/N] of OMD-20-SE-40N: 16037 counts at 40 N
ON, OFF = 6.0, 4.0  # [1], standard deviations of the strength above its mean
LONGEST_REST = 100_000  # [samples]
REST = 100  # [samples] whose mean is the zero of a sensor
# R_ts (3, 3): the sensor's z, out of its top, goes down along the last link, or
# inwards to the middle of the robot (TriFingerEdu: the tip's +y at any joint angles).
DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
INWARD = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """One sample of a fingertip.

    time:    [s] of the host
    contact: whether the finger touches the object
    normal:  (3,) outward normal of the object in the tip's frame; zeros without
             contact, and where the sensor does not measure it
    strength: the quantity that decides on contact, in the unit of the sensor
    valid:   False where the sensor could not decide on contact
    """

    time: float
    contact: bool
    normal: np.ndarray
    strength: float
    valid: bool = True


class Toucher(Protocol):
    """Make a touch of a frame and its time [s]: ForceTouch, FieldTouch.

    `reset` makes it find its zero again.
    """

    def __call__(self, time: float, frame) -> Touch | None: ...

    def reset(self) -> None: ...


@typed_call(FrameError)
@dataclass
class Hysteresis:
    """Decide on contact: it begins above `on`, and ends below `off`."""

    on: float
    off: float
    contact: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        if not 0 < as_number(self.off) <= as_number(self.on) < np.inf:
            raise FrameError(
                "no thresholds",
                where="Hysteresis",
                got=shortened((self.on, self.off), most=80),
                expected="0 < off <= on",
                next="learn them from samples without contact",
            )

    @classmethod
    def learn(cls, quiet: np.ndarray, least: float) -> Hysteresis:
        """Return thresholds above all strengths (n,) of samples without contact.

        least: the smallest allowed `on`, in the unit of the sensor.
        """
        quiet = numbers_of("quiet", quiet, FrameError, "n", finite=True)
        check_range("least", least, 0.0, LARGEST, "", FrameError)
        if quiet.size < 2:
            expected, fix = "two finite strengths or more", "record without contact"
            raise FrameError(
                "nothing to learn", where="quiet", got=quiet.size,
                expected=expected, next=fix,
            )  # fmt: skip
        mean, sigma = quiet.mean(), quiet.std()
        on = max(mean + ON * sigma, quiet.max(), least)
        return cls(on, max(mean + OFF * sigma, OFF / ON * on))

    def __call__(self, strength: float) -> bool:
        """Return whether there is contact, with this strength as the newest."""
        self.contact = strength > (self.off if self.contact else self.on)
        return self.contact


@typed_call(FrameError)
class Tare:
    """Subtract the mean of the first samples, which are without contact."""

    def __init__(self, samples: int = REST) -> None:
        check_whole("Tare.samples", samples, 1, LONGEST_REST, FrameError)
        self.samples = samples
        self.reset()

    def reset(self) -> None:
        """Forget the zero."""
        self._sum, self._count = 0.0, 0

    @property
    def known(self) -> bool:
        """Whether the zero has been found."""
        return self._count >= self.samples

    def __call__(self, values: np.ndarray) -> np.ndarray | None:
        """Return the values without their zero, None while it is being found."""
        if not self.known:
            self._sum, self._count = self._sum + values, self._count + 1
            return None
        return values - self._sum / self._count


class _Tared:
    """What touchers of forces and fields share: a zero, and thresholds."""

    def __init__(self, on: float, off: float, rest: int) -> None:
        self.decide, self.tare = Hysteresis(on, off), Tare(rest)

    def reset(self) -> None:
        """Find the zero again, from the next samples."""
        self.tare.reset()
        self.decide.contact = False


@typed_call(FrameError)
class ForceTouch(_Tared):
    """Make touches of an OptoForce dome: contact by the force, normal by its direction.

    The force lies within the friction cone about the normal, not along it: with
    friction 0.5 the angle is up to 27 degrees.  Set sigma_normal of the scene for it.
    A sample with a reported error is not valid, nor is one with a force beyond the
    range of the sensor, whose direction is wrong; neither enters the zero.

    scale:   (3,) [counts/N], on the sensor's data sheet
    on, off: [N]
    mount:   R_ts (3, 3), from the sensor's frame to the tip's
    """

    def __init__(
        self,
        scale: tuple = SCALE,
        on: float = 0.15,
        off: float = 0.08,
        mount: tuple = DOWN,
        rest: int = REST,
    ) -> None:
        check_ranges("scale", scale, 3, 1e-9, LARGEST, "counts/N", FrameError)
        self.scale = np.array(scale, float)
        self.R_ts = rotation("mount", mount, FrameError)
        super().__init__(on, off, rest)

    def __call__(self, time: float, frame: ForceFrame) -> Touch | None:
        """Return the touch, None while the zero is being found."""
        if frame.fault or frame.overload:
            unknown = Touch(time, False, np.zeros(3), np.nan, valid=False)
            return unknown if self.tare.known else None
        counts = self.tare(np.array(frame.counts, float))
        if counts is None:
            return None
        force = counts / self.scale
        strength = float(np.linalg.norm(force))
        contact = self.decide(strength)
        normal = self.R_ts @ (force / strength) if contact else np.zeros(3)
        return Touch(time, contact, normal, strength)


@typed_call(FrameError)
class FieldTouch(_Tared):
    """Make touches of a magnetic skin: contact only; the normal is zero.

    on, off: [uT], norm of the change of the whole field; they depend on the skin
    """

    def __init__(self, on: float = 60.0, off: float = 40.0, rest: int = REST) -> None:
        super().__init__(on, off, rest)

    def __call__(self, time: float, frame: FieldFrame) -> Touch | None:
        """Return the touch, None while the zero is being found."""
        change = self.tare(frame.field)
        if change is None:
            return None
        strength = float(np.linalg.norm(change))
        return Touch(time, self.decide(strength), np.zeros(3), strength)


class NoTouch:
    """Make no touch of any frame: for a bench that only records."""

    def __call__(self, time: float, frame) -> None:
        """Return None."""

    def reset(self) -> None:
        """Do nothing: there is no zero."""


class Skin:
    """Collect the touches of one fingertip: from a reader's frames, by a toucher.

    Between `remember` and `forget` all touches are kept, otherwise only the newest.

    reader: a context manager with `take()` -> [(time [s], frame)] and `check(stale)`
    """

    def __init__(self, reader, toucher: Toucher) -> None:
        self.reader, self.toucher, self._failure = reader, toucher, None
        self.touches: deque[Touch] = deque(maxlen=1)
        self._broken = 0  # when `remember` was called

    def __enter__(self) -> Skin:
        self.reader.__enter__()
        return self

    def __exit__(self, *exception) -> None:
        self.reader.__exit__(*exception)

    @property
    def broken(self) -> int:
        """The number of frames since `remember` that could not be decoded."""
        return self._counted() - self._broken

    def _counted(self) -> int:
        """Return the count of the framer; a camera has none."""
        framer = getattr(self.reader, "framer", None)
        return 0 if framer is None else framer.broken

    def poll(self) -> None:
        """Read the frames of the sensor; raises the errors of the toucher."""
        for time, frame in self.reader.take():
            failed = isinstance(frame, ForceFrame) and frame.fault
            self._failure = frame.status if failed else None
            touch = self.toucher(time, frame)
            if touch is not None:
                self.touches.append(touch)

    def check(self, stale: float) -> None:
        """Raise StaleStreamError after a longer silence [s], SensorError for a failure.

        A failure is what the newest sample reports.
        """
        self.reader.check(stale)
        if self._failure is not None:
            raise SensorError(
                "the sensor reports a failure",
                where=self.reader.name,
                got=f"status 0x{self._failure:04X}",
                expected="bits 10 to 15 zero",
                next="check the sensor, its plug and its cable",
            )

    def reset(self) -> None:
        """Drop all frames and touches so far, and find the zero again."""
        self.reader.take()
        self.toucher.reset()
        self.touches.clear()
        self._failure = None

    def remember(self) -> None:
        """Drop all touches but the newest, and keep all new ones."""
        self.touches = deque(deque(self.touches, 1))
        self._broken = self._counted()

    def forget(self) -> None:
        """Drop all touches but the newest, and keep only the newest."""
        self.touches = deque(self.touches, 1)
