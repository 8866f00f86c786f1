"""Driving motor boards: how they start, how it always ends."""

import logging

import numpy as np
import pytest
from bench_board import Wired, driven

from hardware.errors import BoardError, BusError, LimitError, StaleStreamError
from hardware.motor_can import (
    Command,
    Fault,
    Order,
    Reference,
)
from hardware.motor_joints import start_motors


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
    assert_left_in_peace(wired)


def test_stopping_a_bus_that_is_gone_is_logged_and_goes_on(caplog):
    with driven() as wired:
        wired.board.bus.shutdown()
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
