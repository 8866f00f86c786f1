"""A process that compiles, or loads what was compiled, and caches that are damaged."""

import logging
import multiprocessing
import os

import casadi as ca

from tactilenlp.nlp import codegen

NOBODY = 65534  # user without rights, for tests that root runs
LONGEST = 20.0  # [s] of a child, or it hangs
VALUE = 3.0**3 + 2.0  # of x^3 + d at x = 3, d = 2
COMPILED, INTERPRETED = "External", "SXFunction"


def functions():
    x, d = ca.SX.sym("x"), ca.SX.sym("d")
    return [ca.Function("value", [x, d], [x**3 + d])]


def solve(environment, patch, answer):
    """What a process does with a cache: load or compile, twice, and evaluate."""
    os.environ.update({k: v for k, v in environment.items() if v is not None})
    for name in [k for k, v in environment.items() if v is None]:
        os.environ.pop(name, None)
    if os.geteuid() == 0:
        os.setgid(NOBODY)
        os.setuid(NOBODY)
    said = []
    log = logging.getLogger("tactilenlp")
    log.propagate, handler = False, logging.Handler()
    handler.emit = lambda record: said.append((record.levelno, record.getMessage()))
    log.addHandler(handler)
    codegen.compiler.cache_clear()
    patch()
    found = []
    for origin in ("one", "two"):
        one = (
            codegen.compiled_earlier(["value"], origin)
            or codegen.start_compilation(functions(), origin)()
        )
        found.append((one[0].class_name(), float(one[0](3.0, 2.0))))
    answer.send((found, [words for level, words in said if level >= logging.WARNING]))


def child(environment, patch=bool):
    """Start that process; return it and where its answer comes from."""
    fork = multiprocessing.get_context("fork")
    receive, send = fork.Pipe(duplex=False)
    process = fork.Process(target=solve, args=(environment, patch, send))
    process.start()
    send.close()
    return process, receive


def run(environment, patch=bool):
    """Return the kinds of functions that a process got and the warnings it logged."""
    process, receive = child(environment, patch)
    process.join(LONGEST)
    hangs, _ = process.is_alive(), process.kill()
    process.join()
    assert not hangs
    assert process.exitcode == 0, f"ended by {process.exitcode}"
    found, warnings = receive.recv()
    assert [value for _, value in found] == [VALUE, VALUE]
    return [name for name, _ in found], warnings


def own(path):
    if os.geteuid() == 0:
        os.chown(path, NOBODY, NOBODY, follow_symlinks=False)


def cache_of(home):
    return {"XDG_CACHE_HOME": None, "HOME": str(home)}


def filled(home):
    """Fill the cache; return its folder and its libraries."""
    found = run(cache_of(home))
    assert found == ([COMPILED] * 2, []), found
    folder = home / ".cache" / "tactilenlp"
    return folder, sorted(folder.glob("*.so"))


def replaced(path, make):
    """Replace a file by what make(path) makes; it belongs to the child."""
    path.unlink()
    make(path)
    own(path)


def damaged(content, path):
    path.write_bytes(content(path.read_bytes()))


def digest_of(library):
    return library.with_suffix(".sha256")


def exchanged(one, other):
    """Exchange the contents of two files, which keep their owners."""
    contents = one.read_bytes(), other.read_bytes()
    other.write_bytes(contents[0])
    one.write_bytes(contents[1])


def flipped(content):
    middle = len(content) // 2
    return content[:middle] + bytes(b ^ 255 for b in content[middle:])
