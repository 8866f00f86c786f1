"""A lock of a file that several processes could write: one of them at a time.

The lock is the operating system's (flock) of a file beside it, `name.lock`, which holds
the number of the process that has it.  It ends with that process, however it ends; a
file `name.lock` that was left behind locks nothing.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import FileError

LONGEST_NUMBER = 20  # characters of the number of a process
HELD = (errno.EACCES, errno.EAGAIN)  # of flock, where another process has the lock
_held: set[int] = set()  # descriptors of locks that this process has


def _release_in_child() -> None:
    """Close the locks in a forked process: they are its parent's."""
    for lock in _held:
        os.close(lock)
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_release_in_child)


@contextmanager
def locked(file) -> Iterator[None]:
    """Hold the lock of a file within a block.

    Raises FileError, which names the process, if another one has it; also if this
    process has it already, or the folder cannot be written.  Without effect on Windows.
    """
    if os.name == "nt":  # it has no flock
        yield
        return
    path = Path(os.path.realpath(file))  # one lock, whatever links lead to the file
    path = path.with_name(f"{path.name}.lock")
    lock = _acquired(path, file)
    _held.add(lock)
    try:
        yield
    finally:
        if lock in _held:  # not in a forked process
            _held.remove(lock)
            path.unlink(missing_ok=True)
            os.close(lock)


def can_be_written(file) -> bool:
    """Tell whether the folder of a file can be written."""
    return os.access(Path(os.path.realpath(file)).parent, os.W_OK)


def _acquired(path: Path, file) -> int:
    """Return the descriptor of a lock file that is locked."""
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    while True:
        try:
            lock = os.open(path, flags, 0o600)
        except OSError as bad:
            raise _not_locked(file, bad) from bad
        try:
            if _is_locked(lock, path, file):
                return lock
        except BaseException:
            os.close(lock)
            raise
        os.close(lock)


def _is_locked(lock: int, path: Path, file) -> bool:
    """Lock an open file; False if its owner has deleted it meanwhile."""
    import fcntl

    if not stat.S_ISREG(os.fstat(lock).st_mode):
        raise _not_locked(file, OSError(f"{path} is no file"))
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as bad:
        if bad.errno not in HELD:
            raise _not_locked(file, bad) from bad
        number = os.pread(lock, LONGEST_NUMBER, 0).decode(errors="replace").strip()
        who = "this process" if number == str(os.getpid()) else "another process"
        raise FileError(
            f"in use by {who}", where=str(file), got=f"process {number or 'unknown'}",
            expected="one process at a time that explores or studies into a file",
            next="wait for it or end it, or give another file",
        ) from bad  # fmt: skip
    try:
        if not os.path.samestat(os.stat(path), os.fstat(lock)):
            return False
    except FileNotFoundError:
        return False
    os.ftruncate(lock, 0)
    os.pwrite(lock, str(os.getpid()).encode(), 0)
    return True


def _not_locked(file, bad: OSError) -> FileError:
    """Return the error for a file that the system does not lock."""
    return FileError(
        "cannot be locked", where=str(file), got=f"{type(bad).__name__}: {bad}",
        expected="a folder that can be written, of a file system with locks",
        next="give a file in another folder",
    )  # fmt: skip
