"""Files are written completely or not at all: full disks, links, pipes, long names."""

import errno
import io
import os
import zipfile

import numpy as np
import pytest

from hardware.errors import RigError
from hardware.rig import Rig
from hardware.simulated_robot import simulated_rig
from tactilenlp import Estimate, Exploration, Measurements, Scene
from tactilenlp.common import npz, whole_file
from tactilenlp.errors import FileError, MeasurementError, SceneError, WriteError


class FullDisk:
    """Files as os.fdopen opens them, of which write number `left` fails."""

    def __init__(self, left):
        self.left, self.open, self.writes = left, os.fdopen, 0

    def fdopen(self, handle, mode):
        disk, file = self, self.open(handle, mode)

        class Part(io.BufferedIOBase):
            def write(self, data):
                disk.writes += 1
                if disk.writes == disk.left:
                    file.write(bytes(data)[: len(data) // 2])
                    raise OSError(errno.ENOSPC, "No space left on device")
                return file.write(data)

            def __getattr__(self, name):
                return getattr(file, name)

            def seek(self, *to):
                return file.seek(*to)

            def tell(self):
                return file.tell()

            def seekable(self):
                return True

            def writable(self):
                return True

            def flush(self):
                if not file.closed:
                    file.flush()

            def fileno(self):
                return file.fileno()

            def close(self):
                file.close()
                super().close()

        return Part()


def session(folder, estimate):
    """Write every kind of file that a session leaves; yield as each is written."""
    for path, write in (
        ("data.npz", estimate.measurements.save), ("estimate.npz", estimate.save),
        ("explored.npz", Exploration().save), ("report.html", estimate.report),
        *((f"shape{suffix}", estimate.export)
          for suffix in (".stl", ".obj", ".ply", ".glb", ".xml", ".urdf")),
        ("rig.json", simulated_rig("optoforce").save),
    ):  # fmt: skip
        yield folder / path, write


def raised(write, path):
    """Return the WriteError of a write, None if it succeeds."""
    try:
        write(path)
    except WriteError as error:
        return error
    return None


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_disk_that_is_full_at_any_write_of_a_session_loses_nothing_of_before(
    estimate, tmp_path, monkeypatch
):
    for path, write in session(tmp_path, estimate):
        write(path)
    before, tried = contents(tmp_path), 0
    for path, write in session(tmp_path, estimate):
        for k in (1, 2, 3, 5, 9, 20, 40, 80):
            disk = FullDisk(k)
            with monkeypatch.context() as patch:
                patch.setattr(whole_file.os, "fdopen", disk.fdopen)
                error = raised(write, path)
            if error is None:  # it takes fewer writes
                break
            tried += 1
            assert str(path) in str(error)
            assert "No space" in error.got
            assert contents(tmp_path) == before
        assert set(contents(tmp_path)) == set(before)  # no temporary file
        before = contents(tmp_path)
    assert tried >= 12
    assert Estimate.load(tmp_path / "estimate.npz").theta.shape == (3,)
    assert Rig.load(tmp_path / "rig.json") == simulated_rig("optoforce")


def test_a_link_stays_one_and_its_target_is_replaced(estimate, tmp_path):
    (tmp_path / "far").mkdir()
    target, link = tmp_path / "far" / "data.npz", tmp_path / "data.npz"
    target.write_bytes(b"before")
    link.symlink_to(target)
    estimate.measurements.save(link)
    assert link.is_symlink()
    assert Measurements.load(target).samples == estimate.measurements.samples


def test_pipes_and_devices_are_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", os.devnull):
        with pytest.raises(FileError, match="not a file"):
            Exploration().save(path)


def test_a_name_that_is_too_long_is_a_typed_error(tmp_path):
    with pytest.raises(WriteError, match="too long"):
        Exploration().save(tmp_path / ("x" * 300))


def test_a_small_file_that_unpacks_to_much_is_refused_before_it_is_unpacked(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(npz, "LARGEST_CONTENT", 2**24)
    monkeypatch.setattr(npz, "LARGEST_RESULT", 2**24)
    path, shape = tmp_path / "bomb.npz", (npz.LARGEST_CONTENT // 8 + 1,)
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("time.npy", "w", force_zip64=True) as member,
    ):
        header = {"descr": "<f8", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(member, header)
        for _ in range(npz.LARGEST_CONTENT // 2**20 + 1):
            member.write(bytes(2**20))
    assert path.stat().st_size < 2**20
    for load, error in (
        (Measurements.load, MeasurementError), (Scene.load, SceneError),
        (Estimate.load, FileError), (Exploration.load, FileError),
    ):  # fmt: skip
        with pytest.raises(error, match="too large"):
            load(path)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("position", lambda a: a[:-1]),
        ("position", lambda a: a[:, :2]),
        ("body_vertices", lambda a: a[:, :2]),
        ("body_vertices", lambda a: a * np.nan),
        ("body_vertices", lambda a: a * 0.0),
        ("body_vertices", lambda a: a * [1.0, 1.0, 0.0]),
        ("information/maps/side_lengths", lambda a: a[:2]),
        ("information/maps/position", lambda a: a[:, :-1]),
        ("quaternion", lambda a: 2 * a),
        ("quaternion", lambda a: a.astype(complex)),
        ("theta", lambda a: a[:, None]),
        ("information/matrix", lambda a: a[:-1]),
        ("information/path", lambda a: a[:-1]),
        ("information/modes/covariances", lambda a: a[0]),
        ("impulses/finger 0", lambda a: a[:-1]),
        ("hypotheses/0/x", lambda a: a[0]),
    ],
)
def test_an_estimate_with_an_array_of_another_shape_is_refused_at_load(
    estimate, tmp_path, name, change
):
    estimate.save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as file:
        arrays = dict(file)
    arrays[name] = change(arrays[name])
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(FileError, match=name.rpartition("/")[2]):
        Estimate.load(tmp_path / "bad.npz")


@pytest.mark.parametrize("load", [Measurements.load, Scene.load, Estimate.load])
def test_what_is_no_file_is_refused_without_waiting(load, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", "a\0b", "a\ud800"):
        with pytest.raises((MeasurementError, SceneError, FileError)):
            load(path)
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "none.npz")


def test_a_file_of_another_kind_is_named_as_such(estimate, tmp_path):
    estimate.save(tmp_path / "estimate.npz")
    with pytest.raises(MeasurementError, match="another kind") as caught:
        Measurements.load(tmp_path / "estimate.npz")
    assert "Estimate.load" in caught.value.next
    (tmp_path / "words.md").write_text("no archive")
    with pytest.raises(MeasurementError, match="zip") as caught:
        Measurements.load(tmp_path / "words.md")
    assert "pickle" not in str(caught.value)


def test_a_rig_from_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RigError, match="not a file"):
        Rig.load(tmp_path / "pipe")
