"""Hold the samples of the wires of one finger, sorted, in host time, with counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .errors import FrameError
from .kinematics import Finger
from .motor_joints import JointMap
from .touch import Touch

if TYPE_CHECKING:
    from .motor_board import MotorBoard
    from .rig import FingerRig

BLOCK = 5000  # [rows] that are made an array at once: 5 ms
# Columns of a stream of touches; NORMAL in the frame of the tip.
CONTACT, VALID, STRENGTH, NORMAL, DECIDED = 0, 1, 2, slice(3, 6), 6
LOST = 1.5  # [1], ratio to the told or median interval from which samples are lost


@dataclass(frozen=True)
class StreamReport:
    """Count the samples of one stream, and what is missing.

    samples, doubles, disordered: counts; doubles have the same stamp and are dropped,
                disordered ones are sorted in
    lost:       samples missing, by the intervals: beyond that of the told rate, or else
                beyond the median
    broken:     frames that could not be decoded, as the framer counted them
    rate:       [Hz], of the median interval
    jitter:     [s], from the 5th to the 95th percentile of the intervals
    largest_gap: [s]
    """

    name: str
    samples: int
    doubles: int
    disordered: int
    lost: int
    broken: int
    rate: float
    jitter: float
    largest_gap: float

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.samples} samples at {self.rate:.1f} Hz, "
            f"jitter {1e3 * self.jitter:.1f} ms, largest gap "
            f"{1e3 * self.largest_gap:.0f} ms, {self.lost} lost, {self.broken} broken, "
            f"{self.doubles} double, {self.disordered} out of order"
        )


@dataclass(frozen=True, eq=False)
class Stream:
    """Hold samples of one wire: time (n,) [s] increasing, values (n, ...)."""

    time: np.ndarray
    values: np.ndarray
    report: StreamReport

    @classmethod
    def sorted(
        cls,
        name: str,
        time: np.ndarray,
        values: np.ndarray,
        broken: int = 0,
        last: bool = False,
        interval: float | None = None,
    ) -> Stream:
        """Sort by time, keep the first (or last) of equal stamps, and count.

        interval: [s] between two samples, None: the median
        Raises FrameError where there are fewer than two different times.
        """
        time, values = np.asarray(time, float), np.asarray(values)
        finite = np.isfinite(time).all()
        order = np.argsort(time, kind="stable")
        disordered = int((np.diff(time) < 0).sum())
        time, values = time[order], values[order]
        ends = {"append": np.inf} if last else {"prepend": -np.inf}
        fresh = np.diff(time, **ends) > 0
        doubles = int((~fresh).sum())
        time, values = time[fresh], values[fresh]
        if len(time) < 2 or not finite:
            raise FrameError(
                "too few samples",
                where=name,
                got=f"{len(time)} samples",
                expected="two finite times or more",
                next="check that the device was connected, told to send, and read",
            )
        gaps = np.diff(time)
        usual = float(np.median(gaps))
        told = interval or usual
        lost = int(np.where(gaps > LOST * told, np.rint(gaps / told) - 1, 0).sum())
        low, high = np.percentile(gaps, [5, 95])
        counts = len(time), doubles, disordered, lost, broken
        spread = 1 / usual, float(high - low), float(gaps.max())
        return cls(time, values, StreamReport(name, *counts, *spread))


@dataclass(frozen=True, eq=False)
class FingerStreams:
    """Hold the streams of one finger.

    boards: two streams of motor positions (n, 2) [rev]
    touch:  a stream of rows (7,), see `touch_stream`
    latency: [s] from touch to stamp
    """

    name: str
    geometry: Finger
    joints: JointMap
    boards: tuple[Stream, Stream]
    touch: Stream
    latency: float = 0.0

    @classmethod
    def of(
        cls,
        rig: FingerRig,
        boards: Sequence[MotorBoard],
        rows: list[list[tuple[float, float, float]]],
        touches: list[Touch],
        broken: int = 0,
        interval: float | None = None,
    ) -> FingerStreams:
        """Return what a finger sent as sorted streams; FrameError for fewer than two.

        rows:   of stamp [s] and two positions [rev], for each board.  Frames without
                times of their own have that of their reading: the last one is of then
        broken: frames of the sensor that could not be decoded
        interval: [s] between samples of the sensor, None: not known
        """
        streams = []
        for board, sent in zip(boards, rows, strict=True):
            known = _table(sent)
            counted = known[:, 0], known[:, 1:], board.broken
            streams.append(Stream.sorted(board.name, *counted, last=True))
        touch = touch_stream(f"{rig.name}, tactile", touches, broken, interval)
        places, latency = (rig.geometry, rig.joints), rig.tactile.latency
        return cls(rig.name, *places, tuple(streams), touch, latency)

    @property
    def reports(self) -> tuple[StreamReport, ...]:
        """The reports of all three streams."""
        return tuple(stream.report for stream in (*self.boards, self.touch))


def touch_stream(
    name: str, touches: list[Touch], broken: int = 0, interval: float | None = None
) -> Stream:
    """Return touches as a stream; a touch whose normal is unknown is not valid.

    The last column, DECIDED, tells whether the sensor could decide on contact.  A chunk
    of a serial line holds several samples with one time of arrival: the last one is of
    that time.
    """
    values = np.zeros((len(touches), 7))  # no lists: the collector would stop for them
    for k, touch in enumerate(touches):
        known = touch.valid and (not touch.contact or bool(touch.normal.any()))
        values[k, CONTACT], values[k, VALID] = touch.contact and known, known
        values[k, STRENGTH], values[k, NORMAL] = touch.strength, touch.normal
        values[k, DECIDED] = touch.valid
    times = [touch.time for touch in touches]
    return Stream.sorted(name, times, values, broken, True, interval)


def _table(rows: list) -> np.ndarray:
    """Return rows of a board as an array (n, 3), made in parts.

    While a part is made no other thread runs, and one of them holds the fingers.
    """
    starts = range(0, max(len(rows), 1), BLOCK)
    parts = [np.array(rows[k : k + BLOCK], float).reshape(-1, 3) for k in starts]
    return np.concatenate(parts)
