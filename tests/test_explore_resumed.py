"""An exploration goes on with a world that was made anew and begins at time zero."""

import json
from dataclasses import replace

import numpy as np
import pytest
from test_explore import SAME, Recorder, fresh

from tactilenlp import Exploration, World, choose_action, explore
from tactilenlp.errors import MeasurementError, StartError

ONE = SAME | {"actions": 1}


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A first touch, the file that keeps it, and the action that follows at once."""
    file = tmp_path_factory.mktemp("begun") / "kept.npz"
    steps = explore(fresh(), file=file, **ONE)
    first, kept = next(steps), file.read_bytes()
    return first, kept, next(steps)


@pytest.fixture
def file(begun, tmp_path):
    path = tmp_path / "kept.npz"
    path.write_bytes(begun[1])
    return path


@pytest.fixture(scope="module")
def resumed(begun, tmp_path_factory):
    """The same action in a world made anew that knows no truth, and its file."""
    file = tmp_path_factory.mktemp("resumed") / "kept.npz"
    file.write_bytes(begun[1])
    *_, last = explore(Recorder(fresh()), file=file, **ONE)
    return last, file


def test_times_go_on_after_those_that_are_kept(begun, resumed):
    first, (last, file) = begun[0], resumed
    assert last.estimate.measurements.actions == 2
    assert last.measurements.time[0] == first.measurements.time[-1] + 1.0
    assert np.ptp(last.measurements.time) == pytest.approx(1.0, abs=0.05)
    assert Exploration.load(file).at(1).measurements == last.measurements
    *_, again = explore(None, file=file, workspace=last.action.workspace, **ONE)
    assert again.estimate.objective == last.estimate.objective


def test_a_kept_choice_is_repeated_from_its_seed_and_older_files_have_none(
    begun, resumed, tmp_path
):
    last, file = resumed
    kept = Exploration.load(file).at(1).choice
    given = {"search": kept.search, "budget": kept.evaluations, "seed": kept.seed}
    again = choose_action(begun[0].estimate, last.action.workspace, **given)
    assert np.array_equal(again.tried, kept.tried)
    with np.load(file) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays["header"]))
    choice = header["content"]["fields"]["steps"]["list"][1]["fields"]["choice"]
    del choice["fields"]["seed"]
    older = tmp_path / "older.npz"
    np.savez(older, **arrays | {"header": np.array(json.dumps(header))})
    assert Exploration.load(older).at(1).choice.seed is None


def test_a_replayed_world_measures_as_if_nothing_had_happened(begun, file):
    world = fresh()
    Exploration.load(file).replay(world)
    *_, last = explore(world, file=file, **ONE)
    assert last.errors  # the world knows the truth of every saved sample
    assert last.measurements == begun[2].measurements


def test_a_world_that_was_not_replayed_is_refused_and_the_file_left(begun, file):
    with pytest.raises(StartError, match=r"load\(file\)\.replay\(world\) repeats"):
        list(explore(fresh(), file=file, **ONE))
    assert file.read_bytes() == begun[1]


def test_another_world_is_not_replayed(file):
    with pytest.raises(StartError, match="step 0: saved with another object"):
        Exploration.load(file).replay(World((0.03, 0.03, 0.03)))


def test_a_kept_step_whose_times_do_not_go_on_is_taken_up_too(begun, resumed, file):
    first, last = begun[0], resumed[0]
    data = replace(
        last.measurements, time=last.measurements.time - last.measurements.time[0]
    )
    broken = replace(last, measurements=data, estimate=None)
    Exploration((first, broken)).save(file)
    *_, again = explore(Recorder(fresh()), file=file, **ONE)
    times = [one.estimate.measurements.time for one in (again, last)]
    assert times[0] == pytest.approx(times[1], abs=1e-12)


class Stuck(Recorder):
    """A world whose clock does not go on."""

    def execute(self, trajectory):
        data = super().execute(trajectory)
        return replace(data, time=data.time - data.time[0])


def test_what_cannot_be_appended_is_not_stored(tmp_path):
    file = tmp_path / "kept.npz"
    with pytest.raises(MeasurementError, match="does not go on"):
        list(explore(Stuck(fresh()), file=file, **SAME))
    assert [step.number for step in Exploration.load(file).steps] == [0]


def test_times_go_on_after_those_of_a_start_and_such_a_world_is_replayed(
    begun, tmp_path
):
    """A file that a start was given to has later times than a world made anew."""
    first, file = begun[0], tmp_path / "later.npz"
    (last,) = explore(fresh(), file=file, start=first.estimate, **ONE)
    assert last.estimate.measurements.actions == 2
    assert last.measurements.time[0] > first.measurements.time[-1]
    Exploration.load(file).replay(fresh())
