"""Files from strangers: read without running anything, refused in words if damaged."""

import contextlib
import pickle

import numpy as np
import pytest
from conftest import RECORDED

from tactilenlp import Estimate, Measurements, Scene, Trajectories
from tactilenlp.errors import FileError, MeasurementError, SceneError, TactileError

CUTS, FLIPS = 12, 40  # damaged copies of each file


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
        ('{"format": 99}', "another format"),
        ('{"format": 1}', "damaged"),
        ('{"format": 1, "kind": "Popen", "fields": {}}', "damaged"),
        ('{"format": 1, "kind": "Estimate", "fields": {}}', "damaged"),
        ('{"format": 1, "kind": "Ground", "fields": {}}', "not an estimate"),
        ('{"format": 1, "array": "nowhere"}', "damaged"),
        ('{"format": 1, "list": ' + "[" * 5000 + "]" * 5000 + "}", "damaged"),
    ],
)
def test_a_strange_header_is_refused(header, word, tmp_path):
    np.savez(tmp_path / "bad.npz", header=np.array(header))
    with pytest.raises(FileError, match=word):
        Estimate.load(tmp_path / "bad.npz")


def test_an_estimate_with_a_field_missing_is_refused(saved, tmp_path):
    with np.load(saved) as archive:
        arrays = dict(archive)
    for key in arrays:
        kept = {k: v for k, v in arrays.items() if k != key}
        np.savez(tmp_path / "bad.npz", **kept)
        with pytest.raises(FileError):
            Estimate.load(tmp_path / "bad.npz")
