"""Files from strangers: read without running anything, refused in words if damaged."""

import contextlib
import json
import pickle

import numpy as np
import pytest
from conftest import RECORDED

from tactilenlp import Estimate, Exploration, Measurements, Scene, Trajectories
from tactilenlp.errors import FileError, MeasurementError, SceneError, TactileError
from tactilenlp.interface.result import ESTIMATE_VERSION

CUTS, FLIPS = 12, 40  # damaged copies of each file
CURRENT = f'{{"format": "estimate", "version": {ESTIMATE_VERSION}'  # of a header


class Burglar:
    """Unpickled, it writes a file: what must never happen."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (self.path, "w")


@pytest.fixture(scope="module")
def saved(estimate, tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "estimate.npz"
    estimate.save(path)
    return path


@pytest.fixture(scope="module")
def tossed(tmp_path_factory):
    path = tmp_path_factory.mktemp("tossed") / "tosses.npz"
    position = np.random.default_rng(0).normal(size=(40, 3))
    turned = np.tile([1.0, 0.0, 0.0, 0.0], (40, 1))
    toss = np.zeros(40, int)
    Trajectories(toss=toss, position=position, quaternion=turned, dt=0.01).save(path)
    return path


@pytest.fixture(params=["measurements", "scene", "estimate", "trajectories"])
def file(request, saved, tossed):
    """Return how a kind of file is read, a good one, and the error of a bad one."""
    return {
        "measurements": (Measurements.load, RECORDED, MeasurementError),
        "scene": (Scene.load, RECORDED, SceneError),
        "estimate": (Estimate.load, saved, FileError),
        "trajectories": (Trajectories.load, tossed, MeasurementError),
    }[request.param]


def test_a_truncated_file_is_refused(file, tmp_path):
    load, good, error = file
    content, bad = good.read_bytes(), tmp_path / "bad.npz"
    for size in np.linspace(0, len(content) - 1, CUTS, dtype=int):
        bad.write_bytes(content[:size])
        with pytest.raises(error) as caught:
            load(bad)
        assert str(bad) in str(caught.value)


def test_flipped_bytes_are_refused_or_do_no_harm(file, tmp_path):
    load, good, _ = file
    content, bad = bytearray(good.read_bytes()), tmp_path / "bad.npz"
    generator = np.random.default_rng(0)
    refused = 0
    for _ in range(FLIPS):
        damaged = bytearray(content)
        for place in generator.integers(len(content), size=20):
            damaged[place] ^= int(generator.integers(1, 256))
        bad.write_bytes(damaged)
        try:
            load(bad)
        except TactileError:  # any other error fails the test
            refused += 1
    assert refused > 0  # every array has a checksum; what a loader skips may be broken


def test_what_is_no_npz_is_refused(file, tmp_path):
    load, _, error = file
    for name, content in (
        ("empty", b""), ("text", b"time,finger_position\n0,1\n"),
        ("pickle", pickle.dumps({"time": [0.0]})), ("zip", b"PK\x05\x06" + bytes(18)),
    ):  # fmt: skip
        (tmp_path / name).write_bytes(content)
        if name == "zip" and load == Scene.load:
            continue  # an archive without keys: a scene of which nothing is known
        with pytest.raises(error):
            load(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "nowhere.npz")


def test_nothing_in_a_file_is_executed(file, tmp_path):
    load, good, _ = file
    with np.load(good) as archive:
        arrays = dict(archive)
    mark, bad = tmp_path / "mark", tmp_path / "bad.npz"
    hostile = np.array([Burglar(str(mark))], dtype=object)
    for key in arrays:
        np.savez(bad, **arrays | {key: hostile})
        with contextlib.suppress(TactileError):  # keys that a loader skips do no harm
            load(bad)
        assert not mark.exists()


@pytest.mark.parametrize(
    ("header", "word"),
    [
        ("{", "damaged"),
        ("[]", "damaged"),
        ('{"format": "estimate"}', "damaged"),
        ('{"format": 1, "kind": "Estimate", "fields": {}}', "got version 1; read it"),
        ('{"format": "estimate", "version": 0}', "got version 0; read it with"),
        ('{"format": "exploration", "version": 1}', "not an estimate"),
        ('{"format": [], "version": {}}', "not an estimate"),
        ('{"format": "estimate", "version": 0, "written_by": 3}', "damaged"),
        (CURRENT, "damaged"),
        (CURRENT + ', "content": 3', "not an estimate"),
        (CURRENT + ', "content": {"kind": "Popen", "fields": {}}', "damaged"),
        (CURRENT + ', "content": {"kind": [], "fields": {}}', "damaged"),
        (CURRENT + ', "content": {"kind": "Estimate"}', "damaged"),
        (CURRENT + ', "content": {"kind": "Estimate", "fields": {}}', "no Estimate.th"),
        (CURRENT + ', "content": {"array": "nowhere"}', "damaged"),
        (CURRENT + ', "content": ' + "[" * 5000 + "]" * 5000, "damaged"),
    ],
)
def test_a_strange_header_is_refused(header, word, tmp_path):
    header += "}" if header.startswith(CURRENT) else ""
    np.savez(tmp_path / "bad.npz", header=np.array(header))
    with pytest.raises(FileError, match=word):
        Estimate.load(tmp_path / "bad.npz")


def test_a_file_with_other_fields_says_which_and_who_wrote_it(saved, tmp_path):
    with np.load(saved) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays.pop("header")))
    fields = header["content"]["fields"]
    fields["colour"] = fields.pop("status")
    header["written_by"]["tactilenlp"] = "7.0"
    np.savez(tmp_path / "other.npz", header=np.array(json.dumps(header)), **arrays)
    with pytest.raises(FileError) as caught:
        Estimate.load(tmp_path / "other.npz")
    assert caught.value.got == "Estimate.colour, no Estimate.status"
    assert "7.0" in caught.value.next
    assert str(tmp_path / "other.npz") in str(caught.value)


def test_an_estimate_is_read_without_us(saved, estimate):
    """As README.md says: numpy, json, and the names of the fields."""
    with np.load(saved) as file:
        header = json.loads(str(file["header"]))
        fields = header["content"]["fields"]
        assert np.array_equal(file[fields["theta"]["array"]], estimate.theta)
        data = fields["measurements"]["fields"]
        assert np.array_equal(file[data["time"]["array"]], estimate.measurements.time)
        sides = fields["information"]["fields"]["names"]["list"]
    assert header["format"] == "estimate"
    assert {"tactilenlp", "numpy"} <= header["written_by"].keys()
    assert fields["status"] == estimate.status
    assert tuple(sides) == estimate.information.names


def test_an_estimate_with_a_field_missing_is_refused(saved, tmp_path):
    with np.load(saved) as archive:
        arrays = dict(archive)
    for key in arrays:
        kept = {k: v for k, v in arrays.items() if k != key}
        np.savez(tmp_path / "bad.npz", **kept)
        with pytest.raises(FileError):
            Estimate.load(tmp_path / "bad.npz")


@pytest.mark.parametrize(
    ("field", "tree", "word"),
    [
        ("violations", {"dict": {"ground": "x"}}, "dict of ['str']"),
        ("iterations_by_level", {"list": [3, None]}, "tuple of ['NoneType', 'int']"),
        ("skipped", {"list": [True]}, "tuple of ['bool']"),
        ("objective", True, "is a bool"),
    ],
)
def test_a_field_with_entries_of_another_kind_is_refused(
    saved, tmp_path, field, tree, word
):
    with np.load(saved) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays["header"]))
    header["content"]["fields"][field] = tree
    arrays["header"] = np.array(json.dumps(header))
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(FileError, match=f"Estimate.{field}") as caught:
        Estimate.load(tmp_path / "bad.npz")
    assert word in str(caught.value)


def test_a_file_names_classes_without_their_modules(saved):
    with np.load(saved) as archive:
        header = str(archive["header"])
    assert '"kind": "Estimate"' in header
    assert "tactilenlp." not in header


def test_a_file_from_before_a_field_with_a_default_is_read(saved, tmp_path):
    with np.load(saved) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays["header"]))
    fields = header["content"]["fields"]
    fields.pop("fit")
    fields["scene"]["fields"].pop("compliance")
    arrays["header"] = np.array(json.dumps(header))
    np.savez(tmp_path / "old.npz", **arrays)
    old, new = Estimate.load(tmp_path / "old.npz"), Estimate.load(saved)
    assert old.fit is None
    assert old.scene == new.scene
    np.testing.assert_array_equal(old.theta, new.theta)
    fields["unheard_of"] = 1
    fields["scene"]["fields"]["mass"] = "light"  # as that version wrote it
    arrays["header"] = np.array(json.dumps(header))
    np.savez(tmp_path / "new.npz", **arrays)
    with pytest.raises(FileError, match="another version"):
        Estimate.load(tmp_path / "new.npz")


def test_an_old_estimate_is_one_to_an_exploration_as_well(tmp_path):
    old = '{"format": 1, "kind": "Estimate", "fields": {}}'
    np.savez(tmp_path / "old.npz", header=np.array(old))
    with pytest.raises(FileError, match="another version") as caught:
        Exploration.load(tmp_path / "old.npz")
    assert caught.value.got == "version 1 of an estimate"


@pytest.mark.parametrize("kind", ["estimate", "measurements", "trajectories"])
def test_a_save_that_fails_leaves_what_was_there_and_nothing_else(
    kind, estimate, tossed, tmp_path, monkeypatch
):
    path = tmp_path / "file.npz"
    tosses, felt = Trajectories.load(tossed), estimate.measurements
    made = {"estimate": estimate, "measurements": felt, "trajectories": tosses}[kind]
    made.save(path)
    before = path.read_bytes()

    def full(file, **arrays):
        file.write(b"a part")
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OSError, match="no space"):
        made.save(path)
    assert [*tmp_path.iterdir()] == [path]
    assert path.read_bytes() == before


def test_a_file_is_open_to_whom_it_was_and_a_new_one_to_whom_any_is(tmp_path):
    (tmp_path / "any").touch()
    path = tmp_path / "exploration.npz"
    Exploration().save(path)
    assert path.stat().st_mode == (tmp_path / "any").stat().st_mode
    path.chmod(0o640)
    Exploration().save(path)
    assert path.stat().st_mode & 0o777 == 0o640
    assert Exploration.load(path).steps == ()


def test_a_folder_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "nowhere" / "exploration.npz"
    with pytest.raises(FileError, match="no such folder") as caught:
        Exploration().save(path)
    error = caught.value
    assert (error.where, error.got) == (str(path), str(path.parent))
    assert error.expected
    assert error.next
