"""Compilation of term functions to machine code, once per machine.

C from CasADi's code generator runs ten to twenty times as fast as its virtual machine
on the Hessians of contact terms.  The library is kept in the user's cache folder under
the hash of its origin: expression, derivation rule, compiler and CasADi version.
Without a C compiler, or with TACTILENLP_COMPILE=0, CasADi's virtual machine evaluates
the same expressions.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import casadi as ca

log = logging.getLogger("tactilenlp")
# No contraction to fused operations: both machines give the same digits.
FLAGS = ("-O1", "-shared", "-fPIC", "-ffp-contract=off")


def compiled(functions: list[ca.Function], origin: str = "") -> list[ca.Function]:
    """Return the functions compiled, or unchanged without a working C compiler.

    origin: text that determines the functions, by which `kept` finds them again; by
    default their own C source.
    """
    if compiler() is None:
        return functions
    generator = ca.CodeGenerator("term.c")
    for function in functions:
        generator.add(function)
    source = generator.dump()
    library = _library(origin or source)
    if not library.exists() and not _compile(source, library):
        return functions
    return _read(library, [f.name() for f in functions]) or functions


def kept(names, origin: str) -> list[ca.Function] | None:
    """Return the functions compiled from this origin earlier, or None."""
    if compiler() is None or not _library(origin).exists():
        return None
    return _read(_library(origin), names)


def _library(origin: str) -> Path:
    known = " ".join([compiler(), *FLAGS, ca.__version__, origin])
    return cache_folder() / f"{hashlib.sha256(known.encode()).hexdigest()[:32]}.so"


def _read(library: Path, names) -> list[ca.Function] | None:
    try:
        return [ca.external(name, str(library)) for name in names]
    except RuntimeError as error:  # a library of another machine, or half a file
        log.warning("a compiled term function cannot be read and is deleted: %s", error)
        library.unlink(missing_ok=True)
        return None


@cache
def compiler() -> str | None:
    """Return the path of the C compiler, or None."""
    if os.environ.get("TACTILENLP_COMPILE", "1") == "0" or os.name == "nt":
        return None
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def cache_folder() -> Path:
    """Return the folder of compiled term functions."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "tactilenlp"


def _compile(source: str, library: Path) -> bool:
    try:
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            code, built = Path(folder) / "term.c", Path(folder) / "term.so"
            code.write_text(source)
            command = [compiler(), *FLAGS, str(code), "-o", str(built), "-lm"]
            subprocess.run(command, check=True, capture_output=True, text=True)
            os.replace(built, library)  # another process may have done the same
    except (OSError, subprocess.CalledProcessError) as error:
        reason = getattr(error, "stderr", None) or error
        log.warning("term functions are not compiled, solves are slower: %s", reason)
        return False
    return True
