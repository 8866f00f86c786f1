"""Write and read the frames of one CAN bus: .blf (compressed) or .log (can-utils).

A .blf holds times relative to the start time in its header, which python-can writes
when the file is closed: a process that is killed would leave times without an origin.
Here the header is on the disk before the first frame.  What else survives SIGKILL: all
but the last 8 kB of a bus: the frames of 43 ms of a board that sends all it measures.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from copy import copy
from pathlib import Path

import can

from .errors import RecordingError, translated

FORMATS = ("blf", "log")
BLOCK = 8192  # [bytes] of a .blf before compression: 4 % longer files than with 128 kB
EARLIER = 1.0  # [s] before the first frame: frames may be written in another order
DAMAGED = "check that the file is complete"
ABSOLUTE = 1e9  # [s], the year 2001: smaller stamps are no time of day


class BusFile:
    """Write frames to a new file; raises FileExistsError where there is one."""

    def __init__(self, path: Path) -> None:
        self._path, self._blf, self._begun = path, path.suffix == ".blf", False
        if self._blf:
            self._file = path.open("xb")
            self._writer = can.BLFWriter(self._file)
        else:
            self._file = path.open("x", encoding="utf-8")
            self._writer = can.CanutilsLogWriter(self._file)
        self._file.flush()

    def write(self, message: can.Message) -> None:
        """Write one frame."""
        row = copy(message)
        row.channel = None  # one file per bus; a log cannot hold every name
        if self._blf and not self._begun:
            self._begin(message.timestamp)
        self._writer.on_message_received(row)
        if self._blf:
            self._file.flush()  # does nothing but after a block

    def close(self) -> None:
        """Write what remains, and close the file, whose disk may be full."""
        try:
            self._writer.stop()
        finally:
            self._file.close()

    def _begin(self, stamp: float) -> None:
        """Write a header with the start time, then continue that file.

        A marker, as any object, makes `stop` write the start time; a writer that
        appends takes the start time from the header.  All of this is public.
        """
        self._writer.stop()
        with can.BLFWriter(self._path.open("wb")) as first:
            first.log_event("begin", stamp - EARLIER)
        self._file, self._begun = self._path.open("rb+"), True
        self._writer = can.BLFWriter(self._file, append=True, max_container_size=BLOCK)


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
