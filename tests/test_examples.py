"""The examples run from top to bottom in an empty folder and end with a sentence."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import RECORDED, TOSSES

from tactilenlp import Measurements

TOSSED = "07_identify_a_tossed_cube"  # needs recordings that do not ship with us
OWN_TERMS = "09_add_a_term"  # is about functions: terms of a page
EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("0*.py"))
LONGEST = 60  # [lines] of an example, so that it is read in one go


def run(example, folder, *arguments):
    """Run an example where there is no screen; warnings are errors."""
    headless = {
        k: v for k, v in os.environ.items() if k not in ("DISPLAY", "MPLBACKEND")
    }
    return subprocess.run(
        [sys.executable, "-W", "error", str(example), *map(str, arguments)],
        cwd=folder,
        env=headless,
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_ends_with_a_sentence(example, tmp_path, request):
    if example.stem == TOSSED:
        request.getfixturevalue("tosses")  # skips where they are absent
        done = run(example, tmp_path, TOSSES)
    else:
        done = run(example, tmp_path)
    assert done.returncode == 0, done.stderr
    last = done.stdout.strip().splitlines()[-1]
    assert last[0].isupper()
    assert last.endswith(".")
    if example == EXAMPLES[0]:
        assert last.startswith("The surface is 0.0")
    if "savefig" in example.read_text():
        (picture,) = tmp_path.glob("*.png")
        assert picture.stat().st_size > 10_000


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_has_no_helpers(example):
    text = example.read_text()
    assert len(text.splitlines()) <= LONGEST
    if example.stem != OWN_TERMS:
        assert "\ndef " not in text
    assert "sys.path" not in text


@pytest.mark.slow
def test_the_first_example_takes_a_recording_and_a_picture(tmp_path):
    data = Measurements.load(RECORDED).select(range(3))
    data.save(tmp_path / "short.npz")
    with np.load(RECORDED) as file, np.load(tmp_path / "short.npz") as short:
        arrays = {k: file[k] for k in file.files if k not in short} | dict(short)
    for name in ("object_position", "object_quaternion"):
        arrays[name] = arrays[name][: data.samples]
    np.savez(tmp_path / "short.npz", **arrays)
    done = run(EXAMPLES[0], tmp_path, "short.npz", "mine.png")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"short.npz", "mine.png"}
    assert done.stdout.startswith(f"short.npz: {data}")
    # One side has been touched on one face only; the example accepts up to 1 mm.
    assert done.stdout.splitlines()[-1].startswith("The surface is 0.")
