"""Whatever state the cache of compiled functions is in, a process solves as without it.

Every state is tried in a process of its own, which a damaged library would end by a
signal, without the rights of root.
"""

import os
import shutil
import signal
import stat
import tempfile
import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from cache_child import (
    COMPILED,
    INTERPRETED,
    NOBODY,
    cache_of,
    child,
    damaged,
    digest_of,
    exchanged,
    filled,
    flipped,
    own,
    replaced,
    run,
)

from tactilenlp.nlp import codegen, compilation

pytestmark = [
    pytest.mark.skipif(codegen.compiler() is None, reason="no C compiler here"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
]


@contextmanager
def folder_of_the_child():
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    own(folder)
    yield folder
    for path in [folder, *folder.rglob("*")]:
        if path.is_dir() and not path.is_symlink():
            path.chmod(0o700)
    shutil.rmtree(folder)


@pytest.fixture
def home():
    """A folder that belongs to whoever the child is."""
    with folder_of_the_child() as folder:
        yield folder


@pytest.fixture(scope="module")
def template():
    """A home with a full cache."""
    with folder_of_the_child() as folder:
        filled(folder)
        yield folder


@pytest.fixture
def library(template, home):
    """One of the two libraries in a cache that was full before, in `home`."""
    shutil.copytree(template, home, dirs_exist_ok=True)
    for path in home.rglob("*"):
        own(path)
    return max(home.rglob("*.so"))


REPAIRED = {
    "truncated": partial(damaged, lambda b: b[: len(b) // 3]),
    "half of it zeros": partial(
        damaged, lambda b: b[: len(b) // 2].ljust(len(b), b"\0")
    ),
    "flipped bits": partial(damaged, flipped),
    "empty": partial(damaged, lambda b: b""),
    "rubbish": partial(damaged, lambda b: b"no library"),
    "no digest": lambda path: path.with_suffix(".sha256").unlink(),
    "rubbish for a digest": lambda path: path.with_suffix(".sha256").write_bytes(
        b"\xff"
    ),
}


@pytest.mark.parametrize("state", REPAIRED)
def test_a_damaged_library_is_compiled_again(home, library, state):
    REPAIRED[state](library)
    assert run(cache_of(home)) == ([COMPILED] * 2, [])
    assert run(cache_of(home)) == ([COMPILED] * 2, [])


def test_a_library_under_the_name_of_another_is_not_loaded(home, library):
    libraries = sorted(library.parent.glob("*.so"))
    digests = [digest_of(library) for library in libraries]
    before = [path.read_bytes() for path in digests]
    for files in (libraries, digests):
        exchanged(*files)
    assert run(cache_of(home)) == ([COMPILED] * 2, [])
    assert [path.read_bytes() for path in digests] == before


def link(home, path):
    os.symlink(home / "elsewhere", path)


REFUSED = {
    "a folder for a library": lambda home, so: replaced(so, Path.mkdir),
    "a folder for a digest": lambda home, so: replaced(
        digest_of(so), Path.mkdir
    ),
    "a FIFO for a library": lambda home, so: replaced(so, os.mkfifo),
    "a FIFO for a digest": lambda home, so: replaced(
        digest_of(so), os.mkfifo
    ),
    "a link for a library": lambda home, so: replaced(so, partial(link, home)),
    "a library that others can write": lambda home, so: so.chmod(0o606),
    "a library that cannot be read": lambda home, so: so.chmod(0o000),
    "a folder that others can write": lambda home, so: so.parent.chmod(0o707),
    "a folder that the group can write": lambda home, so: so.parent.chmod(0o770),
    "a folder that cannot be read": lambda home, so: so.parent.chmod(0o000),
    "a folder above that all can change": lambda home, so: so.parents[1].chmod(0o777),
    "no library in a folder that is read-only": lambda home, so: (
        so.unlink(), so.parent.chmod(0o500)
    ),
    "a file for the folder": lambda home, so: (
        shutil.rmtree(so.parent), so.parent.touch()
    ),
}  # fmt: skip


@pytest.mark.parametrize("state", REFUSED)
def test_what_is_not_to_trust_is_refused_with_one_warning(home, library, state):
    REFUSED[state](home, library)
    kinds, warnings = run(cache_of(home))
    assert INTERPRETED in kinds
    assert len(warnings) == 1


def other_user():
    os.geteuid = lambda: NOBODY + 1


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_a_folder_in_one_of_another_user_is_refused(home, library):
    above = library.parents[1]
    os.chown(above, NOBODY + 1, NOBODY)
    above.chmod(0o755)
    kinds, warnings = run(cache_of(home))
    assert kinds == [INTERPRETED] * 2
    assert len(warnings) == 1


def no_home():
    def nowhere():
        raise RuntimeError("Could not determine home directory.")

    Path.home = nowhere


def full():
    def replace(*_):
        raise OSError(28, "No space left on device")

    os.replace = replace


@pytest.mark.parametrize("patch", [other_user, no_home, full])
def test_without_a_usable_folder_there_is_one_warning(home, patch, request):
    if patch is other_user:
        request.getfixturevalue("library")
    kinds, warnings = run(cache_of(home), patch)
    assert kinds == [INTERPRETED] * 2
    assert len(warnings) == 1


def test_a_read_only_folder_with_all_libraries_is_used(home, library):
    library.parent.chmod(0o500)
    assert run(cache_of(home)) == ([COMPILED] * 2, [])


@pytest.mark.parametrize("named", ["relative", "", "./here"])
def test_a_relative_cache_home_is_ignored(home, named, monkeypatch):
    monkeypatch.chdir(home)
    environment = cache_of(home) | {"XDG_CACHE_HOME": named}
    assert run(environment) == ([COMPILED] * 2, [])
    assert [path.name for path in home.iterdir()] == [".cache"]


def test_a_new_folder_is_of_this_user_only(home):
    folder, _ = filled(home)
    for path in (folder, folder.parent):
        assert stat.S_IMODE(path.stat().st_mode) == 0o700
    for path in folder.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600


COMPILERS = {
    "fails": "echo no; exit 1",
    "writes no UTF-8": r"printf '\377\376'; printf '\377' >&2; exit 1",
    "hangs, and what it started too": "sleep 60 & sleep 60",
    "writes nothing": "exit 0",
    "writes rubbish": 'echo rubbish > "${7}"',
    "dies": "kill -SEGV $$",
}


def compiler_that(home, does):
    folder = home / "bin"
    folder.mkdir()
    (folder / "cc").write_text(f"#!/bin/sh\n{does}\n")
    (folder / "cc").chmod(0o755)
    return {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}


def impatient():
    compilation.COMPILE_TIME = 0.5


@pytest.mark.parametrize("does", COMPILERS)
def test_without_a_working_compiler_there_is_one_warning(home, does):
    environment = cache_of(home) | compiler_that(home, COMPILERS[does])
    began = time.monotonic()
    kinds, warnings = run(environment, impatient)
    assert time.monotonic() - began < 5.0
    assert kinds == [INTERPRETED] * 2
    assert len(warnings) == 1
    assert not [*(home / ".cache" / "tactilenlp").iterdir()]


def test_a_process_that_is_killed_while_it_compiles_leaves_no_harm(home):
    environment = cache_of(home) | compiler_that(home, "touch $HOME/begun; sleep 5")
    process, _ = child(environment)
    while not (home / "begun").exists():
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    folder, libraries = filled(home)
    assert len(libraries) == 2
    (left,) = folder.glob("unfinished-*")
    os.utime(left, (0, 0))  # long ago
    libraries[0].unlink()
    assert run(cache_of(home)) == ([COMPILED] * 2, [])
    assert not [*folder.glob("unfinished-*")]


def talkative():
    compilation.SILENT = 0.0


def test_waiting_for_a_compiler_is_said_once(home):
    kinds, warnings = run(cache_of(home), talkative)
    assert kinds == [COMPILED] * 2
    assert warnings == [compilation.WAITING]
    assert run(cache_of(home), talkative) == ([COMPILED] * 2, [])
