"""A board that is driven is checked more strictly than one that is listened to."""

import can
import numpy as np
import pytest
from bench_board import driven

from hardware.errors import BoardError, StaleStreamError
from hardware.motor_can import (
    Command,
    Order,
    Quantity,
    Reference,
    encode,
)
from hardware.motor_joints import start_motors
from hardware.simulated_board import STATUS_PERIOD


def started(wired):
    start_motors([wired.board], wired.clock)
    wired.clock.sleep(0.01)
    wired.board.poll()
    wired.board.check()
    return wired.board


def test_silence_of_the_velocities_is_found_while_driving():
    with driven() as wired:
        board = started(wired)
        wired.firmware.sending = {Quantity.POSITION}
        wired.clock.sleep(0.11)
        board.poll()
        with pytest.raises(StaleStreamError, match="no velocity is heard"):
            board.check()
        board.stop()
        board.check()  # a listener needs positions only


@pytest.mark.parametrize(
    "content", [Reference((0.3, -0.3)), Order(Command.ENABLE_MOTOR_1, 0)]
)
def test_a_command_of_another_master_is_an_error_while_driving(content):
    with driven() as wired, can.Bus(**wired.board.config) as other:
        other.send(encode(content))  # before the start: it may have ended
        board = started(wired)
        other.send(encode(content))
        board.poll()
        for _ in range(2):  # it does not go away by itself
            with pytest.raises(BoardError, match="board 0: is commanded by another"):
                board.check()
        board.stop()
        board.check()


def test_another_program_of_this_computer_is_another_master():
    """SocketCAN marks its frames as sent by this computer."""
    with driven() as wired:
        board = started(wired)
        message = encode(Reference((0.3, -0.3)))
        message.is_rx = False
        board.on_message_received(message)
        with pytest.raises(BoardError, match="another master"):
            board.check()


def test_an_echo_of_a_command_is_no_other_master():
    """UDP multicast always gives back what is sent, other buses where asked to."""
    with driven() as wired:
        board = started(wired)
        for k in range(100):
            board.command(0.01 * k, 0.0)
            board.on_message_received(encode(Reference((0.01 * k, 0.0))))
            board.check()


def test_a_listener_hears_the_master_of_the_robot_without_an_error():
    with driven() as wired, can.Bus(**wired.board.config) as other:
        wired.firmware.sending = {Quantity.POSITION}
        wired.clock.sleep(0.01)
        other.send(encode(Reference((0.3, -0.3))))
        wired.board.poll()
        wired.board.check()
        assert wired.board.foreign == 1


@pytest.mark.parametrize("part", ["system", "motor"])
def test_a_board_that_is_enabled_no_longer_is_found_without_a_fault(part):
    with driven() as wired:
        board = started(wired)
        if part == "system":
            wired.firmware.system_enabled = False
        else:
            wired.firmware._enabled = np.array([True, False])
        wired.clock.sleep(STATUS_PERIOD)
        board.poll()
        with pytest.raises(BoardError, match="is not enabled any more"):
            board.check()
