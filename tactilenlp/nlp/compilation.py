"""Compilers that run beside this process, one for each core.

A compilation is begun where there is time for it, waited for where its functions are
needed, and ended with the process.  A process that is forked leaves those of its parent
alone.
"""

from __future__ import annotations

import atexit
import logging
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from threading import Lock

from ..common.deadline import Deadline
from ..common.library_cache import store, workspace

log = logging.getLogger("tactilenlp")
COMPILE_TIME = 120.0  # [s] at most, of one library; most take 1 to 5
COMPILE_SHARE = 0.4  # [-] at most, of the time that a computation may take
LEAST_COMPILE_TIME = 0.3  # [s] below which compilation is not begun
MESSAGE = 500  # characters of a compiler's message that are logged
PAUSE = 0.02  # [s] between two looks at compilers that run
SILENT = 3.0  # [s] of waiting for compilers before a line says so
WAITING = (
    "functions are compiled for their first use on this machine: up to a minute "
    "(`python -m tactilenlp compile` does it ahead for cuboids and polytopes)"
)
_running: list[Compilation] = []  # by compilers of this process
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_running.clear)  # only a parent can wait


def time_for_compilation(deadline: Deadline) -> float:
    """Return the time [s] that the compilation of one library may take now."""
    return min(COMPILE_TIME, deadline.share_left("compile", COMPILE_SHARE))


class Compilation:
    """A compiler that makes a library; it runs while others do.

    command: the compiler and its flags; source: in C.
    """

    def __init__(
        self, command: Sequence[str], source: str, library: Path, deadline: Deadline
    ):
        while len(_running) >= (os.cpu_count() or 1):
            with deadline.spending("compile"):
                ended = _first_to_end()
            ended.wait()
        self._library, self._deadline = library, deadline
        self._allowed = time_for_compilation(deadline)
        self._result: bool | OSError | None = None
        self._owner, self._lock, self._interrupted = os.getpid(), Lock(), False
        if self._allowed < LEAST_COMPILE_TIME:
            self._result = False
            return
        with ExitStack() as opened:
            folder = opened.enter_context(workspace(library.parent))
            code, self._built = folder / "term.c", folder / "term.so"
            code.write_text(source)
            self._compiler = command[0]
            command = [*command, str(code), "-o", str(self._built), "-lm"]
            self._messages = opened.enter_context((folder / "messages").open("w+b"))
            self._process = _started(command, folder, self._messages)
            opened.callback(_end, self._process, self._owner)
            self._opened = opened.pop_all()
        self._began = time.monotonic()
        atexit.register(self._opened.close)
        _running.append(self)

    @property
    def can_tell(self) -> bool:
        """Whether it ended by itself, or will: not in a fork, nor after Ctrl-C."""
        ours = os.getpid() == self._owner and not self._interrupted
        return self._result is not None or ours

    def finished(self) -> bool:
        """Wait; tell whether the library is there, else there was no time for it.

        Raises OSError if the compiler failed.
        """
        self.wait()
        if isinstance(self._result, OSError):
            raise self._result
        return bool(self._result)

    @property
    def is_over(self) -> bool:
        """Whether `wait` has nothing to wait for."""
        late = time.monotonic() >= self._began + self._allowed
        return late or self._process.poll() is not None

    def wait(self) -> None:
        """Wait for the end, or for the time that is allowed, and store the library.

        An interruption ends the compiler.
        """
        with self._lock:
            if self._result is not None or self._interrupted:
                return
            with self._opened:
                try:
                    left = max(0.0, self._began + self._allowed - time.monotonic())
                    with self._deadline.spending("compile"):
                        self._result = self._stored(self._status(left))
                except OSError as error:
                    self._result = error
                finally:
                    self._interrupted = self._result is None
                    _running.remove(self)
            atexit.unregister(self._opened.close)

    def _status(self, seconds: float) -> int | None:
        """Return the compiler's status, None if it takes longer; SILENT is said."""
        try:
            return self._process.wait(min(seconds, SILENT))
        except subprocess.TimeoutExpired:
            if seconds <= SILENT:
                return None
        _say_waiting()
        try:
            return self._process.wait(seconds - SILENT)
        except subprocess.TimeoutExpired:
            return None

    def _stored(self, status: int | None) -> bool:
        """Store the library; False if there was no time, OSError if it failed."""
        if status == 0:
            store(self._built, self._library)
            return True
        if status is None and self._allowed < COMPILE_TIME:
            log.info("a term function is not compiled: the time limit is too short")
            return False
        if status is None:
            raise OSError(f"{self._compiler} took longer than {self._allowed:g} s")
        self._messages.seek(0)
        said = self._messages.read(MESSAGE).decode(errors="replace")
        raise OSError(f"{self._compiler} ends with status {status}: {said.strip()}")


def _first_to_end() -> Compilation:
    """Wait until one of the compilations that run is over, and return it."""
    began = time.monotonic()
    while not (over := [one for one in _running if one.is_over]):
        time.sleep(PAUSE)
        if time.monotonic() > began + SILENT:
            _say_waiting()
    return over[0]


@cache
def _say_waiting() -> None:
    """Say once in a process that compilers are waited for."""
    log.warning(WAITING)


def _started(command: list[str], folder: Path, messages) -> subprocess.Popen:
    """Start a compiler in a session of its own; messages: a file for its output."""
    environment = {**os.environ, "LC_ALL": "C", "TMPDIR": str(folder)}
    return subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=messages,
        stderr=messages, start_new_session=True,
    )  # fmt: skip


def _end(process: subprocess.Popen, owner: int) -> None:
    """End a process that still runs, and all that it started; not in a fork."""
    if process.returncode is None and os.getpid() == owner:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
