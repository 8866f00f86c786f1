"""Compilation of term functions to machine code, once per machine.

C from CasADi's code generator runs ten to twenty times as fast as its virtual machine
on second derivatives, and two to four times as fast again where several instances are
evaluated at once (simd.py).  The library is kept in the user's cache folder
(library_cache.py) under the hash of its origin: expression, derivation rule, compiler,
processor and CasADi version.  Compilers run beside each other and beside this process,
which waits for one when its functions are needed (`begun`).  Without a C compiler, with
TACTILENLP_COMPILE=0, or where compiler or folder cannot be used, CasADi's virtual
machine evaluates the same expressions; the last of these is logged as one warning.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import logging
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path

import casadi as ca

from ..common.deadline import NEVER, Deadline
from ..common.library_cache import discard, is_whole, store, trusted_folder, workspace
from .simd import can_be_vectors, own_flags, processor, vector_source

log = logging.getLogger("tactilenlp")
# No contraction to fused operations: both machines give the same digits.
FLAGS = ("-O1", "-shared", "-fPIC", "-ffp-contract=off")
# Passes of GCC that take up to two thirds of its time on 10 000 lines without a branch,
# and change nothing there: CasADi has eliminated common subexpressions already.
UNUSED_PASSES = ("-fno-tree-dominator-opts", "-fno-tree-fre", "-fno-tree-sra")
COMPILE_TIME = 120.0  # [s] at most, of one library; most take 1 to 5
COMPILE_SHARE = 0.4  # [-] at most, of the time that a computation may take
LEAST_COMPILE_TIME = 0.3  # [s] below which compilation is not begun
MESSAGE = 500  # characters of a compiler's message that are logged
SILENT = 3.0  # [s] of waiting for compilers before a line says so
WAITING = (
    "functions are compiled for their first use on this machine: up to a minute "
    "(`python -m tactilenlp compile` does it ahead)"
)
_said: set[str] = set()  # warnings that were logged once: WAITING, and cache folders
_running: list[Compilation] = []  # by compilers of this process
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_running.clear)  # only a parent can wait


def compiled(
    functions: list[ca.Function],
    origin: str = "",
    deadline: Deadline = NEVER,
    vectors: bool = False,
) -> list[ca.Function]:
    """Return the functions compiled, or unchanged where that is not possible.

    Arguments as of `begun`.
    """
    return begun(functions, origin, deadline, vectors)()


def begun(
    functions: list[ca.Function],
    origin: str = "",
    deadline: Deadline = NEVER,
    vectors: bool = False,
) -> Callable[[], list[ca.Function]]:
    """Begin to compile functions; return what waits and returns them compiled.

    Unchanged where that is not possible.  origin: text that determines the functions,
    by which `kept` finds them again; by default their own C source; deadline: the time
    for compilation is a share of all; vectors: those that can evaluate several
    instances at once do, as columns of their arguments (simd.WIDTH).
    """
    if compiler() is None or _place() in _said:
        return lambda: functions
    if _time_for_compilation(deadline) < LEAST_COMPILE_TIME:
        return lambda: functions
    source = _source(functions, vectors)
    names = [f.name() for f in functions]
    load = partial(_externals, names)
    found = _begun(load, origin or source, source, deadline)
    return cache(lambda: found() or functions)


def _source(functions: list[ca.Function], vectors: bool) -> str:
    """Return the C source of all: of columns if they can be, else of one instance."""
    generator, wide = ca.CodeGenerator("term.c"), []
    for function in functions:
        if vectors and can_be_vectors(function):
            wide.append(function)
        else:
            generator.add(function)
    return generator.dump() + vector_source(wide)


def kept(names, origin: str) -> list[ca.Function] | None:
    """Return the functions compiled from this origin earlier, or None."""
    return None if compiler() is None else _begun(partial(_externals, names), origin)()


def library(source: str) -> ctypes.CDLL | None:
    """Return the library of a C source of our own, or None where it is not possible."""
    if compiler() is None or _place() in _said:
        return None
    return _begun(ctypes.CDLL, source, source)()


def _time_for_compilation(deadline: Deadline) -> float:
    """Return the time [s] that the compilation of one library may take now."""
    return min(COMPILE_TIME, deadline.share_left("compilation", COMPILE_SHARE))


def _begun(
    load: Callable, origin: str, source: str | None = None, deadline: Deadline = NEVER
) -> Callable:
    """Return what gives load(path) of a library, or None.

    The compilation from `source` begins now if the library is not there.
    """
    try:
        path = trusted_folder() / f"{_key(origin)}.so"
        if is_whole(path):
            found = _loaded(path, load)
            return lambda: found
        if source is None:
            return lambda: None
        compilation = Compilation(source, path, deadline)
    except (OSError, ValueError) as error:
        _warn_once(error)
        return lambda: None

    def found():
        if not compilation.is_ours:
            return _begun(load, origin, source, deadline)()
        try:
            return _loaded(path, load) if compilation.finished() else None
        except (OSError, ValueError) as error:
            _warn_once(error)
            return None

    return found


def _loaded(path: Path, load: Callable):
    """Return load(path); OSError, and the library is deleted, if that fails."""
    try:
        return load(str(path))
    except (RuntimeError, OSError) as error:
        discard(path)
        raise OSError(f"{path} cannot be loaded: {error}") from error


def _externals(names, path: str) -> list[ca.Function]:
    return [ca.external(name, path) for name in names]


def _key(origin: str) -> str:
    known = [compiler(), *_flags(), processor(), ca.__version__, origin]
    return hashlib.sha256(" ".join(known).encode()).hexdigest()[:32]


def _flags() -> tuple[str, ...]:
    """Return the flags of the compiler; it is GCC if its file is named so."""
    file = Path(compiler()).resolve().name
    return (*FLAGS, *own_flags(), *(UNUSED_PASSES if "gcc" in file else ()))


def _place() -> str:
    """Return what a warning is logged once about: the cache folder as configured."""
    return f"{os.environ.get('XDG_CACHE_HOME')} {os.environ.get('HOME')}"


def _warn_once(error: Exception) -> None:
    if _place() not in _said:
        log.warning("term functions are not compiled, solves are slower: %s", error)
    _said.add(_place())


@cache
def compiler() -> str | None:
    """Return the path of the C compiler, or None."""
    if os.environ.get("TACTILENLP_COMPILE", "1") == "0" or os.name == "nt":
        return None
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


class Compilation:
    """A compiler that makes a library; it runs while others do, one for each core.

    Begun where there is time for it; ended with the process.
    """

    def __init__(self, source: str, library: Path, deadline: Deadline):
        while len(_running) >= (os.cpu_count() or 1):
            _running[0].wait()
        self._library, self._deadline = library, deadline
        self._allowed = _time_for_compilation(deadline)
        self._result: bool | OSError | None = None
        self._owner = os.getpid()
        if self._allowed < LEAST_COMPILE_TIME:
            self._result = False
            return
        with ExitStack() as opened:
            folder = opened.enter_context(workspace(library.parent))
            code, self._built = folder / "term.c", folder / "term.so"
            code.write_text(source)
            command = [compiler(), *_flags(), str(code), "-o", str(self._built), "-lm"]
            self._messages = opened.enter_context((folder / "messages").open("w+b"))
            self._process = _started(command, folder, self._messages)
            opened.callback(_end, self._process, self._owner)
            self._opened = opened.pop_all()
        self._began = time.monotonic()
        atexit.register(self._opened.close)
        _running.append(self)

    @property
    def is_ours(self) -> bool:
        """Whether it has ended, or is this process's to wait for: not in a fork."""
        return self._result is not None or os.getpid() == self._owner

    def finished(self) -> bool:
        """Wait; tell whether the library is there, else there was no time for it.

        Raises OSError if the compiler failed.
        """
        self.wait()
        if isinstance(self._result, OSError):
            raise self._result
        return bool(self._result)

    def wait(self) -> None:
        """Wait for the end, or for the time that is allowed, and store the library."""
        if self._result is not None:
            return
        with self._opened:
            try:
                left = max(0.0, self._began + self._allowed - time.monotonic())
                with self._deadline.spending("compilation"):
                    self._result = self._stored(self._status(left))
            except OSError as error:
                self._result = error
            finally:
                _running.remove(self)
        atexit.unregister(self._opened.close)

    def _status(self, seconds: float) -> int | None:
        """Return the compiler's status, None if it takes longer; SILENT is said."""
        try:
            return self._process.wait(min(seconds, SILENT))
        except subprocess.TimeoutExpired:
            if seconds <= SILENT:
                return None
        if WAITING not in _said:
            log.warning(WAITING)
            _said.add(WAITING)
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
            raise OSError(f"{compiler()} took longer than {self._allowed:g} s")
        self._messages.seek(0)
        said = self._messages.read(MESSAGE).decode(errors="replace")
        raise OSError(f"{compiler()} ends with status {status}: {said.strip()}")


def _started(command: list[str], folder: Path, messages) -> subprocess.Popen:
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
