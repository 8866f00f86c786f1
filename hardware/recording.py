"""Read a recorded folder, by the same code that reads the wires."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import can
import numpy as np

from tactilenlp.common.whole_file import open_file

from .bus_files import DAMAGED, FORMATS, read_frames
from .clock import ClockMap, unwrap
from .errors import ClockError, RecordingError, translated
from .motor_board import MotorBoard
from .motor_can import Quantity
from .optical_flow import opencv
from .rig import CAMERA, ON_CAN, FingerRig, Rig, Tactile, stream_name
from .serial_reader import OptoForceCan
from .serial_tactile import RESTART, ForceFrame
from .streams import FingerStreams
from .tape import FORMAT, MANIFEST
from .touch import Touch

RESTARTED = 0.2  # [s] by which arrivals differ from counters where a sensor restarted
OTHER_RATE = 0.02  # [1], a larger deviation of a sensor's rate is no drift of its
# clock: RC oscillators of controllers are within 1 to 2 %
LONG = 0.5  # [s], least record from which the rate of a device's clock is fitted: over
# a shorter one the nominal rate of a clock that is 0.2 % off is wrong by 1 ms


class Recording:
    """Read a recorded folder; raises RecordingError if it is not one.

    `complete` says whether the recording ended without an error: then what is read of
    a stream is compared with what the manifest says was written.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        path = self.folder / MANIFEST
        fix = "`python -m hardware record`"
        with translated(RecordingError, "no recording", path, fix):
            with open_file(path, RecordingError) as stream:
                self.manifest = json.load(stream)
            form, rig = self.manifest["format"], self.manifest["rig"]
            self.complete = self.manifest["complete"] is True
            self._counts = {k: int(n) for k, n in self.manifest["counts"].items()}
        if form != FORMAT:
            raise RecordingError(
                "another format", where=str(path), got=f"{form}", expected=f"{FORMAT}"
            )
        self.rig = Rig.from_dict(rig)

    def fingers(self) -> list[FingerStreams]:
        """Return the streams of all fingers, as `assemble` takes them."""
        return [self._finger(one) for one in self.rig.fingers]

    def messages(self, stream: str) -> Iterator[can.Message]:
        """Yield the frames of one bus; raises RecordingError if the file is damaged.

        A recording that is not complete may end in the middle of a frame.
        """
        frames = read_frames(self._bus(stream), cut=not self.complete)
        yield from self._whole(stream, frames)

    def chunks(self, stream: str) -> Iterator[tuple[float, bytes]]:
        """Yield the time [s] and bytes of each chunk of a serial line."""
        yield from self._whole(stream, self._chunks(stream))

    def _chunks(self, stream: str) -> Iterator[tuple[float, bytes]]:
        raw = self._read(f"{stream}.bin")
        at = 0
        for time, size in self._rows(stream, _size):
            chunk = raw[at : at + size]
            if len(chunk) < size:
                return  # the last chunk is incomplete: the program was killed
            at += size
            yield time, chunk

    def pictures(self, stream: str) -> Iterator[tuple[float, np.ndarray]]:
        """Yield the time [s] and each picture of a camera."""
        yield from self._whole(stream, self._pictures(stream))

    def _pictures(self, stream: str) -> Iterator[tuple[float, np.ndarray]]:
        for time, name in self._rows(stream, _plain_name):
            path = self.folder / stream / name
            picture = opencv().imread(str(path), opencv().IMREAD_UNCHANGED)
            if picture is None:
                raise RecordingError(
                    "no picture", where=str(path), next="copy the recording again"
                )
            yield time, picture

    def _whole(self, stream: str, parts: Iterator) -> Iterator:
        """Yield all parts; RecordingError where a complete recording lacks some."""
        count = 0
        for count, part in enumerate(parts, start=1):  # noqa: B007 (used below)
            yield part
        written = self._counts.get(stream, 0)
        if self.complete and count < written:
            raise RecordingError(
                "a part of the recording is missing",
                where=f"{self.folder}, {stream}",
                got=f"{count} frames, chunks or pictures",
                expected=f"{written}, by {MANIFEST}",
                next='copy the folder again, or read what there is with "complete": '
                "false in the manifest",
            )

    def _finger(self, one: FingerRig) -> FingerStreams:
        boards = []
        for k in range(2):
            stream = stream_name(one.name, f"board {k}")
            board = MotorBoard({}, name=f"{one.name}, board {k}")
            for message in self.messages(stream):
                if message.is_rx is not False:
                    board.on_message_received(message)
            boards.append(board)
        rows = [board.rows(Quantity.POSITION) for board in boards]
        told = one.tactile.interval
        return FingerStreams.of(one, boards, rows, *self._touches(one), told)

    def _touches(self, one: FingerRig) -> tuple[list[Touch], int]:
        """Return the touches of a finger, and how many frames were broken."""
        stream, tactile = stream_name(one.name, "tactile"), one.tactile
        toucher, broken = tactile.toucher(), 0
        if tactile.wire == CAMERA:
            frames: Iterable = self.pictures(stream)
        else:
            frames, broken = self._frames(stream, tactile)
        touches = [toucher(time, frame) for time, frame in frames]
        return [touch for touch in touches if touch is not None], broken

    def _frames(self, stream: str, tactile: Tactile) -> tuple[list, int]:
        """Return the frames of a sensor with their times, and how many were broken."""
        if tactile.wire == ON_CAN:
            sensor = OptoForceCan(queue=None)
            for message in self.messages(stream):
                sensor.on_message_received(message)
            frames, framer = sensor.take(), sensor.framer
        else:
            framer = tactile.framer()
            frames = [
                (time, frame)
                for time, chunk in self.chunks(stream)
                for frame in framer.feed(chunk)
            ]
        if frames and isinstance(frames[0][1], ForceFrame):
            times = device_times(frames, tactile.interval)
            frames = [(t, f) for t, (_, f) in zip(times.tolist(), frames, strict=True)]
        return frames, framer.broken

    def _bus(self, stream: str) -> Path:
        for suffix in FORMATS:
            path = self.folder / f"{stream}.{suffix}"
            if path.is_file():
                return path
        files = " or ".join(f"{stream}.{suffix}" for suffix in FORMATS)
        raise RecordingError(
            "no such stream", where=str(self.folder), got=stream, expected=files
        )

    def _read(self, name: str) -> bytes:
        path = self.folder / name
        with _reading(path, OSError), open_file(path, RecordingError) as stream:
            return stream.read()

    def _rows(self, stream: str, read: Callable) -> Iterator[tuple[float, object]]:
        """Yield the complete rows of a table: the time [s], and what `read` makes."""
        text = self._read(f"{stream}.csv").decode(errors="replace")
        rows = csv.reader(text[: text.rfind("\n") + 1].splitlines()[1:])
        for row in rows:
            with _reading(self.folder / f"{stream}.csv", ValueError):
                time, what = row
                found = _finite(time), read(what)
            yield found


def device_times(frames: list[tuple[float, ForceFrame]], unit: float) -> np.ndarray:
    """Return host times (n,) [s] by the counters of the samples, not their arrival.

    A chunk holds many samples: their arrivals are equal, their counters are not.
    unit: [s] between samples.  A sensor that was restarted starts a new clock: its
    counter goes back or, where it had passed half its range, seems to skip samples for
    which no time has passed.  Raises ClockError where it sends at another rate.
    """
    arrival = np.array([time for time, _ in frames])
    counter = unwrap([frame.counter for _, frame in frames], 16)
    steps = np.diff(counter)
    apart = abs(np.diff(arrival) - unit * steps) > RESTARTED
    starts = np.flatnonzero((steps <= 0) | (steps >= RESTART - 1) | apart) + 1
    times = np.empty(len(frames))
    for part in np.split(np.arange(len(frames)), starts):
        times[part] = _line(counter[part], arrival[part], unit)
    return times


def _line(device: np.ndarray, host: np.ndarray, unit: float) -> np.ndarray:
    """Return the host times (n,) [s] of the counters (n,) of one clock.

    The rate is fitted where the record is long enough, nominal otherwise.
    """
    # Without what a host read at once after a pause: that came in no time.
    live = slice(min(np.searchsorted(host, host[0] + RESTARTED), len(host) - 1), None)
    heard, counts = np.ptp(host[live]), np.ptp(device[live])
    rate = heard / counts if abs(heard - unit * counts) > RESTARTED else unit
    times = unit * device + (host - unit * device).min()
    if heard >= LONG:
        line = ClockMap.fit(device[live], host[live], unit, drift=np.inf)
        rate, times = line.rate, line(device)
    if abs(rate / unit - 1) > OTHER_RATE:
        raise ClockError(
            "a sensor does not send at the rate told", where="tactile.speed",
            got=f"{rate:.4g} s between samples", expected=f"{unit:.4g} s",
            next="give the speed that the sensor has to the rig of the manifest",
        )  # fmt: skip
    return times


def _finite(text: str) -> float:
    """Return a finite number [s]; ValueError for any other text."""
    if not math.isfinite(number := float(text)):
        raise ValueError(f"the time {text!r} is not finite")
    return number


def _size(text: str) -> int:
    """Return a number of bytes; ValueError for any other text."""
    if (size := int(text)) < 0:
        raise ValueError(f"a chunk of {size} bytes")
    return size


def _plain_name(text: str) -> str:
    """Return the name of a file in the recording; ValueError for any other text."""
    if not text or Path(text).name != text or "\0" in text:
        raise ValueError(f"{text!r} is not the name of a file of this folder")
    return text


def _reading(path: Path, of: type[Exception]) -> AbstractContextManager:
    return translated(RecordingError, "cannot be read", path, DAMAGED, of)
