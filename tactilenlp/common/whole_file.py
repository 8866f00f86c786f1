"""Write a file completely or not at all; open one for reading if it is a file."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import FileError, NoFileError, WriteError, did_you_mean
from .validation import check_path

MIN_FREE_SPACE = 10e6  # [bytes] where a result is to be saved
SHOWN = 60  # characters of a name that a temporary file repeats


@contextmanager
def whole_file(path):
    """Open a temporary file for bytes that replaces `path` when the block ends.

    Its name is unique, as another program may be writing to the same path.  What was
    there before stays until the new content is on the disk, and stays for good if the
    block raises or the disk is full; no temporary file is left.  A symbolic link stays
    one: the file that it points to is replaced.  Raises FileError, WriteError.
    """
    check_path(path)
    target = _target(path)
    try:
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.name[:SHOWN]}."
        )
    except (OSError, ValueError) as bad:
        raise _not_written(path, bad) from bad
    try:
        with os.fdopen(handle, "wb") as part:
            yield part
            part.flush()
            os.fsync(part.fileno())
        os.chmod(name, _mode(target))
        os.replace(name, target)
    except OSError as bad:
        raise _not_written(path, bad) from bad
    finally:  # after Ctrl-C as well; there is none once it has replaced the target
        with suppress(OSError):
            Path(name).unlink(missing_ok=True)


def open_file(path, error: type = FileError):
    """Open a regular file for reading bytes; `error` if it is none or cannot be read.

    A pipe or a device, which would block, is not opened.  NoFileError where there is no
    such file, with names like it.
    """
    check_path(path)
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISREG(mode):
            return open(path, "rb")  # the caller closes it
    except FileNotFoundError as bad:
        there = sorted(one.name for one in Path(path).absolute().parent.glob("*"))
        raise NoFileError(
            "no such file", where=str(path), got="nothing there",
            expected="the path of a file",
            next=did_you_mean(Path(path).name, there) or "check folder and name",
        ) from bad  # fmt: skip
    except (OSError, ValueError) as bad:
        got = f"{type(bad).__name__}: {bad}"
        raise error("cannot be opened", where=repr(str(path)), got=got) from bad
    got = "a folder" if stat.S_ISDIR(mode) else "a pipe or a device"
    raise error("not a file", where=str(path), got=got, expected="the path of a file")


def write_whole(path, content: bytes | str) -> None:
    """Write bytes, or text in UTF-8, completely or not at all; raises WriteError."""
    with whole_file(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def _target(path) -> Path:
    """Return the file that is to be replaced; FileError if it is no regular file."""
    try:
        check_folder(path, str(path))
        target = Path(os.path.realpath(path))
        other = target.exists() and not target.is_file()
    except FileError:
        raise
    except (OSError, ValueError) as bad:  # a name that is too long, or has a NUL
        raise _not_written(path, bad) from bad
    if other:
        raise FileError(
            "not a file", where=str(path), got="a folder, a pipe or a device",
            expected="a new path, or a regular file to replace",
        )  # fmt: skip
    return target


def _not_written(path, bad: Exception) -> WriteError:
    """Return the error for a file that the system does not write."""
    return WriteError(
        "cannot be written", where=str(path), got=f"{type(bad).__name__}: {bad}",
        next="free space, or write elsewhere; what was there before is unchanged",
    )  # fmt: skip


def check_folder(path, where: str) -> None:
    """Raise FileError unless the folder of a file to be written exists."""
    folder = Path(path).absolute().parent
    if not folder.is_dir():
        raise FileError(
            "no such folder", where=where, got=str(folder),
            expected="a file in a folder that exists",
            next="make the folder, or write elsewhere",
        )  # fmt: skip
    if Path(path).is_dir():  # an empty path is the current folder
        expected = "the path of a file"
        got = repr(str(path))
        raise FileError("a folder", where=where or "path", got=got, expected=expected)


def _mode(path: Path) -> int:
    """Return the permissions of the file to be replaced, or those of new files."""
    if path.exists():
        return stat.S_IMODE(path.stat().st_mode)
    mask = os.umask(0)  # cannot be read without being set
    os.umask(mask)
    return 0o666 & ~mask


def check_file(file, where: str) -> None:
    """Raise FileError unless this file can be written: its folder, and some space."""
    check_folder(file, where)
    folder = Path(file).absolute().parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            free = shutil.disk_usage(folder).free
    except OSError as bad:
        raise FileError(
            "cannot be written", where=where, got=f"{type(bad).__name__}: {bad}",
            expected="a folder in which files can be made", next="write elsewhere",
        ) from bad  # fmt: skip
    if free < MIN_FREE_SPACE:
        raise FileError(
            "too little space", where=where, got=f"{free / 1e6:.1f} MB",
            expected=f"{MIN_FREE_SPACE / 1e6:.0f} MB or more", next="write elsewhere",
        )  # fmt: skip
