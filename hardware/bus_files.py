"""Write and read the frames of one CAN bus: .blf (compressed) or .log (can-utils).

A .blf holds times relative to the start time in its header, which python-can writes
when the file is closed: a process that is killed would leave times without an origin.
Here a header with a start time is on the disk before the first frame.  What else
survives SIGKILL: all but the last 8 kB of a bus, the frames of 43 ms of a board that
sends all it measures.
"""

from __future__ import annotations

import io
import threading
from collections import deque
from collections.abc import Iterator
from copy import copy
from pathlib import Path

import can

from .errors import RecordingError, translated

FORMATS = ("blf", "log")
CONTAINER = 8192  # [bytes] before compression: files 4 % longer than with 128 kB
FILE_BEGIN = 1.5e9  # [s], 2017: before all frames, so near that stamps keep all digits
DAMAGED = "check that the file is complete"
ABSOLUTE = 1e9  # [s], the year 2001: smaller stamps are no time of day


class BusFile:
    """Write frames to a new file; raises FileExistsError where there is one.

    A stop, by a signal handler or in another thread, may write while a frame is being
    written, and an interruption (Ctrl-C) may end that: the file stays whole.
    """

    def __init__(self, path: Path) -> None:
        self._blf = path.suffix == ".blf"
        if self._blf:
            with can.BLFWriter(path.open("xb")) as header:
                header.start_timestamp = FILE_BEGIN
            self._file = path.open("rb+")
            self._writer = can.BLFWriter(self._file, append=True)
            self._writer.max_container_size = CONTAINER
        else:
            self._file = path.open("x", encoding="utf-8")
            self._writer = can.CanutilsLogWriter(self._file)
        self._file.flush()
        self._waiting: deque[can.Message] = deque()
        self._writing = threading.Lock()

    def write(self, message: can.Message) -> None:
        """Write one frame; raises RecordingError for a time that a .blf cannot hold."""
        if self._blf and message.timestamp < FILE_BEGIN:
            raise RecordingError(
                "a time before the start of the file", where="timestamp",
                got=f"{message.timestamp:.3f} s",
                expected=f"{FILE_BEGIN:g} s (2017) or more",
                next='set the clock of the host, or record with bus="log"',
            )  # fmt: skip
        row = copy(message)
        row.channel = None  # one file per bus; a log cannot hold every name
        self._waiting.append(row)
        if self._writing.acquire(blocking=False):  # or who writes now writes it too
            try:
                self._drain()
            finally:
                self._writing.release()

    def close(self) -> None:
        """Write what remains, and close the file, whose disk may be full."""
        try:
            self._drain()
        finally:
            try:
                self._writer.stop()
            finally:
                self._file.close()

    def _drain(self) -> None:
        """Write all frames that wait."""
        while self._waiting:
            row = self._waiting.popleft()
            if self._blf:
                self._put(row)
            else:
                self._writer.on_message_received(row)

    def _put(self, row: can.Message) -> None:
        """Write a frame to a .blf, or leave the file and its writer as they were.

        python-can writes an object in several parts: half of one would make the block
        unreadable.
        """
        before, place = vars(self._writer).copy(), self._file.tell()
        parts = len(self._writer._buffer)  # of a block, which python-can appends to
        try:
            self._writer.on_message_received(row)
            self._file.flush()  # does nothing but after a block
        except Exception:
            raise
        except BaseException:
            vars(self._writer).update(before)
            del self._writer._buffer[parts:]
            self._file.seek(place)
            self._file.truncate()
            self._waiting.appendleft(row)
            raise


def read_frames(path: Path, cut: bool) -> Iterator[can.Message]:
    """Yield the frames of a file; raises RecordingError where it is damaged.

    cut: whether the file may end in the middle of a line or block, as after SIGKILL
    """
    # python-can passes on any error of its parsers
    told = translated(RecordingError, "cannot be read", path, DAMAGED)
    with told, _reader(path, cut) as reader:
        for message in _until_cut(reader) if cut else reader:
            if path.suffix == ".blf" and message.timestamp < ABSOLUTE:
                raise RecordingError(
                    "the times have lost their origin",
                    where=str(path),
                    got=f"{message.timestamp:.3f} s",
                    expected=f"{ABSOLUTE:g} s or more",
                    next="record again: the program that recorded was killed",
                )
            yield message


def _reader(path: Path, cut: bool) -> can.io.generic.MessageReader:
    if path.suffix == ".blf":
        return can.BLFReader(path)
    text = _WholeLines if cut else io.TextIOWrapper
    return can.CanutilsLogReader(text(path.open("rb"), encoding="utf-8"))


def _until_cut(reader: can.io.generic.MessageReader) -> Iterator[can.Message]:
    """Yield all frames; an error is the end where the file ends there, too."""
    try:
        yield from reader
    except Exception:
        if reader.file.read(1):
            raise


class _WholeLines(io.TextIOWrapper):
    """Give the lines of a text, but not a last one without its end."""

    def __next__(self) -> str:
        if not (line := super().__next__()).endswith("\n"):
            raise StopIteration
        return line
