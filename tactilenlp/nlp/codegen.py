"""Compilation of term functions to machine code, once per machine.

C from CasADi's code generator runs ten to twenty times as fast as its virtual machine
on the Hessians of contact terms.  The library is kept in the user's cache folder
(library_cache.py) under the hash of its origin: expression, derivation rule, compiler
and CasADi version.  Without a C compiler, with TACTILENLP_COMPILE=0, or where compiler
or folder cannot be used, CasADi's virtual machine evaluates the same expressions; the
last of these is logged as one warning.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import signal
import subprocess
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import casadi as ca

from ..common.deadline import NEVER, Deadline
from ..common.library_cache import discard, is_whole, store, trusted_folder, workspace

log = logging.getLogger("tactilenlp")
# No contraction to fused operations: both machines give the same digits.
FLAGS = ("-O1", "-shared", "-fPIC", "-ffp-contract=off")
COMPILE_TIME = 120.0  # [s] at most, of one library; most take 1 to 5
COMPILE_SHARE = 0.4  # [-] at most, of the time that a computation may take
LEAST_COMPILE_TIME = 0.3  # [s] below which compilation is not begun
MESSAGE = 500  # characters of a compiler's message that are logged
_unusable: set[str] = set()  # cache folders about which a warning was logged


def compiled(
    functions: list[ca.Function], origin: str = "", deadline: Deadline = NEVER
) -> list[ca.Function]:
    """Return the functions compiled, or unchanged where that is not possible.

    origin: text that determines the functions, by which `kept` finds them again; by
    default their own C source; deadline: the time for compilation is a share of all.
    """
    if compiler() is None or _place() in _unusable:
        return functions
    if _time_for_compilation(deadline) < LEAST_COMPILE_TIME:
        return functions
    generator = ca.CodeGenerator("term.c")
    for function in functions:
        generator.add(function)
    source, names = generator.dump(), [f.name() for f in functions]
    load = partial(_externals, names)
    return _found(load, origin or source, source, deadline) or functions


def kept(names, origin: str) -> list[ca.Function] | None:
    """Return the functions compiled from this origin earlier, or None."""
    return None if compiler() is None else _found(partial(_externals, names), origin)


def library(source: str) -> ctypes.CDLL | None:
    """Return the library of a C source of our own, or None where it is not possible."""
    if compiler() is None or _place() in _unusable:
        return None
    return _found(ctypes.CDLL, source, source)


def _time_for_compilation(deadline: Deadline) -> float:
    """Return the time [s] that the compilation of one library may take now."""
    return min(COMPILE_TIME, deadline.share_left("compilation", COMPILE_SHARE))


def _found(
    load: Callable, origin: str, source: str | None = None, deadline: Deadline = NEVER
):
    """Return load(path) of a library, compiled from `source` if it is not there."""
    try:
        path = trusted_folder() / f"{_key(origin)}.so"
        if is_whole(path):
            return _loaded(path, load)
        if source is None or not _compile(source, path, deadline):
            return None
        return _loaded(path, load)
    except (OSError, ValueError) as error:
        _warn_once(error)
        return None


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
    known = [compiler(), *FLAGS, platform.machine(), ca.__version__, origin]
    return hashlib.sha256(" ".join(known).encode()).hexdigest()[:32]


def _place() -> str:
    """Return what a warning is logged once about: the cache folder as configured."""
    return f"{os.environ.get('XDG_CACHE_HOME')} {os.environ.get('HOME')}"


def _warn_once(error: Exception) -> None:
    if _place() not in _unusable:
        log.warning("term functions are not compiled, solves are slower: %s", error)
    _unusable.add(_place())


@cache
def compiler() -> str | None:
    """Return the path of the C compiler, or None."""
    if os.environ.get("TACTILENLP_COMPILE", "1") == "0" or os.name == "nt":
        return None
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def _compile(source: str, library: Path, deadline: Deadline) -> bool:
    """Compile a library; False if there is no time for it now, OSError if it fails."""
    allowed = _time_for_compilation(deadline)
    if allowed < LEAST_COMPILE_TIME:
        return False
    with workspace(library.parent) as folder:
        code, built = folder / "term.c", folder / "term.so"
        code.write_text(source)
        command = [compiler(), *FLAGS, str(code), "-o", str(built), "-lm"]
        try:
            with deadline.spending("compilation"):
                _run(command, folder, allowed)
        except subprocess.TimeoutExpired as late:
            if allowed < COMPILE_TIME:
                log.info("a term function is not compiled: the time limit is too short")
                return False
            raise OSError(f"{compiler()} took longer than {allowed:g} s") from late
        store(built, library)
    return True


def _run(command: list[str], folder: Path, seconds: float) -> None:
    """Run a compiler; OSError if it fails, TimeoutExpired with all of it ended."""
    environment = {**os.environ, "LC_ALL": "C", "TMPDIR": str(folder)}
    with (folder / "messages").open("w+b") as messages:
        process = subprocess.Popen(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=messages,
            stderr=messages, start_new_session=True,
        )  # fmt: skip
        try:
            status = process.wait(seconds)
        finally:
            _end(process)
        messages.seek(0)
        said = messages.read(MESSAGE).decode(errors="replace")
    if status:
        raise OSError(f"{command[0]} ends with status {status}: {said.strip()}")


def _end(process: subprocess.Popen) -> None:
    """End a process that still runs, and all that it started."""
    if process.returncode is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
