"""Without Python: estimate a file, look at it, hear in one line what is wrong."""

import subprocess
import sys

import numpy as np
import pytest
from conftest import RECORDED

from tactilenlp import Estimate, Measurements
from tactilenlp.__main__ import main, parser
from tactilenlp.errors import Interrupted, OptionError, WriteError


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return a recording of one action, with what its file knows of the scene."""
    path = tmp_path_factory.mktemp("short") / "scene.npz"
    Measurements.load(RECORDED).select([0, 1]).save(path)
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **arrays, mass=0.5, friction_ground=0.3)
    return path


def test_a_recording_becomes_an_estimate_a_page_and_a_model(short, tmp_path, capsys):
    saved, page = tmp_path / "estimate.npz", tmp_path / "report.html"
    words = ["estimate", str(short), "--mass", "0.6", "--save", str(saved)]
    assert main([*words, "--output", str(page)]) == 0
    assert capsys.readouterr().out.startswith("A cuboid of ")
    assert page.stat().st_size > 10_000
    estimate = Estimate.load(saved)
    assert estimate.scene.mass == 0.6
    assert estimate.scene.friction_ground == 0.3
    assert main(["report", str(saved), "--export", str(tmp_path / "box.urdf")]) == 0
    told, _, wrote = capsys.readouterr().out.strip().rpartition("\n")
    assert told == estimate.summary()
    assert wrote == f"Wrote {tmp_path / 'box.urdf'}."
    assert "<robot" in (tmp_path / "box.urdf").read_text()


def test_classes_to_compare_are_given_one_after_the_other(short, monkeypatch):
    asked = []

    def noted(data, scene, shape, formulation):
        asked.append(shape)
        raise OptionError("enough", where="a test", got="the shape", next="stop")

    monkeypatch.setattr("tactilenlp.solve_estimate", noted)
    for words in (["cylinder", "prism of 6 sides"], ["auto"], []):
        option = ["--shape", *words] if words else []
        assert main(["estimate", str(short), *option]) != 0
    assert asked == [["cylinder", "prism of 6 sides"], "auto", "cuboid"]


@pytest.mark.parametrize("sides", [["0.05", "0.035", "0.04"], []])
def test_the_world_that_is_explored_has_the_sides_that_were_given(sides, monkeypatch):
    worlds = []

    def noted(world, *given, **options):
        worlds.append(world)
        raise OptionError("enough", where="a test", got="the world", next="stop")

    monkeypatch.setattr("tactilenlp.explore", noted)
    words = ["--sides", *sides] if sides else []
    assert main(["explore", "new.npz", "--seed", "3", *words]) == 2
    found = worlds[0].side_lengths
    if sides:
        assert found.tolist() == [float(side) for side in sides]
    assert (found >= 0.03).all()
    assert (found <= 0.06).all()


@pytest.mark.parametrize("command", [[], ["estimate"], ["explore"], ["report"]])
def test_help_is_there_for_every_command_and_lists_its_choices(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*command, "--help"])
    assert ended.value.code == 0
    told = " ".join(capsys.readouterr().out.split())
    assert told.startswith("usage: python -m tactilenlp")
    if command == ["estimate"]:
        for name in ("polytope", "cylinder", "quasi_static", "shooting", ".urdf"):
            assert name in told


def test_the_package_is_a_command():
    command = [sys.executable, "-m", "tactilenlp", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "usage: python -m tactilenlp" in done.stdout


@pytest.mark.slow
def test_a_box_is_explored_taken_up_again_and_reported(tmp_path, capsys):
    file = tmp_path / "box.npz"
    words = ["explore", str(file), "--sides", "0.05", "0.035", "0.04", "--seed", "3"]
    assert main([*words, "--policy", "random", "--actions", "1"]) == 0
    first = capsys.readouterr().out
    assert first.count("mm off on average") == 2
    assert main([*words, "--policy", "random", "--actions", "2"]) == 0
    later = capsys.readouterr().out
    assert later.startswith(first.partition("A cuboid of")[0])
    assert later.count("mm off on average") == 3
    assert main(["report", str(file)]) == 0
    assert later.endswith(capsys.readouterr().out)
    assert main([*words[:-1], "4"]) == 2
    assert "another seed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (["estimate", "nowhere.npz"], "nowhere.npz"),
        (["estimate", __file__], "npz"),
        (["report", __file__], "npz"),
        (["estimate", str(RECORDED), "--shape", "ball"], "unknown shape"),
        (["estimate", str(RECORDED), "--mass", "-1"], "mass"),
        (["report", str(RECORDED)], "not an estimate"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_no_traceback(command, word, capsys):
    assert main(command) == 2
    said = capsys.readouterr()
    assert word in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_a_seed_below_zero_is_refused_by_the_parser(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["explore", str(tmp_path / "box.npz"), "--seed", "-1"])
    assert ended.value.code == 2
    assert "--seed: expected 0 or more, got -1" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--save", "--output", "--export"])
def test_a_folder_that_is_not_there_is_said_before_minutes_are_spent(
    option, tmp_path, capsys, monkeypatch
):
    def solved(*given, **others):
        pytest.fail("it was solved first")

    monkeypatch.setattr("tactilenlp.estimation.solver.solve_estimate", solved)
    path = tmp_path / "nowhere" / "shape.stl"
    assert main(["estimate", str(RECORDED), option, str(path)]) == 2
    said = capsys.readouterr()
    assert said.err.startswith(f"{option}: no such folder")
    assert said.err.count("\n") == 1


@pytest.mark.parametrize(
    ("given", "word"),
    [
        (("--save", "estimate.json"), "no such format"),
        (("--save", "estimate"), "got no suffix"),
        (("--output", "page.pdf"), "expected .html or .htm"),
        (("--export", "box.dwg"), "no such format"),
        (("--save", "scene.npz"), "would replace another file"),
        (("--save", "a.npz", "--export", "b.stl", "--output", "b.stl"), ".html"),
    ],
)
def test_names_of_outputs_are_checked_before_the_solve(
    given, word, tmp_path, capsys, monkeypatch
):
    def solved(*given, **others):
        pytest.fail("it was solved first")

    monkeypatch.setattr("tactilenlp.estimation.solver.solve_estimate", solved)
    monkeypatch.chdir(tmp_path)
    Measurements.load(RECORDED).save("scene.npz")
    assert main(["estimate", "scene.npz", *given]) == 2
    said = capsys.readouterr()
    assert word in said.err
    assert said.err.count("\n") == 1
    assert Measurements.load("scene.npz") == Measurements.load(RECORDED)


@pytest.mark.parametrize(("full", "code"), [(False, 130), (True, 2)])
def test_what_is_handed_out_after_ctrl_c_may_fail_in_words_too(
    touched, full, code, tmp_path, capsys, monkeypatch
):
    def stopped(given):
        raise Interrupted("stopped after 2 actions", touched)

    def written(estimate, path):
        raise WriteError("cannot be written", where=str(path), got="no space left")

    monkeypatch.setattr("tactilenlp.__main__._estimate", stopped)
    if full:
        monkeypatch.setattr("tactilenlp.output.export.export_shape", written)
    model = tmp_path / "a.stl"
    assert main(["estimate", "any.npz", "--export", str(model)]) == code
    said = capsys.readouterr()
    assert said.err.startswith("stopped after 2 actions\n")
    assert "A cuboid of" in said.out
    assert ("no space left" in said.err) == full
    assert (f"Wrote {model}." in said.out) != full
    assert model.exists() != full


def _solved(given):
    pytest.fail("it was solved first")


def test_a_format_that_there_is_not_is_said_before_minutes_are_spent(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("tactilenlp.__main__._estimate", _solved)
    model = tmp_path / "shape.txt"
    assert main(["estimate", str(RECORDED), "--export", str(model)]) == 2
    assert ".stl .obj".replace(" ", ", ") in capsys.readouterr().err


def test_ctrl_c_before_anything_was_found_is_said(capsys, monkeypatch):
    def stopped(given):
        raise Interrupted("stopped before anything was found")

    monkeypatch.setattr("tactilenlp.__main__._estimate", stopped)
    assert main(["estimate", "any.npz"]) == 130
    assert capsys.readouterr().out == ""


@pytest.mark.slow
def test_what_estimates_use_is_compiled_ahead(capsys):
    assert main(["compile", "--shape", "cuboid"]) == 0
    assert "cuboid" in capsys.readouterr().out


def test_nothing_is_compiled_ahead_without_a_compiler(monkeypatch, capsys):
    monkeypatch.setattr("tactilenlp.nlp.codegen.compiler", lambda: None)
    assert main(["compile"]) == 2
    assert "no C compiler" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--verbose", "estimate", "x"], ["estimate", "x"]])
def test_verbose_is_taken_before_and_after_the_command(words):
    assert parser().parse_args([*words, "--verbose"]).verbose
    assert parser().parse_args(words).verbose == ("--verbose" in words)
