"""The examples run from top to bottom in an empty folder and end with a sentence."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import RECORDED, TOSSES

from tactilenlp import Measurements

OWN_TERMS = "07_add_a_term"  # is about functions: terms of a page
FOLDER = Path(__file__).resolve().parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("0*.py"))
TOSSED = FOLDER / "08_identify_a_tossed_cube.py"
ROBOT = FOLDER / "09_explore_on_the_robot.py"
SILENT = 2.0  # [CPU s] before the first line at most; a second on a machine at rest
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


def told(done):
    """Return the last line of an example that ended well: a sentence."""
    assert done.returncode == 0, done.stderr
    last = done.stdout.strip().splitlines()[-1]
    assert last[0].isupper()
    assert last.endswith(".")
    return last


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_ends_with_a_sentence_and_a_picture(example, tmp_path):
    last = told(run(example, tmp_path))
    if example == EXAMPLES[0]:
        assert last.startswith("The surface is 0.0")
    (picture,) = tmp_path.glob("*.png")
    assert picture.stat().st_size > 10_000


@pytest.mark.slow
def test_a_cube_is_identified_from_tosses_of_a_file_of_ones_own(tosses, tmp_path):
    told(run(TOSSED, tmp_path, TOSSES))


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_the_first_line_is_printed_before_anything_is_solved(example, tmp_path):
    """The CPU time of the process up to its first line, which is not buffered."""
    code = (
        "import io, runpy, sys, time\n"
        "class Ends(io.StringIO):\n"
        "    def write(self, text):\n"
        "        raise SystemExit(f'{time.process_time()} {text}')\n"
        "sys.stdout = Ends()\n"
        f"sys.argv = ['x']\nrunpy.run_path({str(example)!r}, run_name='__main__')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    seconds, _, line = done.stderr.partition(" ")
    assert line.strip(), done.stderr
    assert float(seconds) < SILENT
    assert "flush=True" in example.read_text().partition("print(")[2].partition("\n")[0]


@pytest.mark.slow
def test_the_robot_without_opencv_says_what_to_install(tmp_path):
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['cv2'] = None")
    paths = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, str(ROBOT)], cwd=tmp_path, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": paths},
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == (
        'The cameras need OpenCV: pip install "tactilenlp[optical]".\n'
    )


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
