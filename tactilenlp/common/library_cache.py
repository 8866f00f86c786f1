"""The folder of compiled libraries: a library is loaded only if it is whole and ours.

A library is code that runs in this process.  Folder and files must belong to this user
and be writable by nobody else.  Beside each library stands the SHA-256 digest of its
name and content, which is checked before it is loaded: a damaged one would end the
process by a signal.  Both are written to a temporary name and renamed, the digest last,
so that a process that dies leaves no half of either.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

OTHERS = stat.S_IWGRP | stat.S_IWOTH  # write permission of anybody else
ROOT = 0  # the user who can change everything anyway
UNFINISHED = "unfinished-"  # of the folders in which libraries are compiled
ABANDONED = 3600.0  # [s] after which such a folder belongs to no running process


def cache_folder() -> Path:
    """Return the folder of compiled libraries: $XDG_CACHE_HOME or ~/.cache.

    A relative $XDG_CACHE_HOME is ignored, as its specification demands.  Raises OSError
    where there is no home folder.
    """
    root = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not root.is_absolute():
        try:
            root = Path.home() / ".cache"
        except RuntimeError as error:
            raise FileNotFoundError("this user has no home folder") from error
    if not root.is_absolute():
        raise FileNotFoundError(f"the home folder is not absolute: {root}")
    return root / "tactilenlp"


def trusted_folder() -> Path:
    """Return the folder, made with permissions 0700; OSError if it is not to trust."""
    folder = cache_folder()
    folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    _check_owner(folder, os.stat(folder))
    above = os.stat(folder.parent)
    if above.st_uid not in (ROOT, os.geteuid()):
        raise PermissionError(f"{folder.parent} belongs to another user")
    if above.st_mode & stat.S_IWOTH and not above.st_mode & stat.S_ISVTX:
        raise PermissionError(f"{folder.parent} can be changed by other users")
    return folder


def is_whole(library: Path) -> bool:
    """Tell whether a library and its digest are there and agree.

    Raises OSError if one of them is no file, cannot be read or is not to trust.
    """
    try:
        content = _read(library)
        digest = _read(_digest_file(library))
    except FileNotFoundError:
        return False
    return digest == _digest(library.name, content)


def store(built: Path, library: Path) -> None:
    """Move a compiled library, then its digest, to their places, each atomically."""
    digest = built.with_suffix(".sha256")
    digest.write_bytes(_digest(library.name, built.read_bytes()))
    for file in (built, digest):
        file.chmod(0o600)
    _digest_file(library).unlink(missing_ok=True)  # of a library that was damaged
    os.replace(built, library)  # another process may have done the same
    os.replace(digest, _digest_file(library))


def discard(library: Path) -> None:
    """Delete a library and its digest, if they are there."""
    for file in (_digest_file(library), library):
        file.unlink(missing_ok=True)


@contextmanager
def workspace(folder: Path) -> Iterator[Path]:
    """Make a temporary folder for a compiler; delete those that were abandoned.

    A process that was forked leaves the folder to its parent.
    """
    for old in folder.glob(f"{UNFINISHED}*"):
        if time.time() - old.stat().st_mtime > ABANDONED:
            shutil.rmtree(old, ignore_errors=True)
    made, owner = tempfile.mkdtemp(prefix=UNFINISHED, dir=folder), os.getpid()
    try:
        yield Path(made)
    finally:
        if os.getpid() == owner:
            shutil.rmtree(made, ignore_errors=True)


def _digest_file(library: Path) -> Path:
    """Return the file that holds the digest of a library."""
    return library.with_suffix(".sha256")


def _digest(name: str, content: bytes) -> bytes:
    """Return the digest in hexadecimal; the name stands for what was compiled."""
    return hashlib.sha256(name.encode() + b"\0" + content).hexdigest().encode()


def _read(path: Path) -> bytes:
    """Return the content of a file of this user; OSError of anything else."""
    # A FIFO would block, and a link may lead to what is not checked.
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(file, "rb") as opened:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise PermissionError(f"{path} is not a file")
        _check_owner(path, status)
        return opened.read()


def _check_owner(path: Path, status: os.stat_result) -> None:
    """Raise PermissionError unless only this user can change a file or folder."""
    if status.st_uid != os.geteuid():
        raise PermissionError(f"{path} belongs to another user")
    if status.st_mode & OTHERS:
        raise PermissionError(f"{path} can be changed by other users (chmod go-w)")
