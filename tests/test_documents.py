"""Every code block of every README does what it says, as it is printed."""

import os
import re
import shlex
import subprocess
import sys
import types
from dataclasses import replace

import numpy as np
import pytest
from conftest import RECORDED, ROOT

import tactilenlp
from tactilenlp import Measurements

TRACKED = subprocess.run(
    ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True
).stdout.split()
PAGES = TRACKED or ["README.md", "formulations/README.md"]  # an unpacked archive
# Its blocks go on from each other: test_hardware_readme.py runs them in their order.
EXTRAS = ("distributed", "mpi4py")
PAGES = [page for page in PAGES if page != "hardware/README.md"]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.S | re.M)


def blocks(*languages):
    """Return (page, number, code) of every block in one of the languages."""
    found = []
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        for number, (language, code) in enumerate(BLOCK.findall(text)):
            if language in languages:
                found.append(pytest.param(page, code, id=f"{page}-{number}"))
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with a recording of two actions, as a reader would have one."""
    monkeypatch.chdir(tmp_path)
    with np.load(RECORDED) as file:
        known = {k: file[k] for k in ("mass", "friction_ground", "friction_finger")
                 if k in file}  # fmt: skip
    Measurements.load(RECORDED).select([0, 1]).save("scene.npz")
    with np.load("scene.npz") as file:
        arrays = dict(file)
    np.savez("scene.npz", **arrays, **known)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(("page", "code"), blocks("python", "py"))
def test_python_runs_as_printed(page, code, folder, monkeypatch):
    # What a block takes as given: one more action, recorded later.
    for extra in EXTRAS:
        if f"from {extra}" in code:
            pytest.importorskip(extra, reason=f"{extra} is an extra")
    given = types.ModuleType("my_page")
    if "__main__" in code:  # what other processes may not run when they import it
        given.__name__ = "__main__"
    given.more = Measurements.load(RECORDED).select([2])
    monkeypatch.setitem(sys.modules, "my_page", given)
    exec(compile(code, page, "exec"), given.__dict__)


@pytest.mark.parametrize(("page", "code"), blocks("sh", "bash", "console"))
def test_shell_names_files_and_extras_that_exist(page, code):
    # Installing is the business of .ci/run, which does it in a fresh environment.
    for line in code.replace("\\\n", " ").splitlines():
        for word in shlex.split(line, comments=True):
            if word.endswith(".py"):
                assert (ROOT / word).is_file(), word
            for extra in re.findall(r"\.\[(\w+)\]", word):
                assert f"\n{extra} =" in (ROOT / "setup.cfg").read_text()


def test_no_block_is_of_a_kind_that_nothing_checks():
    known = {"python", "py", "sh", "bash", "console", "text", "math", ""}
    kinds = {
        language
        for page in PAGES
        for language, _ in BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))
    }
    assert kinds <= known, kinds - known


@pytest.mark.parametrize("page", PAGES)
def test_links_to_files_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        if "://" not in target:
            assert ((ROOT / page).parent / target).exists(), target


def test_the_pages_readme_lists_what_pages_read_of_a_window():
    text = (ROOT / "formulations" / "README.md").read_text(encoding="utf-8")
    pages = (ROOT / "formulations").glob("*.py")
    read = {
        name for page in pages
        for name in re.findall(r"window\.([a-z]\w*)", page.read_text(encoding="utf-8"))
    }  # fmt: skip
    read -= {"with_fingers"}  # a method
    assert {name for name in read if f"`{name}`" not in text} == set()


def test_the_pages_readme_states_the_flags_of_every_class():
    text = (ROOT / "formulations" / "README.md").read_text(encoding="utf-8")
    head = "| class | `of_vertices` | `faced` | `rolls` | start |\n"
    table = text.split(head)[1].split("\n\n")[0]
    faced = replace(tactilenlp.CYLINDER, theta=3, opposite_faces=True, name="own")
    classes = {
        "`CUBOID`": tactilenlp.CUBOID, "opposite_faces": faced,
        "`CYLINDER`": tactilenlp.CYLINDER, "`prism(n)`": tactilenlp.prism(6),
        "`ELLIPSOID`": tactilenlp.ELLIPSOID, "`polytope(n)`": tactilenlp.polytope(6),
    }  # fmt: skip
    for name, shape in classes.items():
        (row,) = (line for line in table.splitlines() if name in line)
        said = [cell.strip() == "yes" for cell in row.split("|")[2:5]]
        assert said == [shape.of_vertices, shape.faced, shape.rolls], name


@pytest.mark.slow
def test_the_documented_command_builds_the_reference_without_warnings(tmp_path):
    pytest.importorskip("pdoc", reason="pdoc is not installed (extra: docs)")
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"`python (-m pdoc -o reference [^`]+)`", text)
    done = subprocess.run(
        [sys.executable, "-W", "error", *shlex.split(command)], cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    text = (tmp_path / "reference" / "tactilenlp.html").read_text(encoding="utf-8")
    assert all(f'id="{name}"' in text for name in tactilenlp.__all__)
    for package in ("formulations", "hardware"):
        assert (tmp_path / "reference" / f"{package}.html").is_file()
