"""Measurements keep what was measured, and refuse what cannot have been."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from tactilenlp.errors import MeasurementError
from tactilenlp.measurements import LAYOUT, Measurements

SCENES = Path(__file__).parents[2] / "shared" / "scenes"
DT = 1 / 30  # [s]
TRUTH = ("object_position", "side_lengths", "vertices", "truth_contact", "target")


def arrays(actions=3, samples=4, fingers=2, seed=0):
    """Make valid arrays: finger 0 touches in samples 1 and 2 of every action."""
    rng = np.random.default_rng(seed)
    T = actions * samples
    action = np.repeat(np.arange(actions), samples)
    contact = np.zeros((T, fingers), bool)
    contact[1::samples, 0] = contact[2::samples, 0] = True
    normal = rng.normal(size=(T, fingers, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return {
        "time": DT * np.arange(T) + 0.8 * action,
        "finger_position": rng.uniform(0.02, 0.2, (T, fingers, 3)),
        "finger_radius": 0.01,
        "contact": contact,
        "normal": np.where(contact[..., None], normal, 0.0),
        "action": action,
    }


def measurements(**changes):
    return Measurements(**arrays() | changes)


def quaternions(seed=1, shape=(12, 2)):
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def changed(key, index, value):
    """Change one entry of one array."""
    array = np.array(arrays()[key])
    array[index] = value
    return {key: array}


def without(key):
    return {k: v for k, v in arrays().items() if k != key}


# What is kept


def test_one_radius_holds_for_all_fingers():
    assert measurements().finger_radius.tolist() == [0.01, 0.01]


def test_counts_and_interval_are_those_of_the_recording():
    data = measurements()
    assert (data.samples, data.fingers, data.actions) == (12, 2, 3)
    # the pauses of 0.8 s between actions are no sample intervals
    assert data.dt == pytest.approx(DT, rel=1e-12)
    assert "12 samples" in repr(data)
    assert "contacts: 6" in repr(data)


def test_the_arrays_are_copies_that_nobody_can_write_to():
    given = arrays()
    data = Measurements(**given)
    given["finger_position"][0] = 9.0
    assert data.finger_position.max() < 1.0
    for key in LAYOUT.keys() - {"finger_orientation"}:
        with pytest.raises(ValueError, match="read-only"):
            getattr(data, key)[...] = 0


def test_the_arrays_stay_read_only_on_a_journey_between_processes():
    data = measurements(finger_orientation=quaternions())
    again = pickle.loads(pickle.dumps(data))
    assert again == data
    assert not again.time.flags.writeable


def test_what_is_not_valid_is_neither_contact_nor_normal_whatever_it_holds():
    given = arrays()
    valid = np.ones((12, 2), bool)
    valid[1, 0] = valid[0, 1] = False
    given["contact"] = given["contact"].astype(float)
    given["contact"][0, 1], given["normal"][0, 1] = np.nan, (np.nan, 7.0, np.inf)
    data = Measurements(**given, valid=valid)
    assert not data.contact[~valid].any()
    assert not data.normal[~valid].any()
    assert data.contact.sum() == 5
    clean = measurements(valid=valid)
    assert data == clean


def test_a_position_must_be_known_even_where_not_valid():
    valid = np.ones((12, 2), bool)
    valid[3, 1] = False
    with pytest.raises(MeasurementError, match="finger_position: not finite") as error:
        measurements(valid=valid, **changed("finger_position", (3, 1, 2), np.nan))
    assert error.value.index == (3, 1, 2)


def test_valid_is_true_where_nothing_is_said():
    assert measurements().valid.all()


def test_contact_may_be_zeros_and_ones():
    contact = arrays()["contact"]
    assert measurements(contact=contact.astype(np.uint8)) == measurements()
    assert measurements(contact=contact.astype(float)) == measurements()


def test_an_almost_unit_normal_becomes_a_unit_normal():
    given = arrays()
    data = measurements(normal=given["normal"] * (1 + 5e-4))
    length = np.linalg.norm(data.normal[data.contact], axis=-1)
    assert abs(length - 1).max() < 1e-15  # a few roundings of a double
    assert np.allclose(data.normal, given["normal"], atol=1e-15, rtol=0)


def test_data_without_any_contact_are_data():
    nothing = np.zeros((12, 2), bool)
    data = measurements(contact=nothing, normal=np.zeros((12, 2, 3)))
    assert not data.contact.any()


def test_equality_is_that_of_the_contents():
    assert measurements() == measurements()
    assert measurements() != measurements(finger_radius=0.011)
    assert measurements() != measurements(finger_orientation=quaternions())
    assert measurements() != "measurements"


# Files


def test_a_file_gives_back_every_digit(tmp_path):
    valid = np.ones((12, 2), bool)
    valid[2] = False
    normal = arrays()["normal"].astype(np.float32)  # rounded, so renormalised once
    data = measurements(
        valid=valid, normal=normal, finger_orientation=quaternions() * (1 + 1e-4)
    )
    data.save(tmp_path / "a")  # the path is taken as it is, no suffix is added
    assert Measurements.load(tmp_path / "a") == data
    data.transformed(np.eye(3), np.zeros(3)).save(str(tmp_path / "b.npz"))
    again = Measurements.load(str(tmp_path / "b.npz"))
    assert again.select(range(3)) == again


def test_scrambled_truth_changes_nothing(tmp_path):
    truth = dict.fromkeys(TRUTH, np.array([None, {"not": "read"}], dtype=object))
    np.savez(tmp_path / "a.npz", **arrays(), **truth, mass="heavy")
    assert Measurements.load(tmp_path / "a.npz") == measurements()


@pytest.mark.skipif(not SCENES.is_dir(), reason=f"no recorded scenes at {SCENES}")
def test_recorded_scenes_come_back_to_the_last_digit(tmp_path):
    paths = sorted(SCENES.glob("*.npz"))[::7]
    assert paths
    for path in paths:
        data = Measurements.load(path)
        data.save(tmp_path / "again.npz")
        assert Measurements.load(tmp_path / "again.npz") == data
        raw = np.load(path)
        assert np.array_equal(raw["finger_position"], data.finger_position)
        assert np.array_equal(raw["contact"] & raw["valid"], data.contact)
        assert data.dt == pytest.approx(DT)


@pytest.mark.parametrize("key", sorted(arrays()))
def test_a_file_with_a_missing_key_is_refused_by_name(tmp_path, key):
    np.savez(tmp_path / "a.npz", **without(key))
    with pytest.raises(MeasurementError, match="missing") as error:
        Measurements.load(tmp_path / "a.npz")
    assert error.value.where == key


def test_files_that_are_no_measurements_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, **arrays())
    whole = path.read_bytes()
    with open(tmp_path / "one.npy", "wb") as stream:
        np.save(stream, np.zeros(3))
    bare = (tmp_path / "one.npy").read_bytes()
    broken = whole[:300] + bytes(200) + whole[500:]
    pickled = pickle.dumps(arrays())
    for content in (b"", b"time,x\n0,1\n", bare, whole[:900], broken, pickled):
        path.write_bytes(content)
        with pytest.raises(MeasurementError, match="cannot be read") as error:
            Measurements.load(path)
        assert error.value.next
        assert error.value.expected


def test_an_empty_archive_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz")
    with pytest.raises(MeasurementError, match="time: missing"):
        Measurements.load(tmp_path / "a.npz")


def test_objects_in_a_file_are_never_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", **arrays() | {"contact": np.array([{}, None])})
    with pytest.raises(MeasurementError, match="contact: cannot be read") as error:
        Measurements.load(tmp_path / "a.npz")
    assert error.value.where == "contact"


def test_a_file_that_does_not_exist_is_not_found(tmp_path):
    with pytest.raises(FileNotFoundError):
        Measurements.load(tmp_path / "nowhere.npz")


# Actions


def test_actions_taken_apart_and_appended_are_the_whole():
    data = measurements(finger_orientation=quaternions())
    first, second, third = (data.select([action]) for action in range(3))
    assert first.append(second).append(third) == data
    assert first.append(second.append(third)) == data


def test_appended_actions_are_numbered_on():
    data = measurements()
    later = measurements(time=data.time + 10, action=data.action * 2 + 7)
    assert data.append(later).action.tolist() == np.repeat(range(6), 4).tolist()


def test_selected_actions_keep_their_numbers_and_the_order_of_time():
    part = measurements().select({2, 1})
    assert part.action.tolist() == [1] * 4 + [2] * 4
    assert np.all(np.diff(part.time) > 0)


@pytest.mark.parametrize("actions", [[], [3], [0, -1], [True, False, True], ["0"]])
def test_selecting_what_is_not_there_names_what_is(actions):
    with pytest.raises(MeasurementError, match=r"choose from \[0, 1, 2\]"):
        measurements().select(actions)


def test_appended_data_must_be_later():
    data = measurements()
    with pytest.raises(MeasurementError, match="time: does not go on") as error:
        data.append(data.select([2]))
    assert error.value.index == (0,)


def test_appended_data_must_come_from_the_same_fingers():
    data, part = measurements().select([0]), measurements(finger_radius=0.02)
    with pytest.raises(MeasurementError, match="finger_radius: other fingers"):
        data.append(part.select([1]))
    single = Measurements(**arrays(fingers=1))
    with pytest.raises(MeasurementError, match="finger_radius: other fingers"):
        data.append(single.select([1]))
    capsule = measurements(finger_orientation=quaternions())
    with pytest.raises(MeasurementError, match="finger_orientation: in one of two"):
        data.append(capsule.select([1]))


def test_the_first_actions_are_a_prefix_and_others_are_not():
    data = measurements()
    assert data.select([0, 1]).is_prefix_of(data)
    assert data.is_prefix_of(data)
    assert not data.is_prefix_of(data.select([0, 1]))
    assert not data.select([1]).is_prefix_of(data)
    assert not measurements(finger_radius=0.011).select([0]).is_prefix_of(data)
