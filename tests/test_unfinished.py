"""Ctrl-C leaves what was found so far, marked as unfinished, good to go on from."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from importlib import import_module

import pytest
from conftest import RECORDED
from programmes import octahedron

from tactilenlp import (
    Estimate,
    Options,
    solve_estimate,
    surface_distance,
)
from tactilenlp.errors import Interrupted

QUICK = Options(hypotheses=2, starts=3, profile_likelihood=False)
LONGEST = 60.0  # [s] until a process that was told to stop must have ended


@pytest.fixture
def pressed(monkeypatch):
    """Return a function: press Ctrl-C after so many calls of a module's function."""

    def press(module, name, calls):
        inner, count = getattr(module, name), [0]

        def counted(*arguments, **more):
            count[0] += 1
            if count[0] > calls:
                raise KeyboardInterrupt
            return inner(*arguments, **more)

        monkeypatch.setattr(module, name, counted)

    return press


@pytest.mark.slow
def test_a_search_leaves_the_actions_it_is_through_with(recorded, pressed, monkeypatch):
    from tactilenlp.search import multi_hypothesis as search

    data, scene, _ = recorded
    data = data.select(range(3))
    pressed(search, "tracks_after", 2)
    with pytest.raises(Interrupted, match="2 of 3 actions") as stop:
        solve_estimate(data, scene, options=QUICK, throw=False)
    found = stop.value.estimate
    assert not found.success
    assert found.status.startswith("interrupted, 2 of 3 actions")
    assert found.measurements == data.select(range(2))
    assert found.summary().startswith("NOT SOLVED (interrupted, 2 of 3 actions")
    assert found.theta[0] >= found.theta[1]  # as every estimate names its axes
    monkeypatch.undo()
    whole = solve_estimate(data, scene, options=QUICK, start=found)
    never = solve_estimate(data, scene, options=QUICK)
    assert whole.measurements == data
    assert whole.objective == pytest.approx(never.objective, abs=1e-3)  # [nats]
    assert whole.theta == pytest.approx(never.theta, abs=1e-5)


def test_solved_pages_are_left_as_they_are(recorded, pressed, tmp_path):
    from tactilenlp.refinement import certification

    data, scene, _ = recorded
    data = data.select(range(2))
    pressed(certification, "certify", 0)
    with pytest.raises(Interrupted) as stop:
        solve_estimate(data, scene, options=QUICK)
    found = stop.value.estimate
    assert found.formulation == "violation_implicit"
    assert found.status.startswith("interrupted, 2 of 2 actions, Solve")
    assert found.seconds["total"] > found.seconds["solve"]
    found.save(tmp_path / "unfinished.npz")
    assert Estimate.load(tmp_path / "unfinished.npz").status == found.status


@pytest.mark.parametrize(
    ("module", "name", "flat"),
    [("refinement", "freed_to_tilt", True), ("certification", "certify", False)],
)
def test_a_page_solved_flat_is_left_until_one_is_solved_in_free_motion(
    recorded, pressed, module, name, flat
):
    data, scene, _ = recorded
    pressed(import_module(f"tactilenlp.refinement.{module}"), name, 0)
    free = replace(QUICK, without="planar")
    with pytest.raises(Interrupted) as stop:
        solve_estimate(data.select([0]), scene, options=free)
    found = stop.value.estimate
    assert found.formulation == "violation_implicit"
    assert found.reductions["planar"] == flat


@pytest.mark.slow
def test_rough_levels_of_a_multistart_are_better_than_least_motion(recorded, pressed):
    from tactilenlp.search import multistart

    data, scene, _ = recorded
    data = data.select(range(2))
    pressed(multistart, "solved_from", 1)  # one hypothesis, before its last level
    with pytest.raises(Interrupted) as stop:
        solve_estimate(data, scene, options=QUICK)
    found = stop.value.estimate
    assert found.formulation == "violation_implicit"
    assert found.status.startswith("interrupted, 2 of 2 actions")
    assert found.impulses["finger 0"].any()


@pytest.mark.slow
def test_a_search_for_a_polytope_leaves_what_its_planes_carve_out(pressed, monkeypatch):
    from tactilenlp.search import polytope_init as polytopes

    data, scene, true = octahedron(3)
    pressed(polytopes, "extended_faces", 2)
    with pytest.raises(Interrupted, match="2 of 3 actions") as stop:
        solve_estimate(data, scene, shape="polytope")
    found = stop.value.estimate
    assert not found.success
    assert found.measurements == data.select(range(2))
    assert found.vertices.shape == (20, 3)
    monkeypatch.undo()
    whole = solve_estimate(data, scene, shape="polytope", start=found, throw=False)
    assert surface_distance(whole.mesh(), true).mean < 4e-3  # [m], few faces touched


def test_before_anything_is_found_there_is_nothing(recorded, pressed):
    from tactilenlp.search import multi_hypothesis as search

    pressed(search, "tracks_after", 0)
    with pytest.raises(KeyboardInterrupt, match="before anything") as stop:
        solve_estimate(recorded[0], recorded[1], options=QUICK)
    assert stop.value.estimate is None
    assert not isinstance(stop.value, Exception)  # no `except Exception` swallows it


@pytest.mark.slow
def test_a_real_ctrl_c_ends_the_command_and_leaves_a_file(tmp_path):
    """The signal meets compiled code, as it does at a terminal."""
    saved = tmp_path / "estimate.npz"
    words = ["--verbose", "estimate", str(RECORDED), "--save", str(saved)]
    process = subprocess.Popen(
        [sys.executable, "-m", "tactilenlp", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        # What runs in the background of a shell would not hear it, nor its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    for line in process.stderr:
        if "2 of " in line:  # actions searched: there is something to leave
            break
    os.kill(process.pid, signal.SIGINT)
    said, error = process.communicate(timeout=LONGEST)
    assert process.returncode == 130, error
    assert "stopped by Ctrl-C" in error
    assert "Traceback" not in error
    assert said.startswith("NOT SOLVED (interrupted")
    assert "A cuboid of " in said
    assert Estimate.load(saved).status.startswith("interrupted, ")
