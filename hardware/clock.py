"""Map the clocks of devices to the time of the host.

A sample with device stamp d arrives at the host at h = a d + b + delay, delay >= 0: the
clock is the line below all points (d, h), and the distance above it is the delay.  The
map is therefore the edge of the lower convex hull over the middle of the record, not a
least-squares line, which a few late samples bias upward.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tactilenlp.common.validation import check_range, check_whole, numbers_of

from .errors import ClockError

log = logging.getLogger(__name__)
LARGEST_DRIFT = 1e-3  # [1]; quartz drifts by 1e-4 at most; larger: wrong unit
STEP = 1e-3  # [s], a larger change between wall clock and run time is a step
FOREIGN = 10.0  # [s] from the wall clock: a stamp of another clock
READS = 3  # attempts to read two clocks at one instant


class Clock(Protocol):
    """Tell the time of a run and wait: HostClock, or that of a simulated robot.

    now:  [s], never steps: control, ages and time-outs use it alone
    wall: [s], the time of day, which may step: the operating system stamps with it
    """

    def now(self) -> float: ...

    def wall(self) -> float: ...

    def sleep(self, duration: float) -> None: ...


class HostClock:
    """The monotonic clock of this computer, shifted once to the time of day.

    The shift is sampled when the clock is made: stamps of a run read as CLOCK_REALTIME
    [s], and a step of the wall clock (NTP, an operator) does not reach the control.
    """

    def __init__(self) -> None:
        self._shift = time.time() - time.monotonic()

    def now(self) -> float:
        """Return the time [s] of the run; it never runs backward."""
        return time.monotonic() + self._shift

    def wall(self) -> float:
        """Return CLOCK_REALTIME [s], which may step."""
        return time.time()

    def sleep(self, duration: float) -> None:
        """Wait for a duration [s]."""
        time.sleep(max(duration, 0.0))


class WallStamps:
    """Map stamps of the wall clock to the time of the run, across its steps.

    A frame that is read now came after the previous reading of all frames: where the
    wall clock was stepped in between, that tells whether its stamp is of before or
    after the step.  A stamp of another clock (gs_usb: seconds since it was plugged in)
    cannot be mapped: the frame has the time of its reading.
    Call `look` after every reading, then the object with each stamp.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._latest, offset = self._read()
        self._earliest, self._offsets = self._latest, (offset, offset)
        self._all, self._warned = True, False

    def look(self, all_read: bool = True) -> None:
        """Read both clocks: all stamps that are mapped next are not later than now.

        all_read: whether no frame was left for the next reading
        """
        if self._all:
            self._earliest, self._offsets = self._latest, self._offsets[1:] * 2
        self._latest, offset = self._read()
        self._offsets, self._all = (self._offsets[0], offset), all_read

    def __call__(self, stamp: float) -> float:
        """Return the time [s] of the run that a stamp [s] of the wall clock means."""
        before, after = self._offsets
        times = sorted((stamp - before, stamp - after), key=self._outside)
        if self._outside(times[0]) > FOREIGN:
            if not self._warned:
                log.warning("a stamp of another clock, %.3f s: not used", stamp)
            self._warned = True
            return self._latest
        if abs(after - before) < STEP:
            return stamp - after
        return min(max(times[0], self._earliest), self._latest)

    def _outside(self, time: float) -> float:
        """Return by how much [s] a time lies outside the last two readings."""
        return max(self._earliest - time, time - self._latest, 0.0)

    def _read(self) -> tuple[float, float]:
        """Return the time of the run and the wall clock's lead [s], at one instant."""
        tries = []
        for _ in range(READS):
            before, wall, after = (
                self._clock.now(),
                self._clock.wall(),
                self._clock.now(),
            )
            tries.append((after - before, after, wall - (before + after) / 2))
        return min(tries)[1:]


@dataclass(frozen=True)
class ClockMap:
    """host = rate * (device - origin) + start.

    rate:     [s of the host per unit of the device]
    origin:   [units of the device]
    start:    [s] of the host
    residual: [s], median delay above the line: jitter of the transport
    """

    rate: float
    origin: float
    start: float
    residual: float

    def __call__(self, device: np.ndarray) -> np.ndarray:
        """Return the host times [s] of device times."""
        return self.rate * (np.asarray(device, float) - self.origin) + self.start

    @classmethod
    def fit(
        cls,
        device: np.ndarray,
        host: np.ndarray,
        unit: float = 1.0,
        drift: float = LARGEST_DRIFT,
    ) -> ClockMap:
        """Return the map under device times (n,) [unit s] and arrivals (n,) [s].

        unit:  [s], nominal length of a unit of the device
        drift: [1], largest deviation from it

        The least delay of the transport is not observable and stays in the map.  Raises
        ClockError for fewer than two times, times that run backwards, and a larger
        drift.
        """
        device = numbers_of("device", device, ClockError, "n", finite=True)
        host = numbers_of("host", host, ClockError, "n", finite=True)
        check_range("unit", unit, 1e-12, 1e9, "s", ClockError)
        _check(device, host)
        unit = float(unit)
        origin, start = device[0], host[0]
        x, y = device - origin, host - start  # small numbers keep all digits
        hull = _lower_hull(x, y)
        middle = (x[0] + x[-1]) / 2
        edge = min(np.searchsorted(x[hull], middle, side="right"), len(hull) - 1)
        left, right = hull[edge - 1], hull[edge]
        rate = (y[right] - y[left]) / (x[right] - x[left])
        if not abs(rate / unit - 1) <= drift:
            raise ClockError(
                "the device's clock does not run with the host's",
                where="device, host",
                got=f"{rate:.6g} s per unit",
                expected=f"{unit:.6g} s within {drift:g}",
                next="check the unit of the stamps, or record for longer",
            )
        offset = y[left] - rate * x[left]
        residual = float(np.median(y - rate * x - offset))
        return cls(float(rate), float(origin), float(start + offset), residual)


def unwrap(counter: np.ndarray, bits: int) -> np.ndarray:
    """Return counts (n,) without the wraps of an unsigned counter of so many bits.

    Gaps shorter than half the range are resolved; a step of 1 means no sample is lost.
    """
    check_whole("bits", bits, 1, 62, ClockError)
    values, size = numbers_of("counter", counter, ClockError, "n"), 1 << bits
    if values.size and not (values.min() >= 0 and values.max() < size):
        raise ClockError(
            "no such counter", where="counter", got=values.max(),
            expected=f"{bits} unsigned bits", next="tell the bits of the counter",
        )  # fmt: skip
    return np.unwrap(values.astype(np.int64), period=size)


def _check(device: np.ndarray, host: np.ndarray) -> None:
    if not (device.shape == host.shape and len(device) > 1):
        raise ClockError(
            "no pairs of times",
            where="device, host",
            got=f"shapes {device.shape} and {host.shape}",
            expected="two arrays (n,), n > 1",
        )
    if not (np.diff(device) > 0).all():
        raise ClockError(
            "device times do not increase",
            where="device",
            got=f"a step of {np.diff(device).min():g}",
            expected="steps above zero",
            next="unwrap the counter, drop doubles",
        )


def _lower_hull(x: np.ndarray, y: np.ndarray) -> list[int]:
    """Return the indices of the lower convex hull, x increasing (Andrew's chain)."""
    hull: list[int] = []
    for k in range(len(x)):
        while len(hull) > 1 and _turns_down(x, y, hull[-2], hull[-1], k):
            hull.pop()
        hull.append(k)
    return hull


def _turns_down(x: np.ndarray, y: np.ndarray, a: int, b: int, c: int) -> bool:
    return (x[b] - x[a]) * (y[c] - y[a]) <= (x[c] - x[a]) * (y[b] - y[a])


def near_samples(known, time, largest: float, rounding: float = 0.0) -> np.ndarray:
    """Return whether times (n,) [s] are between close samples, or those of a sample.

    known: (m,) [s], sorted, two or more; largest [s]: between two that are close;
    rounding [s]: of stamps.
    """
    after = np.clip(np.searchsorted(known, time), 1, len(known) - 1)
    ends = known[[after - 1, after]]  # (2, n)
    of_sample = (abs(ends - time) <= rounding).any(axis=0)
    return of_sample | (np.diff(ends, axis=0)[0] <= largest)
