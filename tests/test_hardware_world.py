"""The robot's world: what it measures, what it refuses, how it always ends."""

import itertools
from types import SimpleNamespace

import can
import numpy as np
import pytest
from bench import Terminal, terminal

from hardware.bench import Bench
from hardware.clock import HostClock
from hardware.errors import (
    BoardError,
    BusError,
    CompletenessError,
    HardwareError,
    LimitError,
    ReachError,
    StaleStreamError,
)
from hardware.impedance import Gains, Limits, holding
from hardware.kinematics import finger
from hardware.motor_can import Fault, Reference
from hardware.recording import Recording
from hardware.simulated_robot import NOON, SimulatedRobot, simulated_rig
from hardware.tape import Tape
from hardware.world import RobotWorld

__all__ = ["terminal"]  # a fixture
BEYOND = tuple(finger("edu_dair", 180).forward([1.1, 0.9, -1.7]))  # joint 0 ends at 1
BOX = (0.058, 0.049, 0.053)  # [m], the paper's
numbers = itertools.count()


def trajectory(*lines, duration=1.0, steps=31):
    """Straight lines of all fingers, from and to (3,) [m]; one point: parked."""
    s = np.linspace(0, 1, steps)[:, None]
    ends = [line if len(line) == 2 else line * 2 for line in lines]
    paths = [np.array(a) + s * np.subtract(b, a) for a, b in ends]
    return SimpleNamespace(
        time=duration * s[:, 0], finger_position=np.stack(paths, axis=1)
    )


AWAY = [(-0.1, 0.01, 0.05)]
PUSH = trajectory([(0.07, 0.0, 0.04), (-0.02, 0.0, 0.03)], AWAY, duration=0.75)
SQUEEZE = trajectory(
    [(0.09, 0.0, 0.05), (0.02, 0.0, 0.03)],
    [(-0.09, 0.0, 0.05), (-0.02, 0.0, 0.03)],
    duration=0.6,
)
FREE = trajectory(
    [(0.1, 0.0, 0.06), (0.08, 0.0, 0.06)],
    [(-0.1, 0.0, 0.06), (-0.08, 0.0, 0.06)],
    duration=0.2,
)


def poised(first=FREE):
    """Joint angles at the start of a trajectory: no time is lost on the way there."""
    rig = simulated_rig("optoforce_can")
    tips = zip(rig.fingers, first.finger_position[0], strict=True)
    return [one.geometry.inverse(p) for one, p in tips]


class Setup:
    """A simulated robot, its bench and its world."""

    def __init__(self, kind="optoforce_can", tape=None, make=SimulatedRobot, **options):
        if kind == "densetact":
            pytest.importorskip("cv2", reason="needs tactilenlp[optical]")
        self.rig = options.pop("rig", None)
        self.rig = self.rig or simulated_rig(kind, f"world {next(numbers)}")
        options.setdefault("angles", poised())
        self.robot = make(self.rig, BOX, **options)
        self.trace = []
        self.robot.after = self.look
        self.tape = Tape(tape, self.rig) if tape else None
        reader = self.robot.reader
        self.bench = Bench(
            self.rig,
            tape=self.tape,
            clock=self.robot,
            reader=reader,
            listen_only=False,
        )
        self.world = RobotWorld(self.bench)

    def look(self, now):
        self.trace.append((now, self.robot.tips))

    def __enter__(self):
        self.robot.__enter__()
        if self.tape:
            self.tape.__enter__()
        self.bench.__enter__()
        return self

    def __exit__(self, *exception):
        self.bench.__exit__(*exception)
        if self.tape:
            self.tape.__exit__(*exception)
        self.robot.__exit__(*exception)

    def after(self, delay, action):
        """Do something once, so many seconds from now on the robot's clock."""
        due, done = self.robot.now() + delay, []

        def look(now):
            self.look(now)
            if now >= due and not done:
                done.append(now)
                action()

        self.robot.after = look
        return done

    def left_in_peace(self):
        """All motors got zero current, and no current flows."""
        for one in self.robot.fingers:
            for board in one.boards:
                board.listen(self.robot.now())
                assert not board.current.any()
                said = [c for c in board.received if isinstance(c, Reference)]
                if said and said[-1].values != (0.0, 0.0):
                    return False
        return True


@pytest.fixture(scope="module")
def session():
    """Two actions with rendered pictures; the truth along the way."""
    with Setup("densetact", angles=poised(PUSH)) as setup:
        data = [setup.world.execute(action) for action in (PUSH, SQUEEZE)]
        now = [setup.robot.now(), setup.robot.pose]
    return setup, data, now


# What is measured


def test_an_action_comes_back_at_30_hz_and_the_next_one_goes_on(session):
    setup, (first, second), _ = session
    assert 22 <= first.samples <= 23
    assert first.dt == pytest.approx(1 / 30)
    assert (first.action[0], second.action[0]) == (0, 1)
    assert second.time[0] > first.time[-1]
    assert setup.world.measurements == first.append(second)


def test_the_measured_tips_are_where_the_simulated_ones_were(session):
    setup, data, _ = session
    times = np.array([now for now, _ in setup.trace])
    truth = np.array([tips for _, tips in setup.trace])
    origin = setup.world.origin
    for one in data:
        true = [
            np.interp(origin + one.time, times, truth[:, k, i])
            for k in range(2)
            for i in range(3)
        ]
        off = np.array(true).T.reshape(-1, 2, 3) - one.finger_position
        assert np.abs(off[one.valid]).max() < 2e-5  # straight lines between 2 ms


def test_a_parked_finger_stays_and_is_not_valid(session):
    _, (first, _), _ = session
    assert not first.valid[:, 1].any()
    assert first.valid[:, 0].all()
    assert np.ptp(first.finger_position[:, 1], axis=0).max() < 1e-3


def test_pictures_of_a_push_give_contact_and_the_faces_normal(session):
    _, (first, second), _ = session
    assert 3 < first.contact[:, 0].sum() < 20
    # once felt, it is felt until the end
    begin = np.flatnonzero(first.contact[:, 0])[0]
    assert first.contact[begin:, 0].all()
    for data, k, face in ((first, 0, 1.0), (second, 0, 1.0), (second, 1, -1.0)):
        touched = data.normal[data.contact[:, k], k]
        assert len(touched) >= 3
        assert np.degrees(np.arccos(face * touched[:, 0])).max() < 8.0
    # the tip was its radius and half the box away when the first touch was felt
    gap = first.finger_position[begin, 0, 0] - 0.01575 - BOX[0] / 2
    assert abs(gap) < 3e-3


def test_the_object_moved_as_the_papers_did(session):
    _, _, (_, pose) = session
    assert 2e-3 < np.linalg.norm(pose[:2]) < 0.02


def test_a_world_tells_the_radii_of_its_fingertips():
    assert Setup().world.finger_radius.tolist() == [0.01575] * 2


def test_a_zero_error_of_one_degree_moves_the_measured_tip_by_millimetres():
    error = np.zeros((2, 3))
    error[0, 0] = np.deg2rad(1.0)
    with Setup(zero_error=error) as setup:
        data = setup.world.execute(FREE)
        tips = setup.robot.tips
    last = data.finger_position[-1]
    J = setup.rig.fingers[0].geometry
    lever = np.linalg.norm(J.jacobian(J.inverse(last[0]))[:, 0])
    ends = [p for now, p in setup.trace if now <= setup.world.origin + data.time[-1]]
    off = np.linalg.norm(ends[-1] - last, axis=1)
    assert off[0] == pytest.approx(np.deg2rad(1.0) * lever, rel=0.05)
    assert 2e-3 < off[0] < 5e-3
    assert off[1] < 2e-4  # 2 ms of motion
    assert tips.shape == (2, 3)


def test_a_run_repeats_to_the_last_digit():
    runs = []
    for _ in range(2):
        with Setup() as setup:
            runs.append(setup.world.execute(FREE))
    assert runs[0] == runs[1]


# What is refused, before anything moves


@pytest.mark.parametrize(
    ("error", "word", "line"),
    [
        (LimitError, "too fast", [(0.1, 0, 0.06), (0.0, 0.05, 0.1)]),
        (LimitError, "ground", [(0.1, 0, 0.06), (0.08, 0, 0.01)]),
        (LimitError, "leave its limits", [(0.2, 0.0, 0.1), BEYOND]),
        (ReachError, "too far", [(0.1, 0.0, 0.06), (0.5, 0.0, 0.06)]),
    ],
)
def test_what_the_robot_cannot_do_is_refused_at_rest(error, word, line):
    with Setup() as setup:
        wanted = trajectory(line, AWAY, duration=0.2 if word == "too fast" else 3.0)
        before = setup.robot.tips
        with pytest.raises(error, match=word):
            setup.world.execute(wanted)
        assert np.linalg.norm(setup.robot.tips - before, axis=1).max() < 2e-3
        assert setup.left_in_peace()


@pytest.mark.parametrize(
    "wrong",
    [
        SimpleNamespace(time=[0, 1], finger_position=np.zeros((2, 3, 3))),
        SimpleNamespace(time=[1, 0], finger_position=np.zeros((2, 2, 3))),
        SimpleNamespace(time=[0, 1], finger_position=np.full((2, 2, 3), np.nan)),
        SimpleNamespace(),
    ],
)
def test_what_is_no_trajectory_is_refused(wrong):
    with Setup() as setup, pytest.raises(LimitError, match="no trajectory"):
        setup.world.execute(wrong)


# How it ends


def stop_a_board(setup):
    setup.robot.fingers[1].boards[0].silent = True


def stop_a_sensor(setup):
    setup.robot.fingers[0].skin.silent = True


def fail_a_board(setup):
    setup.robot.fingers[0].boards[1].fail(Fault.ENCODER)


def close_a_bus(setup):
    setup.bench.fingers[0].boards[0]._bus.shutdown()


def report_bus_off(setup):
    frame = can.Message(arbitration_id=0x40, data=bytes(8), is_error_frame=True)
    setup.robot.fingers[1].boards[1]._bus.send(frame)


def press_ctrl_c(setup):
    raise KeyboardInterrupt


def hang(setup):
    setup.world._last_tick -= 1.0  # as if a second had passed since


@pytest.mark.parametrize(
    ("harm", "error", "word"),
    [
        (stop_a_board, StaleStreamError, "finger 1, board 0: no position"),
        (stop_a_sensor, StaleStreamError, "finger 0, tactile: no touch"),
        (fail_a_board, BoardError, "finger 0, board 1.*ENCODER"),
        (close_a_bus, BusError, "finger 0, board 0: cannot"),
        (report_bus_off, BusError, "the bus is off"),
        (press_ctrl_c, KeyboardInterrupt, "^$"),
        (hang, HardwareError, "held up"),
    ],
)
def test_whatever_goes_wrong_ends_within_200_ms_without_current(
    harm, error, word, tmp_path
):
    with Setup(tape=tmp_path / "tape") as setup:
        setup.world._start()
        done = setup.after(0.2, lambda: harm(setup))
        with pytest.raises(error, match=word):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.2
        if harm is not close_a_bus:  # that board hears nothing, its time-out must do
            assert setup.left_in_peace()
    # all data so far are on disk, and say that it ended early
    recording = Recording(tmp_path / "tape")
    for streams in recording.fingers():
        for stream in (*streams.boards, streams.touch):
            assert stream.time[-1] > done[0] - 0.02
            assert stream.time[0] < done[0] - 0.2


def test_a_board_that_hears_nothing_any_more_switches_itself_off():
    with Setup() as setup:
        setup.world._start()
        setup.after(0.2, lambda: close_a_bus(setup))
        with pytest.raises(BusError):
            setup.world.execute(FREE)
        setup.robot.sleep(0.12)
        assert not setup.robot.fingers[0].boards[0].current.any()


def test_a_camera_that_freezes_ends_it_within_200_ms(tmp_path):
    with Setup("densetact", tape=tmp_path / "tape") as setup:
        setup.world._start()

        def freeze():
            setup.robot.fingers[1].skin.frozen = True

        done = setup.after(0.2, freeze)
        with pytest.raises(StaleStreamError, match="finger 1, tactile: no touch"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.2
        assert setup.left_in_peace()
    pictures = list(Recording(tmp_path / "tape").pictures("finger_1_tactile"))
    assert len(pictures) > 12
    assert pictures[-1][0] == pytest.approx(done[0], abs=0.035)


def test_a_terminal_that_is_pulled_out_ends_it_within_200_ms(tmp_path, terminal):
    from dataclasses import replace

    rig = simulated_rig("optoforce", f"world {next(numbers)}")
    second = Terminal()
    ends = terminal, second
    wired = [
        replace(one, tactile=replace(one.tactile, source=end.name))
        for one, end in zip(rig.fingers, ends, strict=True)
    ]
    rig = replace(rig, fingers=tuple(wired))
    with Setup(rig=rig, tape=tmp_path / "tape") as setup:
        readers = [one.skin.reader for one in setup.bench.fingers]
        for reader in readers:
            wait(lambda reader=reader: reader._opened)
        for one, end, reader in zip(setup.robot.fingers, ends, readers, strict=True):

            def write(packet, end=end, reader=reader):
                if end.master is not None:  # simulated time waits for the real wire
                    count = reader.framer.good + 1
                    end.write(packet)
                    wait(lambda: reader.framer.good >= count)

            one.skin.write = write
        setup.world._start()
        done = setup.after(0.2, second.unplug)
        with pytest.raises(StaleStreamError, match="finger 1, tactile"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.2
        assert setup.left_in_peace()
    chunks = list(Recording(tmp_path / "tape").chunks("finger_1_tactile"))
    assert chunks[-1][0] > done[0] - 0.03


def wait(condition, seconds=60.0):
    import time

    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(1e-4)


def test_a_joint_that_runs_away_is_stopped():
    with Setup() as setup:
        setup.world.limits = Limits(top_speed=0.05)
        with pytest.raises(LimitError, match="runs away"):
            setup.world.execute(FREE)
        assert setup.left_in_peace()


def test_an_action_that_misses_too_much_is_refused():
    with Setup() as setup:
        setup.world.complete = 1.01
        with pytest.raises(CompletenessError, match="valid"):
            setup.world.execute(FREE)
        assert setup.left_in_peace()


# Between actions


class Patient(SimulatedRobot, HostClock):
    """A robot whose clock counts as real: its fingers are kept up by a thread."""


def test_fingers_are_kept_up_between_actions():
    with Setup(make=Patient) as setup:
        setup.world.execute(FREE)
        there, then = setup.robot.tips, setup.robot.now()
        wait(lambda: setup.robot.now() > then + 0.3)  # longer than the time-out
        assert np.abs(setup.robot.tips - there).max() < 2e-3
        stop_a_board(setup)
        wait(lambda: setup.world._failed is not None)
        assert setup.left_in_peace()
        with pytest.raises(StaleStreamError, match="finger 1, board 0"):
            setup.world.execute(FREE)
        setup.world.stop()


def test_stopping_ends_the_thread_too():
    with Setup(make=Patient) as setup:
        setup.world.execute(FREE)
        setup.world.stop()
        assert setup.left_in_peace()


# Torques


def test_the_holding_torque_is_that_of_mujoco_on_the_authors_urdf():
    import mujoco
    from test_hardware_kinematics import configurations, urdf_model

    model = urdf_model()
    model.opt.gravity[:] = 0, 0, -9.81
    data = mujoco.MjData(model)
    names = ("base_to_upper", "upper_to_middle", "middle_to_lower")
    for angles in configurations(50):
        joints = [data.joint(f"finger_{name}_joint_0") for name in names]
        for joint, angle in zip(joints, angles, strict=True):
            joint.qpos = angle
        mujoco.mj_forward(model, data)
        weight = [float(joint.qfrc_bias[0]) for joint in joints]
        assert holding(angles) == pytest.approx(weight, abs=2e-3)


def test_torques_pull_towards_the_target_within_the_bound():
    gains = Gains(weight=0.0)
    rest = np.zeros(3)
    pull = gains.torques(np.array([0.01, -0.01, 0.0]), rest, rest, rest)
    assert pull == pytest.approx([0.07, -0.07, 0.0])
    hard = gains.torques(np.array([1.0, -1.0, 1.0]), rest, rest, rest)
    assert hard.tolist() == [0.36, -0.36, 0.36]
    for wrong in ({"stiffness": (1.0, 1.0)}, {"torque": -1.0}, {"weight": np.nan}):
        with pytest.raises(LimitError, match="no gains"):
            Gains(**wrong)


def test_the_simulation_begins_at_noon():
    with Setup() as setup:
        assert setup.robot.now() == NOON
        assert finger("edu_dair").tip_radius == 0.01575
