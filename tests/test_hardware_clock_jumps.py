"""The wall clock is set while fingers move: the control does not notice."""

import os
import threading

import can
import numpy as np
import pytest
from bench import ManualClock
from bench_jumps import FAR, LARGEST, PHASES, SMALLEST, Jumping, run_trial

from hardware.can_bus import waiting
from hardware.clock import HostClock, WallStamps
from hardware.errors import ClockError
from hardware.paths import row_of
from hardware.simulated_robot import NOON

# The full run is TACTILENLP_JUMPS=200.
TRIALS = int(os.environ.get("TACTILENLP_JUMPS", "7"))
SPEED = 0.5  # [m/s] of a tip: twice what the paths ask for


@pytest.fixture(scope="module")
def undisturbed():
    """What is measured while nobody sets the clock."""
    with pytest.MonkeyPatch.context() as patch, Jumping(patch) as setup:
        data = setup.world.execute(FAR)
        setup.world.stop()
    return data


def check(undisturbed, setup, data, phase):
    """The action was as if nothing had happened."""
    assert not isinstance(data, Exception), repr(data)
    times = np.diff([now for now, _ in setup.trace])
    tips = np.array([tips for _, tips in setup.trace])
    speed = np.linalg.norm(np.diff(tips, axis=0), axis=2).max(axis=1) / times
    assert speed.max() < SPEED
    if phase == "kept up":
        return  # another action was measured
    assert data.samples == undisturbed.samples
    assert data.valid.all()
    off = np.abs(data.finger_position - undisturbed.finger_position).max()
    # a frame that came before the step and is read after it may be taken for one that
    # came after it, if both fit: 4 ms at 0.15 m/s
    assert off < 6e-4
    assert np.array_equal(data.contact, undisturbed.contact)


@pytest.mark.parametrize(
    ("phase", "step"),
    list(zip(PHASES, [-0.05, -1, 0.2, -0.2, -0.05, 1, -3600], strict=True)),
)
def test_a_step_of_the_wall_clock_does_not_steer(undisturbed, monkeypatch, phase, step):
    setup, data = run_trial(monkeypatch, phase, 0.05, step, FAR)
    check(undisturbed, setup, data, phase)


@pytest.mark.slow
@pytest.mark.parametrize("trial", range(TRIALS))
def test_steps_of_any_size_at_any_moment(undisturbed, monkeypatch, trial):
    rng = np.random.default_rng([trial, 22])
    size = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST)))
    step = float(rng.choice([-1.0, 1.0]) * size)
    phase = PHASES[trial % len(PHASES)]
    setup, data = run_trial(monkeypatch, phase, rng.uniform(0, 0.1), step, FAR)
    check(undisturbed, setup, data, phase)


def test_the_clock_of_the_host_does_not_follow_the_wall_clock(monkeypatch):
    clock = HostClock()
    before = clock.now()
    monkeypatch.setattr("hardware.clock.time.time", lambda: 0.0)
    assert 0 <= clock.now() - before < 60
    assert clock.wall() == 0.0


class Two:
    """A clock of which both hands are set by the test."""

    def __init__(self):
        self.time, self.day = 100.0, 1.7e9

    def now(self):
        return self.time

    def wall(self):
        return self.day

    def pass_by(self, duration):
        self.time += duration
        self.day += duration


@pytest.mark.parametrize("step", [-3600.0, -0.05, 0.05, 3600.0])
def test_stamps_of_before_and_after_a_step_are_told_apart(step):
    clock = Two()
    stamps = WallStamps(clock)
    told = []
    for k in range(8):
        clock.pass_by(0.001)
        if k == 4:
            clock.day += step
        told.append((clock.time, clock.day))
    stamps.look()
    assert [stamps(day) for _, day in told] == pytest.approx([t for t, _ in told])
    clock.pass_by(0.001)
    stamps.look()
    assert stamps(clock.day) == pytest.approx(clock.time)


def test_a_bus_is_read_without_waiting_though_the_wall_clock_is_set_back(monkeypatch):
    days = iter(range(10**6, 0, -3600))
    monkeypatch.setattr(can.bus, "time", lambda: next(days))
    with can.Bus(interface="virtual", channel="set back") as bus:
        done = threading.Event()

        def read():
            waiting(bus, "set back", pytest.fail, WallStamps(HostClock()))
            done.set()

        threading.Thread(target=read, daemon=True).start()
        assert done.wait(10.0)


def test_a_path_is_not_followed_beyond_its_ends():
    path = np.array([[0.0, 0, 0], [1, 1, 1], [4, 4, 4]])
    assert row_of(path, -100.0).tolist() == [0, 0, 0]
    assert row_of(path, 100.0).tolist() == [4, 4, 4]
    assert row_of(path, 1.5).tolist() == [2.5, 2.5, 2.5]


def test_a_clock_that_runs_backward_ends_the_action(monkeypatch):
    with Jumping(monkeypatch) as setup:
        robot = setup.robot
        setup.world.clock = setup.bench.clock = robot
        now = robot.now

        def set_back():
            robot.now = lambda: now() - 0.05

        setup.after(0.45, set_back)  # the motors are enabled by then
        with pytest.raises(ClockError, match="ran backward"):
            setup.world.execute(FAR)
        robot.now = now
        assert setup.left_in_peace()


@pytest.mark.parametrize("stamp", [0.0, 100.2, NOON - 11.0, NOON + 31.0, 1e18])
def test_a_stamp_of_another_clock_is_the_time_of_its_reading(stamp):
    """An adapter may count seconds from when it was plugged in."""
    clock = ManualClock(NOON)
    stamps = WallStamps(clock)
    clock.time = NOON + 20.0
    stamps.look()
    assert stamps(stamp) == NOON + 20.0
    assert stamps(NOON + 19.5) == NOON + 19.5
    assert stamps(NOON + 0.5) == NOON + 0.5  # nobody has read for a while


def test_frames_that_wait_for_the_next_reading_keep_their_stamps():
    clock = ManualClock(NOON)
    stamps = WallStamps(clock)
    for k, rest in enumerate((True, True, False)):
        clock.time = NOON + 60.0 + k
        stamps.look(all_read=not rest)
        assert stamps(NOON + 20.0 + k) == NOON + 20.0 + k
    clock.time = NOON + 90.0
    stamps.look()
    assert stamps(NOON + 20.0) == NOON + 90.0
