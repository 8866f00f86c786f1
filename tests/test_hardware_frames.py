"""Pictures: live from a camera, or back from files."""

import time

import numpy as np
import pytest
from bench import refused

pytest.importorskip("cv2", reason='needs the extra: pip install "tactilenlp[optical]"')
import cv2
from bench import complaint, wait_for

from hardware.errors import (
    BusError,
    RecordingError,
    StaleStreamError,
)
from hardware.frames import Camera, pictures
from hardware.optical import Lens
from hardware.simulated_skin import SimulatedSkin

SHAPE = (240, 320)  # [px]
LENS = Lens((160.0, 120.0), 118.0)


@pytest.fixture(scope="module")
def skin():
    return SimulatedSkin(LENS, SHAPE)


def test_a_camera_that_freezes_is_missed_within_200_ms():
    rng, frozen = np.random.default_rng(0), []

    def read():
        time.sleep(0.01)
        if not frozen:
            read.picture = rng.integers(0, 255, (20, 20)).astype(np.uint8)
        return read.picture  # the driver gives the same buffer again and again

    with Camera(read, name="finger 1") as camera:
        wait_for(lambda: camera.good > 5)
        camera.check(stale=10.0)
        frozen.append(True)
        wait_for(lambda: camera.frozen > 0)
        error, passed = refused(camera.check, since=time.monotonic())
        assert isinstance(error, StaleStreamError)
        assert "finger 1: no touch is sensed" in str(error)
        assert passed < 0.2
        stamps = [stamp for stamp, _ in camera.take()]
    assert len(stamps) == camera.good
    assert stamps == sorted(stamps)


def test_a_camera_that_is_not_there_is_said_with_the_reason(capfd):
    with Camera("/dev/nowhere.mkv") as camera:
        wait_for(lambda: "cannot be opened" in complaint(camera))
        with pytest.raises(StaleStreamError, match="cannot be opened"):
            camera.check()


def test_a_sink_that_fails_ends_in_its_own_error(skin):
    def full(frame, now):
        raise RecordingError("the disk is full")

    with Camera(skin.picture, sink=full) as camera:
        wait_for(lambda: "the disk is full" in complaint(camera))
        with pytest.raises(RecordingError, match="the disk is full"):
            camera.check()


def test_a_camera_that_does_not_obey_the_size_is_refused(skin, monkeypatch):
    class Stubborn:
        """A camera that takes any setting and changes none."""

        def __init__(self, source):
            self.isOpened, self.set = (lambda: True), (lambda key, value: False)
            self.read, self.release = (lambda: (True, skin.picture())), (lambda: None)

    monkeypatch.setattr(cv2, "VideoCapture", Stubborn)
    with Camera(0, size=(160, 120), name="finger 0") as camera:
        wait_for(lambda: complaint(camera))
        with pytest.raises(BusError, match=r"finger 0.*\(160, 120\).*\(320, 240\)"):
            camera.check(10.0)
        assert camera.take() == []
    with Camera(0, size=SHAPE[::-1]) as camera:
        wait_for(lambda: camera.good > 2)
        camera.check(10.0)


def test_an_error_of_a_driver_is_told_by_check():
    def read():
        raise cv2.error("one bad transfer")

    with Camera(read, name="finger 1") as camera:
        wait_for(lambda: not camera._thread.is_alive())
        with pytest.raises(BusError, match=r"finger 1: cannot be read.*bad transfer"):
            camera.check(10.0)


def test_pictures_are_read_in_their_natural_order(tmp_path):
    for k in (0, 1, 2, 10, 11, 100):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((4, 4), k, np.uint8))
    assert [p[0, 0] for p in pictures(tmp_path)] == [0, 1, 2, 10, 11, 100]
    (tmp_path / "5.png").write_bytes(b"no picture")
    with pytest.raises(RecordingError, match=r"5\.png"):
        list(pictures(tmp_path))


def test_a_folder_without_pictures_is_refused(tmp_path, capfd):
    for nothing in (tmp_path, tmp_path / "film.mkv"):
        with pytest.raises(RecordingError, match="no pictures"):
            list(pictures(nothing))
