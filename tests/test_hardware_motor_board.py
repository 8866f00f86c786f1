"""A motor board on a bus: what is heard, how it starts, how it always ends."""

import itertools
import logging
import time

import can
import numpy as np
import pytest
from bench import ManualClock

from hardware.errors import BoardError, BusError, LimitError, RigError, StaleStreamError
from hardware.motor_board import MotorBoard
from hardware.motor_can import (
    Command,
    EncoderIndex,
    Fault,
    Order,
    Pair,
    Quantity,
    Reference,
    Status,
    encode,
)
from hardware.motor_joints import JointMap, start_motors
from hardware.simulated_board import SimulatedBoard

channels = itertools.count()
POSITION = {Quantity.POSITION: np.array([1.25, -2.5])}


class Wired:
    """A board and its simulated other end on one virtual bus, on one manual clock."""

    def __init__(self, **options):
        channel = f"board {next(channels)}"
        config = {"interface": "virtual", "channel": channel}
        config["preserve_timestamps"] = True
        self.clock = ManualClock(tick=self.tick)
        self.firmware = SimulatedBoard(config)
        self.board = MotorBoard(config, name="board 0", clock=self.clock, **options)

    def tick(self, now):
        self.firmware.listen(now)
        self.firmware.talk(POSITION, now)

    def __enter__(self):
        self.firmware.__enter__()
        self.board.__enter__()
        return self

    def __exit__(self, *exception):
        self.board.__exit__(*exception)
        self.firmware.listen(self.clock.now())
        self.firmware.__exit__(*exception)


def driven():
    return Wired(listen_only=False)


def status(fault=Fault.NONE):
    return encode(Status(True, (True, True), (True, True), fault), time.time())


# Listening


def test_every_frame_is_counted_and_kept_with_its_stamp():
    with Wired() as wired:
        wired.firmware._sending = {Quantity.POSITION}
        wired.clock.sleep(0.5)
        assert wired.board.poll() == 501  # and a status
        stamps, values = wired.board.series(Quantity.POSITION)
        assert len(stamps) == 500
        assert np.diff(stamps) == pytest.approx(1e-3, abs=1e-6)
        assert np.array_equal(values, np.tile([1.25, -2.5], (500, 1)))
        assert wired.board.newest(Quantity.POSITION).tolist() == [1.25, -2.5]
        wired.board.check()
        wired.board.forget()
        assert len(wired.board.series(Quantity.POSITION)[0]) == 1


def test_a_listener_sends_nothing_whatever_happens():
    with Wired() as wired:
        wired.board.stop()
        for attempt in (wired.board.start, lambda: wired.board.command(0, 0)):
            with pytest.raises(BoardError, match="listen_only=False"):
                attempt()
    assert wired.firmware.received == []


def test_silence_is_found_within_the_limit():
    with Wired() as wired:
        wired.firmware._sending = {Quantity.POSITION}
        wired.clock.sleep(0.2)
        wired.board.poll()
        wired.board.check()
        wired.firmware.silent = True
        wired.clock.sleep(0.101)
        wired.board.poll()
        with pytest.raises(StaleStreamError, match=r"board 0: no position.*0\.101 s"):
            wired.board.check()


def test_a_board_that_never_spoke_is_silent_too():
    with Wired() as wired:
        with pytest.raises(StaleStreamError, match="nothing so far"):
            wired.board.newest(Quantity.VELOCITY)
        wired.clock.sleep(0.2)
        with pytest.raises(StaleStreamError, match="no position"):
            wired.board.check()


def test_error_frames_are_raised_once_and_change_no_measurement():
    with Wired() as wired:
        off = can.Message(arbitration_id=0x40, data=bytes(8), is_error_frame=True)
        wired.board.on_message_received(off)
        assert wired.board.errors == 1
        assert len(wired.board.series(Quantity.VELOCITY)[0]) == 0
        with pytest.raises(BusError, match="the bus is off"):
            wired.board.check()
        wired.board.check()


def test_broken_and_foreign_frames_are_counted_and_nothing_else():
    with Wired() as wired:
        for identifier, size in ((0x30, 3), (0x60, 8), (0x100, 8), (0x100, 8)):
            data = bytes(size)
            wired.board.on_message_received(
                can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            )
        assert (wired.board.broken, wired.board.foreign) == (2, 2)
        wired.board.check()


def test_the_encoder_index_is_kept():
    with Wired() as wired:
        index = EncoderIndex(0.5, 1)
        wired.board.on_message_received(encode(index, 12.0))
        assert wired.board.index == [(12.0, index)]


def test_a_notifier_outlives_a_listener_that_raises():
    def explode(message):
        raise RuntimeError("a broken sink")

    config = {"interface": "virtual", "channel": f"board {next(channels)}"}
    with SimulatedBoard(config) as firmware, MotorBoard(config, sink=explode) as board:
        notifier = can.Notifier(board._bus, [board], timeout=0.01)
        for k in range(5):
            firmware._bus.send(encode(Pair(Quantity.POSITION, (k, 0.0))))
        end = time.time() + 5
        while board.broken < 5 and time.time() < end:
            time.sleep(0.001)
        assert all(thread.is_alive() for thread in notifier._readers)
        notifier.stop()
    assert board.broken == 5


def test_four_boards_are_heard_on_four_channels_by_one_notifier():
    configs = [
        {"interface": "virtual", "channel": f"board {next(channels)}"} for _ in range(4)
    ]
    boards = [MotorBoard(config) for config in configs]
    ends = [SimulatedBoard(config) for config in configs]
    for each in (*boards, *ends):
        each.__enter__()
    for k, end in enumerate(ends):
        for _ in range(25 + k):
            end._bus.send(encode(Pair(Quantity.POSITION, (k, -k))))
    for k, board in enumerate(boards):
        assert board.poll() == 25 + k
        assert board.newest(Quantity.POSITION).tolist() == [k, -k]
    for each in (*boards, *ends):
        each.__exit__(None, None, None)


def test_a_bus_that_cannot_be_opened_says_what_to_look_at():
    for config in (
        {"interface": "socketcan", "channel": "can97"},
        {"interface": "slcan", "channel": "/dev/nowhere", "sleep_after_open": 0},
        {"interface": "no such thing", "channel": "0"},
    ):
        with pytest.raises(BusError, match="finger 0: cannot be opened"):
            MotorBoard(config, name="finger 0").__enter__()


def test_a_board_that_is_not_open_says_so():
    board = MotorBoard({"interface": "virtual"}, listen_only=False)
    with pytest.raises(BusError, match="with"):
        board.poll()
    board.stop()


# Driving


def test_the_start_sequence_is_the_documented_one():
    with driven() as wired:
        wired.board.start()
        wired.clock.sleep(0.002)
        assert wired.firmware.received == [
            Reference((0.0, 0.0)),
            Order(Command.RECEIVE_TIMEOUT, 0),
            Order(Command.ENABLE_SYSTEM, 1),
            Order(Command.SEND_ALL, 1),
            Order(Command.ENABLE_MOTOR_1, 1),
            Order(Command.ENABLE_MOTOR_2, 1),
        ]


def test_motors_are_started_when_they_are_aligned():
    with driven() as wired:
        start_motors([wired.board], wired.clock, timeout=0.02)
        assert wired.board.ready
        wired.board.command(0.5, -0.25)
        wired.clock.sleep(0.01)
        assert wired.firmware.current.tolist() == [0.5, -0.25]


@pytest.mark.parametrize("fault", [Fault.ENCODER, Fault.POSITION_ROLLOVER])
def test_a_fault_while_starting_stops_every_board(fault):
    with driven() as wired:
        wired.firmware.alignment = 60.0

        begin = wired.clock.now()

        def fail(now):
            if now - begin > 0.1:
                wired.firmware.fail(fault)
            wired.tick(now)

        wired.clock.tick = fail
        with pytest.raises(BoardError, match=fault.name):
            start_motors([wired.board], wired.clock)
        wired.firmware.listen(wired.clock.now())
        assert_left_in_peace(wired)


def test_motors_that_never_align_are_given_up():
    with driven() as wired:
        wired.firmware.alignment = 60.0
        with pytest.raises(BoardError, match="is not ready"):
            start_motors([wired.board], wired.clock, patience=1.5)
        wired.firmware.listen(wired.clock.now())
        assert_left_in_peace(wired)


@pytest.mark.parametrize(
    "leave", [KeyboardInterrupt, SystemExit, RuntimeError, StaleStreamError, None]
)
def test_zero_current_comes_first_on_every_way_out(leave):
    try:
        with driven() as wired:
            start_motors([wired.board], wired.clock)
            wired.board.command(1.0, 1.0)
            wired.clock.sleep(0.005)
            assert wired.firmware.current.any()
            if leave is not None:
                raise leave("out")
    except (KeyboardInterrupt, SystemExit, RuntimeError, StaleStreamError):
        assert leave is not None
    assert_left_in_peace(wired)


def assert_left_in_peace(wired):
    """The last words were: zero current, motors off, system off."""
    assert wired.firmware.received[-4:] == [
        Reference((0.0, 0.0)),
        Order(Command.ENABLE_MOTOR_1, 0),
        Order(Command.ENABLE_MOTOR_2, 0),
        Order(Command.ENABLE_SYSTEM, 0),
    ]
    assert not wired.firmware.current.any()


def test_stopping_twice_is_as_good_as_once():
    with driven() as wired:
        wired.board.stop()
        wired.board.stop()
    wired.board.stop()


def test_stopping_a_bus_that_is_gone_is_logged_and_goes_on(caplog):
    with driven() as wired:
        wired.board._bus.shutdown()
        with caplog.at_level(logging.WARNING):
            wired.board.stop()
        assert len(caplog.records) == 4  # each of the four frames was tried
        with pytest.raises(BusError, match="cannot write"):
            wired.board.command(0.0, 0.0)


@pytest.mark.parametrize("current", [2.001, -2.001, np.nan, np.inf])
def test_a_current_beyond_the_bound_is_never_sent(current):
    with driven() as wired:
        with pytest.raises(LimitError, match="at most 2"):
            wired.board.command(0.0, current)
        wired.firmware.listen(wired.clock.now())
        assert wired.firmware.received == []


def test_the_firmware_switches_off_when_it_hears_nothing():
    with driven() as wired:
        start_motors([wired.board], wired.clock, timeout=0.02)
        wired.board.command(0.5, 0.0)
        wired.clock.sleep(0.03)  # this program hangs
        assert not wired.firmware.current.any()
        wired.board.poll()
        with pytest.raises(BoardError, match="RECEIVE_TIMEOUT"):
            wired.board.check()


def test_the_sink_gets_what_comes_and_what_goes():
    seen = []
    with Wired(listen_only=False, sink=seen.append) as wired:
        start_motors([wired.board], wired.clock)
    assert {message.is_rx for message in seen} == {True, False}
    assert seen[0].arbitration_id == 0x005


# The joints of a finger


def test_motors_and_joints_are_mapped_there_and_back():
    joints = JointMap(zero=(0.1, -0.2, 0.3))
    angles = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    assert np.allclose(joints.angles(joints.revolutions(angles)), angles, atol=1e-15)
    assert np.allclose(joints.velocities(joints.krpm(angles)), angles, atol=1e-15)
    assert np.allclose(joints.torques(joints.currents(angles)), angles, atol=1e-15)


def test_the_first_joint_is_on_the_second_board():
    revolutions = JointMap().revolutions([2 * np.pi / 9, 0.0, 0.0])
    assert np.allclose(revolutions, [[0, 0], [1, 0]])
    plain = JointMap(motors=((0, 0), (0, 1), (1, 0)))
    assert np.allclose(plain.revolutions([2 * np.pi / 9, 0, 0]), [[1, 0], [0, 0]])


def test_one_turn_per_second_of_a_motor_is_a_ninth_at_the_joint():
    krpm = np.array([[0.0, 0.0], [0.06, 0.0]])  # 60 turns a minute, in thousands
    assert JointMap().velocities(krpm) == pytest.approx([2 * np.pi / 9, 0, 0])


def test_two_amperes_are_the_torque_limit_of_the_urdf():
    assert JointMap().torques(np.full((2, 2), 2.0)) == pytest.approx([0.36] * 3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"motors": ((0, 0), (0, 0), (1, 0))},
        {"motors": ((0, 0), (0, 1))},
        {"motors": ((0, 0), (0, 1), (2, 0))},
        {"zero": (0.0, 0.0)},
        {"zero": (0.0, np.nan, 0.0)},
    ],
)
def test_a_map_that_cannot_be_is_refused(wrong):
    with pytest.raises(RigError):
        JointMap(**wrong)
