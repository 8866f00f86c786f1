"""Compilation of term functions to machine code, once per machine.

C from CasADi's code generator runs ten to twenty times as fast as its virtual machine
on second derivatives, and two to four times as fast again where several instances are
evaluated at once (simd.py).  The library is kept in the user's cache folder
(library_cache.py) under the hash of its origin: expression, derivation rule, compiler,
processor and CasADi version.  Compilers run beside this process (compilation.py), which
waits for one when its functions are needed (`start_compilation`).  Without a C
compiler, with TACTILENLP_COMPILE=0, or where compiler or folder cannot be used,
CasADi's virtual machine evaluates the same expressions; the last of these is logged as
one warning.
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
import logging
import os
import shutil
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import casadi as ca

from ..common.deadline import NEVER, Deadline
from ..common.library_cache import discard, is_whole, trusted_folder
from .compilation import LEAST_COMPILE_TIME, Compilation, time_for_compilation
from .simd import can_be_vectors, own_flags, processor, vector_source

log = logging.getLogger("tactilenlp")
# No contraction to fused operations: both machines give the same digits.
FLAGS = ("-O1", "-shared", "-fPIC", "-ffp-contract=off")
# Passes of GCC that take up to two thirds of its time on 10 000 lines without a branch,
# and change nothing there: CasADi has eliminated common subexpressions already.
UNUSED_PASSES = ("-fno-tree-dominator-opts", "-fno-tree-fre", "-fno-tree-sra")
_warned_folders: set[str] = set()  # cache folders about which a warning was logged


class Compiling:
    """Functions of which a compiler may run: called, it waits and returns them.

    hurried: whether they are not compiled for want of time alone, as far as is known.
    """

    def __init__(self, functions, found: Callable | None = None, hurried: bool = False):
        self._functions, self._found, self.hurried = functions, found, hurried

    def __call__(self) -> list[ca.Function]:
        if self._found is not None:
            library = self._found()
            self._found, self._functions = None, library or self._functions
            self.hurried = not library and _configured_folder() not in _warned_folders
        return self._functions


def compiled(functions: list[ca.Function]) -> list[ca.Function]:
    """Return the functions compiled, or unchanged where that is not possible."""
    return start_compilation(functions)()


def start_compilation(
    functions: list[ca.Function],
    origin: str = "",
    deadline: Deadline = NEVER,
    vectors: bool = False,
) -> Compiling:
    """Start to compile functions; return what waits and returns them compiled.

    Unchanged where that is not possible.  origin: text that determines the functions,
    by which `compiled_earlier` finds them again; by default their own C source;
    deadline: the time for compilation is a share of all; vectors: those that can
    evaluate several instances at once do, as columns of their arguments (simd.WIDTH).
    """
    if compiler() is None or _configured_folder() in _warned_folders:
        return Compiling(functions)
    if time_for_compilation(deadline) < LEAST_COMPILE_TIME:
        return Compiling(functions, hurried=True)
    source = _source(functions, vectors)
    names = [f.name() for f in functions]
    load = partial(_externals, names)
    found = _library_getter(load, origin or source, source, deadline)
    return Compiling(functions, found)


def _source(functions: list[ca.Function], vectors: bool) -> str:
    """Return the C source of all: of columns if they can be, else of one instance."""
    generator, wide = ca.CodeGenerator("term.c"), []
    for function in functions:
        if vectors and can_be_vectors(function):
            wide.append(function)
        else:
            generator.add(function)
    return generator.dump() + vector_source(wide)


def compiled_earlier(names, origin: str) -> list[ca.Function] | None:
    """Return the functions compiled from this origin earlier, or None."""
    if compiler() is None:
        return None
    return _library_getter(partial(_externals, names), origin)()


def library(source: str) -> ctypes.CDLL | None:
    """Return the library of a C source of our own, or None where it is not possible."""
    if compiler() is None or _configured_folder() in _warned_folders:
        return None
    return _library_getter(ctypes.CDLL, source, source)()


def _library_getter(
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
        compilation = Compilation([compiler(), *_flags()], source, path, deadline)
    except (OSError, ValueError) as error:
        _warn_once(error)
        return lambda: None

    def found():
        if not compilation.can_tell:
            return _library_getter(load, origin, source, deadline)()
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
    """Return the functions of a compiled library."""
    return [ca.external(name, path) for name in names]


def _key(origin: str) -> str:
    """Return the name of a library: a hash of all that its machine code depends on."""
    vector_rule = inspect.getsource(inspect.getmodule(vector_source))
    known = [compiler(), *_flags(), processor(), ca.__version__, vector_rule, origin]
    return hashlib.sha256(" ".join(known).encode()).hexdigest()[:32]


def _flags() -> tuple[str, ...]:
    """Return the flags of the compiler; it is GCC if its file is named so."""
    file = Path(compiler()).resolve().name
    return (*FLAGS, *own_flags(), *(UNUSED_PASSES if "gcc" in file else ()))


def _configured_folder() -> str:
    """Return what a warning is logged once about: the cache folder as configured."""
    return f"{os.environ.get('XDG_CACHE_HOME')} {os.environ.get('HOME')}"


def _warn_once(error: Exception) -> None:
    """Log once for a cache folder that functions are not compiled."""
    if _configured_folder() not in _warned_folders:
        log.warning("term functions are not compiled, solves are slower: %s", error)
    _warned_folders.add(_configured_folder())


@cache
def compiler() -> str | None:
    """Return the path of the C compiler, or None."""
    if os.environ.get("TACTILENLP_COMPILE", "1") == "0" or os.name == "nt":
        return None
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
