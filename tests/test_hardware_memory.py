"""Memory does not grow with time: not while recording, not between actions."""

import gc
import os

import numpy as np
import pytest
from bench import ManualClock
from bench_robot import FREE, Patient, Setup, numbers

from hardware.bench import Bench
from hardware.frames import Camera
from hardware.motor_can import Pair, Quantity, Status, encode
from hardware.reader import Reader
from hardware.serial_tactile import ForceFrame, encode_force, to_can
from hardware.simulated_robot import simulated_rig
from hardware.tape import Tape

# The full run is TACTILENLP_SECONDS=600: simulated seconds of all frames at full rate.
SECONDS = float(os.environ.get("TACTILENLP_SECONDS", "6"))
SLACK = 4e6  # [bytes] by which memory may grow from one half to the other
RATE = 1000  # [Hz] of each quantity of each board
SIZE = 24, 32  # [px] of a picture


def used():
    """Return the memory of this process [bytes]."""
    gc.collect()
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class Cameras:
    """A camera that is fed by hand: its pictures differ by noise."""

    def __init__(self, sink):
        self.camera = Camera(lambda: None, sink=sink, clock=ManualClock())
        self._rng = np.random.default_rng(0)

    def send(self):
        self.camera.on_picture(self._rng.integers(0, 255, SIZE, np.uint8))


class Flood:
    """Everything that four boards, two force sensors and two cameras send."""

    def __init__(self, bench, cameras, clock):
        self.bench, self.cameras, self.clock = bench, cameras, clock
        self.frames, self._tick = 0, 0
        ok = Status(True, (True, True), (True, True), 0)
        self._status = [encode(ok)]
        self._pairs = [encode(Pair(quantity, (0.25, -0.5))) for quantity in Quantity]

    def run(self, seconds):
        """Send so many seconds [s] of frames, and take them in at 250 Hz."""
        for _ in range(round(seconds * RATE)):
            self.clock.time += 1 / RATE
            self._send(self._tick)
            if self._tick % 4 == 3:
                for finger in self.bench.fingers:
                    finger.skin.poll()
            self._tick += 1

    def _send(self, tick):
        now = self.clock.time
        messages = self._pairs + (self._status if tick % RATE == 0 else [])
        for finger in self.bench.fingers:
            for board in finger.boards:
                for message in messages:
                    message.timestamp = now
                    board.on_message_received(message)
                self.frames += len(messages)
            for message in to_can(packet(tick), 0x100, now):
                finger.skin.reader.on_message_received(message)
        if tick % 33 == 0:
            for camera in self.cameras:
                camera.send()


def packet(tick):
    return encode_force(ForceFrame(tick % 65536, 0, (1, 2, 3)))


@pytest.mark.slow
def test_recording_does_not_grow(tmp_path):
    pytest.importorskip("cv2", reason="needs tactilenlp[optical]")
    rig, clock = simulated_rig("optoforce_can", f"flood {next(numbers)}"), ManualClock()
    with (
        Tape(tmp_path / "tape", rig) as tape,
        Bench(rig, tape=tape, clock=clock) as bench,
    ):
        cameras = [Cameras(tape.pictures(f"camera {k}")) for k in range(2)]
        flood = Flood(bench, cameras, clock)
        flood.run(SECONDS / 2)
        half = used()
        flood.run(SECONDS / 2)
        assert used() - half < SLACK
    assert flood.frames >= SECONDS * RATE * 16
    print(f"{flood.frames} frames, {used() - half} bytes more in the second half")


@pytest.mark.slow
def test_listening_without_a_recording_does_not_grow():
    rig, clock = simulated_rig("optoforce_can", f"flood {next(numbers)}"), ManualClock()
    with Bench(rig, clock=clock) as bench:
        flood = Flood(bench, [], clock)
        flood.run(SECONDS / 2)
        half = used()
        flood.run(SECONDS / 2)
        assert used() - half < SLACK
        for board in bench.boards:
            assert {len(board.series(quantity)[0]) for quantity in Quantity} == {1}


@pytest.mark.slow
def test_what_is_kept_between_actions_is_the_newest_alone():
    with Setup(make=Patient) as setup:
        setup.world.execute(FREE)
        begin = setup.robot.now()
        while setup.robot.now() < begin + 0.5:
            for one in setup.bench.fingers:
                assert len(one.skin.touches) == 1
                for board in one.boards:
                    assert len(board.series(Quantity.POSITION)[0]) <= 1
        setup.world.stop()


class Patter(Reader):
    """A reader that is fed by hand."""

    def _run(self):
        return None

    def feed(self, now, came):
        self._keep(now, came)


def test_samples_that_are_not_taken_are_dropped_oldest_first_and_counted():
    reader = Patter("patter", ManualClock(), queue=10)
    for k in range(25):
        reader.feed(float(k), [k])
    assert [frame for _, frame in reader.take()] == list(range(15, 25))
    assert reader.dropped == 15
    assert reader.take() == []
    reader.feed(0.0, list(range(30)))
    assert [frame for _, frame in reader.take()] == list(range(20, 30))
    assert reader.dropped == 35


def test_pictures_that_are_not_taken_are_bounded():
    one = Cameras(sink=None)
    for _ in range(200):
        one.send()
    assert len(one.camera.take()) == 64
    assert one.camera.dropped == 136
