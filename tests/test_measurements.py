"""Measurements keep what was measured, and refuse what cannot have been."""

import pickle

import numpy as np
import pytest

from tactilenlp.data.measurements import LAYOUT, Measurements
from tactilenlp.errors import FileError, MeasurementError

DT = 1 / 30  # [s]
TRUTH = ("object_position", "object_quaternion", "side_lengths", "vertices", "target")
MORE_TRUTH = ("final_position", "truth_contact", "planned_start", "action_params")


def arrays(fingers=2):
    """Make 3 actions of 4 samples; finger 0 touches in the middle two of each."""
    rng = np.random.default_rng(0)
    action = np.repeat(range(3), 4)
    contact = np.zeros((12, fingers), bool)
    contact[1::4, 0] = contact[2::4, 0] = True
    normal = rng.normal(size=(12, fingers, 3)) * contact[..., None]
    normal[contact] /= np.linalg.norm(normal[contact], axis=-1, keepdims=True)
    return {
        "time": DT * np.arange(12) + 0.8 * action,
        "finger_position": rng.uniform(0.02, 0.2, (12, fingers, 3)),
        "finger_radius": 0.01,
        "contact": contact,
        "normal": normal,
        "action": action,
    }


def measurements(**changes):
    return Measurements(**arrays() | changes)


def quaternions():
    q = np.random.default_rng(1).normal(size=(12, 2, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def changed(key, index, value):
    """Return the array of this key with one entry changed."""
    array = np.array(arrays()[key])
    array[index] = value
    return array


# What is kept


def test_counts_and_interval_are_those_of_the_recording():
    data = measurements()
    assert (data.samples, data.fingers, data.actions) == (12, 2, 3)
    assert data.finger_radius.tolist() == [0.01, 0.01]
    assert data.valid.all()
    # the pauses of 0.8 s between actions are no sample intervals
    assert data.dt == pytest.approx(DT, rel=1e-12)
    assert "12 samples" in repr(data)
    assert "contacts: 6" in repr(data)


def test_the_arrays_are_read_only_copies():
    given = arrays()
    data = Measurements(**given)
    given["finger_position"][0] = 9.0
    assert data.finger_position.max() < 1.0
    for key in LAYOUT.keys() - {"finger_orientation"}:
        with pytest.raises(ValueError, match="read-only"):
            getattr(data, key)[...] = 0


def test_the_arrays_stay_read_only_on_a_journey_between_processes():
    again = pickle.loads(pickle.dumps(measurements()))
    assert again == measurements()
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
    assert data == measurements(valid=valid)


def test_contact_may_be_zeros_and_ones():
    contact = arrays()["contact"]
    assert measurements(contact=contact.astype(np.uint8)) == measurements()
    assert measurements(contact=contact.astype(float)) == measurements()


def test_an_almost_unit_normal_becomes_a_unit_normal():
    normal = arrays()["normal"]
    data = measurements(normal=normal * (1 + 5e-4))
    # a few roundings of a double
    assert np.allclose(data.normal, normal, atol=1e-15, rtol=0)
    assert measurements(normal=data.normal) == data


def test_data_without_any_contact_are_data():
    data = measurements(contact=np.zeros((12, 2), bool), normal=np.zeros((12, 2, 3)))
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


def test_scrambled_truth_changes_nothing(tmp_path):
    truth = dict.fromkeys(
        TRUTH + MORE_TRUTH, np.array([None, {"not": "read"}], dtype=object)
    )
    np.savez(tmp_path / "a.npz", **arrays(), **truth, mass="heavy")
    assert Measurements.load(tmp_path / "a.npz") == measurements()


def test_a_file_with_a_missing_key_is_refused_by_name(tmp_path):
    for key in arrays():
        np.savez(tmp_path / "a.npz", **{k: v for k, v in arrays().items() if k != key})
        with pytest.raises(MeasurementError, match=f"{key}: missing") as error:
            Measurements.load(tmp_path / "a.npz")
        assert error.value.where == key


def test_files_that_are_no_measurements_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, **arrays())
    whole = path.read_bytes()
    broken = whole[:300] + bytes(200) + whole[500:]
    np.save(tmp_path / "bare.npy", np.zeros(3))
    bare = (tmp_path / "bare.npy").read_bytes()
    pickled = pickle.dumps(arrays())
    for content in (b"", b"time,x\n0,1\n", bare, whole[:900], broken, pickled):
        path.write_bytes(content)
        with pytest.raises(MeasurementError, match="cannot be read"):
            Measurements.load(path)
    np.savez(path)
    with pytest.raises(MeasurementError, match="time: missing"):
        Measurements.load(path)


def test_objects_in_a_file_are_never_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", **arrays() | {"contact": np.array([{}, None])})
    with pytest.raises(MeasurementError, match="contact: cannot be read"):
        Measurements.load(tmp_path / "a.npz")


def test_a_file_that_does_not_exist_is_not_found(tmp_path):
    (tmp_path / "somewhere.npz").write_bytes(b"")
    with pytest.raises(FileNotFoundError) as caught:
        Measurements.load(tmp_path / "nowhere.npz")
    assert isinstance(caught.value, FileError)
    assert "did you mean 'somewhere.npz'?" in str(caught.value)
    with pytest.raises(MeasurementError, match="an empty file"):
        Measurements.load(tmp_path / "somewhere.npz")


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
    with pytest.raises(MeasurementError, match=r"numbers among \[0, 1, 2\]"):
        measurements().select(actions)


def test_appended_data_must_be_later_and_from_the_same_fingers():
    data = measurements().select([1])
    for word, other in (
        ("time: does not go on", measurements().select([0])),
        ("finger_radius: other", measurements(finger_radius=0.02).select([2])),
        ("finger_radius: other", Measurements(**arrays(fingers=1)).select([2])),
        ("finger_orientation", measurements(finger_orientation=quaternions())),
    ):
        with pytest.raises(MeasurementError, match=word):
            data.append(other)


def test_the_first_actions_are_a_prefix_and_others_are_not():
    data = measurements()
    assert data.select([0, 1]).is_prefix_of(data)
    assert data.is_prefix_of(data)
    assert not data.is_prefix_of(data.select([0, 1]))
    assert not data.select([1]).is_prefix_of(data)
    assert not measurements(finger_radius=0.011).select([0]).is_prefix_of(data)


# The door

FLAG = np.arange(24).reshape(12, 2) == 11  # one entry, of sample 5 and finger 1
NAN, INF, PLACE = np.nan, np.inf, "finger_position"
GIVEN = arrays()
BAD = [  # the key, the first bad index, what is given, a word of the message
    ("time", None, np.zeros((12, 1)), "wrong shape"),
    ("time", None, ["noon"] * 12, "wrong dtype"),
    ("time", None, [], "empty"),
    ("time", None, None, "missing"),
    ("time", (4,), changed("time", 4, NAN), "not finite"),
    ("time", (1,), changed("time", 1, 0.0), "does not increase"),
    ("time", (3,), changed("time", 3, 0.01), "does not increase"),
    ("time", (1,), 1e3 * GIVEN["time"], "looks like milliseconds"),
    (PLACE, None, np.zeros((3, 57)), "wrong shape"),
    (PLACE, None, [[0.0], []], "wrong dtype"),
    (PLACE, None, [1j] * 12, "wrong dtype"),
    (PLACE, None, np.zeros((12, 0, 3)), "empty"),
    (PLACE, (7, 1, 0), changed(PLACE, (7, 1, 0), INF), "not finite"),
    (PLACE, (6, 1, 2), changed(PLACE, (6, 1, 2), 80.0), "looks like millimetres"),
    ("finger_radius", (0,), 0.0, "not positive"),
    ("finger_radius", (1,), [0.01, -0.01], "not positive"),
    ("finger_radius", (1,), [0.01, NAN], "not finite"),
    ("finger_radius", (0,), 10.0, "looks like millimetres"),
    ("finger_radius", (0,), 1.0, "looks like centimetres"),
    ("finger_radius", None, [0.01] * 3, "wrong shape"),
    ("contact", None, np.zeros(12, bool), "wrong shape"),
    ("contact", None, FLAG.astype(object), "wrong dtype"),
    ("contact", (5, 1), 2 * FLAG, "neither True nor False"),
    ("contact", (5, 1), 0.5 * FLAG, "neither True nor False"),
    ("contact", (5, 1), np.where(FLAG, NAN, 0), "neither True nor False"),
    ("valid", None, np.ones(12, bool), "wrong shape"),
    ("valid", (5, 1), 2 * FLAG, "neither True nor False"),
    ("normal", None, np.zeros((12, 3)), "wrong shape"),
    ("normal", (2, 0, 1), changed("normal", (2, 0, 1), NAN), "not finite"),
    ("normal", (1, 0), 1.01 * GIVEN["normal"], "not of unit length"),
    ("normal", (3, 0), changed("normal", (3, 0, 2), 1.0), "normal without contact"),
    ("normal", (1, 0), changed("normal", (1, 0), 0.0), "contact without normal"),
    ("action", None, 1.0 * GIVEN["action"], "wrong dtype"),
    ("action", (4,), GIVEN["action"][::-1], "decreases"),
    ("finger_orientation", None, np.zeros((12, 2, 3)), "wrong shape"),
    ("finger_orientation", (0, 0), np.zeros((12, 2, 4)), "not of unit length"),
]


@pytest.mark.parametrize(("key", "index", "value", "word"), BAD)
def test_bad_input_is_refused_by_key_and_first_bad_index(key, index, value, word):
    with pytest.raises(MeasurementError, match=word) as error:
        measurements(**{key: value})
    assert (error.value.where, error.value.index) == (key, index)
    # the key comes first; what was expected, got and is to be done are said
    assert str(error.value).startswith(f"{key}: ")
    assert all((error.value.expected, error.value.got, error.value.next))


def test_a_recording_in_millimetres_is_recognised_by_its_paths():
    with pytest.raises(MeasurementError, match="finger_position: looks like milli"):
        measurements(finger_position=1e3 * GIVEN[PLACE])


def test_arrays_of_different_length_do_not_make_a_recording():
    with pytest.raises(MeasurementError, match="T is 11 here") as error:
        measurements(time=GIVEN["time"][:11])
    assert error.value.where == "finger_position"


def test_actions_of_one_sample_have_no_interval():
    with pytest.raises(MeasurementError, match="time: no interval"):
        _ = measurements(action=np.arange(12)).dt
