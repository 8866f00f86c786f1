"""Write all frames, bytes and pictures of a bench to a folder, in real time.

    manifest.json                  rig, versions, counts; written first and last
    <stream>.blf | .log            CAN, one file per bus (python-can reads them)
    <stream>.bin, <stream>.csv     serial bytes, and time and length of each chunk
    <stream>/f_00000.png, <stream>.csv     pictures (lossless), and their times

Data are on the disk when a sink returns (CAN: in blocks, see `bus_files`, and when the
tape is closed, at the end of `with`).
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import can
import numpy as np

from tactilenlp.common.validation import check_kind, check_one_of
from tactilenlp.common.whole_file import write_whole
from tactilenlp.errors import FileError, typed_call

from .bus_files import FORMATS, BusFile
from .errors import RecordingError
from .frames import NATURAL
from .rig import Rig

FORMAT = 1
MANIFEST = "manifest.json"
LIBRARIES = ("tactilenlp", "numpy", "python-can", "pyserial", "opencv-python-headless")


@typed_call(RecordingError)
class Tape:
    """Provide sinks for the drivers of a rig; `with` opens and closes the files.

    A stream is recorded once: a second bench needs a new tape.

    folder: must not hold a recording yet
    bus:    "blf" (compressed) or "log" (text, of can-utils)
    """

    def __init__(self, folder: str | Path, rig: Rig, bus: str = "blf") -> None:
        check_kind("folder", folder, (str, os.PathLike), RecordingError)
        check_kind("rig", rig, Rig, RecordingError)
        check_one_of("bus", bus, FORMATS, "no such format", RecordingError)
        self.folder, self.rig, self.bus = Path(folder), rig, bus
        self.counts: dict[str, int] = {}
        self._stack, self._failed = ExitStack(), None
        self._started = time.time()

    def __enter__(self) -> Tape:
        if (self.folder / MANIFEST).exists():
            fix = "give a new folder; recordings are not overwritten"
            where = str(self.folder)
            raise RecordingError("holds a recording already", where=where, next=fix)
        _written(self.folder, lambda: self.folder.mkdir(parents=True, exist_ok=True))
        self._write_manifest(complete=False)
        self._stack.push(self._end)  # called last, also where a file cannot be closed
        return self

    def __exit__(self, *exception) -> None:
        self._stack.__exit__(*(exception or (None,) * 3))

    def _end(self, kind: type | None, *exception) -> None:
        self._write_manifest(complete=kind is None and self._failed is None)

    def can(self, stream: str) -> Callable[[can.Message], None]:
        """Return a sink of CAN frames."""
        path = self._new(f"{stream}.{self.bus}")
        file = self._opened(path, lambda: BusFile(path))

        def sink(message: can.Message) -> None:
            self._write(path, file.write, message)
            self.counts[stream] += 1

        self.counts[stream] = 0
        return sink

    def bytes(self, stream: str) -> Callable[[bytes, float], None]:
        """Return a sink of chunks and their times [s]."""
        raw, row = self._open(f"{stream}.bin"), self._table(stream, "time,bytes")

        def sink(chunk: bytes, now: float) -> None:
            self._write(raw.name, _append, raw, chunk)
            row(f"{now:.9f},{len(chunk)}")
            self.counts[stream] += 1

        self.counts[stream] = 0
        return sink

    def pictures(self, stream: str) -> Callable[[np.ndarray, float], None]:
        """Return a sink of pictures and their times [s]."""
        folder, row = self._new(stream), self._table(stream, "time,name")
        _written(folder, folder.mkdir)

        def sink(picture: np.ndarray, now: float) -> None:
            name = NATURAL % self.counts[stream]
            self._write(folder / name, _write_picture, str(folder / name), picture)
            row(f"{now:.9f},{name}")
            self.counts[stream] += 1

        self.counts[stream] = 0
        return sink

    def sink(self, wire: str, stream: str):
        """Return the sink for a kind of wire (see rig.KINDS)."""
        make = {"can": self.can, "serial": self.bytes, "camera": self.pictures}[wire]
        return make(stream)

    def _open(self, name: str):
        path = self._new(name)
        return self._opened(path, lambda: path.open("xb", buffering=0))

    def _opened(self, path: Path, make: Callable):
        """Return a file that `with` closes at its end."""
        file = _written(path, make)
        self._stack.callback(_written, path, file.close)
        return file

    def _write(self, path, action: Callable, *parts) -> None:
        """Write; after a failure, of a full disk for instance, refuse all that follows.

        What came before can be read: `chunks` needs whole chunks, one after the other.
        """
        if self._failed is not None:
            raise self._failed
        try:
            _written(path, action, *parts)
        except RecordingError as bad:
            self._failed = bad
            raise

    def _new(self, name: str) -> Path:
        """Return the path of a file; raises RecordingError where there is one."""
        if (path := self.folder / name).exists():
            fix = "give a new folder to each bench; recordings are not overwritten"
            raise RecordingError("is recorded already", where=str(path), next=fix)
        return path

    def _table(self, stream: str, heading: str) -> Callable[[str], None]:
        table = self._open(f"{stream}.csv")

        def row(text: str) -> None:
            self._write(table.name, _append, table, f"{text}\n".encode())

        row(heading)
        return row

    def _write_manifest(self, complete: bool) -> None:
        content = {
            "format": FORMAT,
            "started": self._started,
            "ended": time.time() if self.counts else None,
            "complete": complete,
            "counts": self.counts,
            "versions": {name: _version(name) for name in LIBRARIES},
            "python": platform.python_version(),
            "rig": asdict(self.rig),
        }
        path = self.folder / MANIFEST
        text = json.dumps(content, indent=2) + "\n"
        _written(path, lambda: write_whole(path, text))


def _append(file, content: bytes) -> None:
    """Write all bytes: an unbuffered file takes what the disk has room for."""
    while content:
        content = content[file.write(content) :]


def _write_picture(path: str, picture: np.ndarray) -> None:
    from .optical_flow import opencv  # an extra

    if not opencv().imwrite(path, picture):
        raise OSError("OpenCV cannot write it")


def _written(path, action: Callable, *parts):
    """Run an action that writes; where it fails, raise a RecordingError."""
    try:  # `translated` would take longer, and this is done for every frame
        return action(*parts)
    except (OSError, FileError) as bad:
        got, fix = f"{type(bad).__name__}: {bad}", "check free space and permissions"
        what = "cannot be written"
        raise RecordingError(what, where=str(path), got=got, next=fix) from bad


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None  # an extra
