"""What the simulated world records: times, contacts, what is valid, and its truth."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import RECORDED
from pushes import SIZES, gap_and_normal, line, push

from tactilenlp.data.measurements import Measurements
from tactilenlp.data.noise_model import Noise
from tactilenlp.data.scene import Ground, Scene
from tactilenlp.errors import SceneError
from tactilenlp.simulation.world import World

DATA = RECORDED


def test_contact_is_a_normal_force_above_the_threshold(pushed):
    truth = pushed[0].truth
    assert (truth.contact == (truth.normal_force > 0.05)).all()
    numb = World(SIZES, contact_force=50.0)
    data = numb.execute(push())
    assert not data.contact.any()
    assert not data.normal.any()
    assert numb.truth.normal_force.max() > 0.5
    # Equal physics, so equal forces: the threshold is in the sensor only.
    np.testing.assert_array_equal(numb.truth.normal_force, truth.normal_force[:31])


@pytest.mark.slow
def test_parked_finger_is_not_valid_even_where_it_is_touched():
    world = World(SIZES)
    stop = [-0.036, 0.0, 0.02]  # behind the box, which is pushed against it
    data = world.execute(line(([0.1, 0.0, 0.02], [0.0, 0.0, 0.02]), (stop, stop)))
    assert data.valid[:, 0].all()
    assert not data.valid[:, 1].any()
    assert not data.contact[:, 1].any()
    assert world.truth.contact[:, 1].any()
    assert np.linalg.norm(data.finger_position[:, 1] - stop, axis=1).max() < 5e-3


def test_time_goes_on_and_actions_are_numbered(pushed):
    world, first, second = pushed
    both = first.append(second)
    assert both == world.measurements
    assert both.action.tolist() == [0] * 31 + [1] * 31
    assert (np.diff(both.time) > 0).all()
    np.testing.assert_allclose(np.diff(first.time), 1 / 30)
    assert first.time[0] == pytest.approx(0.3)  # settled before
    assert second.time[0] - first.time[-1] == pytest.approx(0.8)
    assert world.time - second.time[-1] == pytest.approx(0.8)


def test_retraction_is_not_recorded_and_leaves_the_object_alone(pushed):
    world, first, second = pushed
    x = first.finger_position[:, 0, 0]
    assert (np.diff(x) < 0).all()  # inwards only
    assert x[-1] == pytest.approx(0.0, abs=1e-3)
    assert first.contact[-1, 0]
    assert not second.contact[:15].any()
    before, after = world.truth.object_position[[30, 31]]
    assert np.linalg.norm(after - before) < 1e-4
    # The finger is back where it began, at rest, to the stiffness of its servo.
    np.testing.assert_allclose(world.plant.fingers[0], [0.1, 0.006, 0.02], atol=1e-4)


def test_saved_world_loads_as_measurements_and_keeps_its_truth(pushed, tmp_path):
    world = pushed[0]
    world.save(tmp_path / "scene.npz")
    assert Measurements.load(tmp_path / "scene.npz") == world.measurements
    with np.load(tmp_path / "scene.npz") as file:
        np.testing.assert_array_equal(file["side_lengths"], SIZES)
        assert (file["final_position"] == file["object_position"][-1]).all()
        assert file["object_quaternion"].shape == (62, 4)
        assert (file["mass"], file["friction_ground"]) == (0.5, 0.3)
        assert {"friction_finger", "truth_impulse", "truth_distance"} <= set(file)
    with pytest.raises(SceneError, match="execute a trajectory"):
        World(SIZES, settle=0).save(tmp_path / "nothing.npz")


@pytest.mark.parametrize(
    ("about", "ground"),
    [
        ({"ground": 0.3}, Ground(height=0.3)),
        ({"ground": -0.02, "gravity": 1.6}, Ground(height=-0.02)),
        ({"ground": None, "gravity": 0.0, "position": (0.0, 0.0, 0.2)}, None),
    ],
    ids=["raised", "on the moon", "floating"],
)
def test_a_saved_world_gives_the_scene_it_was_recorded_in(about, ground, tmp_path):
    world = World(SIZES, mass=0.2, friction_ground=0.4, settle=0, **about)
    above = line(([0.2, 0.0, 0.5], [0.2, 0.1, 0.5]), ([-0.2, 0, 0.5], [-0.2, 0, 0.5]))
    world.execute(above)
    world.save(tmp_path / "scene.npz")
    known = {"mass": 0.2, "friction_ground": 0.4, "gravity": world.gravity}
    assert Scene.load(tmp_path / "scene.npz") == Scene(ground=ground, **known)


@pytest.mark.parametrize("height", [np.nan, [0.1, 0.2], "low", np.empty((0, 3)), True])
def test_a_height_of_the_ground_that_is_no_number_is_refused(height, tmp_path):
    np.savez(tmp_path / "a.npz", mass=0.5, ground_height=height)
    with pytest.raises(SceneError) as error:
        Scene.load(tmp_path / "a.npz")
    assert error.value.where == "ground_height"
    assert "empty array" in error.value.next
    assert Scene.load(tmp_path / "a.npz", ground=None).ground is None


@pytest.mark.slow
def test_equal_worlds_record_equal_data_to_the_last_digit(pushed):
    noise = Noise(1e-3, 1e-3, 0.1, 0.05, 0.05, seed=4)
    a, b = World(SIZES, noise=noise), World(SIZES, noise=noise)
    assert a.execute(push()) == b.execute(push())
    twin = copy.deepcopy(a)  # to predict with, for instance
    assert twin.execute(push(reach=-0.05)) == a.execute(push(reach=-0.05))
    assert b.truth.object_position.shape == (31, 3)
    for name, value in vars(a.truth).items():  # clean, whatever the sensors add
        np.testing.assert_array_equal(value, getattr(pushed[0].truth, name))


@pytest.mark.slow
def test_a_record_of_another_rate_sees_the_same_motion():
    slow, fast = World(SIZES), World(SIZES, rate=120)
    seldom, often = slow.execute(push()), fast.execute(push())
    assert often.dt == pytest.approx(1 / 120)
    np.testing.assert_allclose(often.time[::4], seldom.time, atol=1e-12)
    np.testing.assert_array_equal(
        fast.truth.object_position[::4], slow.truth.object_position
    )


def test_shipped_recording_is_small_and_touches_what_it_says():
    data = Measurements.load(DATA)
    assert DATA.stat().st_size < 60_000
    assert np.unique(data.action).tolist() == [0, 1, 2, 3, 4, 5]
    assert data.contact.any(axis=0).all()
    assert data.valid[data.action > 0].all()
    assert not data.valid[data.action == 0, 1].any()
    with np.load(DATA) as file:
        keys = ("finger_position", "object_position", "object_quaternion")
        truth = SimpleNamespace(**{key: file[key] for key in keys})
        distance, normal = gap_and_normal(file["side_lengths"], truth)
        assert {"mass", "friction_ground", "friction_finger"} <= set(file)
    assert abs(distance[data.contact] - 0.01).max() < 1e-4
    # Once a finger skips round an edge, at 0.07 m/s since it was felt, 5 ms before.
    assert abs(normal - data.normal)[data.contact].max() < 0.05
