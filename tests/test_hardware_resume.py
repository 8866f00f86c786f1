"""An exploration on the robot whose process dies goes on in another one.

A kill loses nothing that was stored; but the interrupted action may have moved the
object, whose touches are then others than without a kill.  Therefore the resumed run is
compared with its twin: an exploration in one process, without a kill, whose object is
put where the interrupted action left it, after as many steps as were stored.  The two
runs share the stored steps and the choice of the next action, to the last digit.  That
action follows the same paths, sampled at other instants.  Its touches, and by them all
later choices, then differ a little: the sides agree within their sigma.
"""

import os
import shutil
import time

import numpy as np
import pytest
from bench_resume import KEPT, REALITY, Process, kept

# The full run is TACTILENLP_KILLS=20.
KILLS = int(os.environ.get("TACTILENLP_KILLS", "1"))
ACTIONS = 1 if KILLS == 1 else 3
CLOSE = 5e-4  # [m] between the sides after the same touches, sampled at other instants
SIGMAS = 3.0  # [1] between the sides after touches that differ
FARTHEST = 8e-3  # [m] between the sides at all, however wide sigma is
CLOSE_PATH = 4.6e-3  # [m] between samples of one path: half an interval at 0.28 m/s


def check_together(first, second):
    """Two explorations hold the same actions, whose times go on."""
    for one in (first, second):
        data = one.estimate.measurements
        assert (np.diff(data.time) > 0).all()
        assert data.actions == len(one.steps)
    assert [s.number for s in first.steps] == [s.number for s in second.steps]


def sides(exploration):
    return np.sort(exploration.estimate.side_lengths)


def sigma(exploration):
    information = exploration.estimate.information
    order = np.argsort(exploration.estimate.side_lengths)
    return information.sigma("side_lengths")[order]


def allowed(first, second):
    """Return by how much sides may differ (3,) [m]: the last action is sampled anew."""
    wide = np.maximum(CLOSE, SIGMAS * np.hypot(sigma(first), sigma(second)))
    return np.minimum(wide, FARTHEST)


@pytest.mark.slow
def test_a_run_that_is_killed_after_action_2_ends_as_one_that_is_not(tmp_path):
    folders = [tmp_path / name for name in ("whole", "killed")]
    for folder in folders:
        folder.mkdir()
    whole, killed = (Process(folder, 3) for folder in folders)
    assert killed.wait_for("step 2")
    killed.kill()
    left = kept(folders[1])
    Process(folders[1], 3).finish()
    whole.finish()
    first, second = map(kept, folders)
    check_together(first, second)
    for k in range(3):
        assert second.at(k).measurements == first.at(k).measurements
        assert second.at(k).measurements == left.at(k).measurements
        assert second.at(k).estimate.objective == first.at(k).estimate.objective
    chosen = [one.at(3).action.angles for one in (first, second)]
    assert np.array_equal(*chosen)
    off = abs(sides(first) - sides(second))
    print(f"sides differ by {1e3 * off.max():.3f} mm")
    assert (off < allowed(first, second)).all()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An exploration that nobody killed, and its duration [s]."""
    folder = tmp_path_factory.mktemp("whole")
    began = time.monotonic()
    Process(folder, ACTIONS).finish()
    return kept(folder), time.monotonic() - began


@pytest.mark.slow
@pytest.mark.parametrize("trial", range(KILLS))
def test_a_run_that_is_killed_at_any_moment_loses_nothing(whole, trial, tmp_path):
    undisturbed, duration = whole
    rng = np.random.default_rng([trial, 9])
    process = Process(tmp_path, ACTIONS)
    ran = process.kill(rng.uniform(0.0, duration))
    left, as_left, apart = kept(tmp_path), tmp_path / "left", tmp_path / "twin"
    for folder in (as_left, apart):
        folder.mkdir()
    for file in (tmp_path / KEPT, tmp_path / REALITY):
        if file.exists():
            shutil.copy(file, as_left)
    Process(tmp_path, ACTIONS).finish()
    Process(apart, ACTIONS, as_left).finish()
    ended, twin = kept(tmp_path), kept(apart)
    check_together(undisturbed, ended)
    check_stored(left, ended, twin)
    check_next(len(left.steps), ended, twin)
    off, moved = abs(sides(twin) - sides(ended)), abs(sides(undisturbed) - sides(ended))
    print(
        f"killed {ran}, {len(left.steps)} kept, {1e3 * off.round(6)} mm from the twin, "
        f"{1e3 * moved.round(6)} mm from the run whose object was not moved"
    )
    assert (off < allowed(twin, ended)).all()
    if left.steps:  # else all touches are those of an object that lies elsewhere
        assert (moved < allowed(undisturbed, ended)).all()
    assert sorted(tmp_path.glob("*.npz")) == [tmp_path / KEPT]


def check_stored(left, ended, twin):
    """The stored steps are kept, and those of the twin are the same."""
    for step in left.steps:
        for other in (ended, twin):
            assert other.at(step.number).measurements == step.measurements
        if step.estimate is not None:
            objective = step.estimate.objective
            assert ended.at(step.number).estimate.objective == objective
            assert twin.at(step.number).estimate.objective == objective


def check_next(number, ended, twin):
    """The action that was interrupted is chosen and followed as that of the twin."""
    if number > ACTIONS:  # it was killed after the last one
        return
    ours, other = ended.at(number), twin.at(number)
    if number:  # the first touch is not chosen
        assert np.array_equal(ours.action.angles, other.action.angles)
    paths = [step.measurements.finger_position for step in (ours, other)]
    samples = min(map(len, paths))
    assert abs(len(paths[0]) - len(paths[1])) <= 1
    apart = np.linalg.norm(paths[0][:samples] - paths[1][:samples], axis=2)
    print(f"action {number}: fingertips are {1e3 * apart.max():.2f} mm apart")
    assert apart.max() < CLOSE_PATH
