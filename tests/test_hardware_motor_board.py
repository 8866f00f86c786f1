"""A motor board on a bus: what is heard, and what is said to whom."""

import can
import numpy as np
import pytest
from bench import wait_for
from bench_board import Wired, channels, driven

from hardware.errors import BoardError, BusError, StaleStreamError
from hardware.motor_board import MotorBoard
from hardware.motor_can import (
    Command,
    EncoderIndex,
    Pair,
    Quantity,
    encode,
    encode_command,
)
from hardware.simulated_board import SimulatedBoard

# Listening


def test_every_frame_is_counted_and_kept_with_its_stamp():
    with Wired() as wired:
        wired.firmware.sending = {Quantity.POSITION}
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
        wired.firmware.sending = {Quantity.POSITION}
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


@pytest.mark.parametrize("error_class", [0x004, 0x100])
def test_a_controller_that_is_active_again_is_no_loss_of_its_bus(error_class):
    with Wired() as wired:
        again = can.Message(arbitration_id=error_class, data=bytes(8))
        again.is_error_frame = True
        wired.board.on_message_received(again)
        assert (wired.board.errors, wired.board.foreign) == (1, 0)
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


@pytest.mark.parametrize("quantity", Quantity)
def test_one_stream_of_a_simulated_board_is_switched_on_and_off(quantity):
    with driven() as wired:
        for value, sending in ((1, {quantity}), (0, set())):
            command = Command[f"SEND_{quantity.name}"]
            wired.board.bus.send(encode_command(command, value))
            wired.firmware.listen(wired.clock.now())
            assert wired.firmware.sending == sending


def test_the_encoder_index_is_kept():
    with Wired() as wired:
        index = EncoderIndex(0.5, 1)
        wired.board.on_message_received(encode(index, 12.0))
        assert list(wired.board.index) == [(12.0, index)]


def test_a_notifier_outlives_a_listener_that_raises():
    def explode(message):
        raise RuntimeError("a broken sink")

    config = {"interface": "virtual", "channel": f"board {next(channels)}"}
    with SimulatedBoard(config) as firmware, MotorBoard(config, sink=explode) as board:
        notifier = can.Notifier(board.bus, [board], timeout=0.01)
        for k in range(5):
            firmware.send(encode(Pair(Quantity.POSITION, (k, 0.0))))
        wait_for(lambda: board.broken == 5)
        firmware.send(encode(Pair(Quantity.POSITION, (5, 0.0))))
        wait_for(lambda: board.broken == 6)
        notifier.stop()


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
            end.send(encode(Pair(Quantity.POSITION, (k, -k))))
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


def test_a_status_of_before_a_start_counts_no_longer():
    """The firmware sends one a second: an old one may say that motors are ready."""
    with Wired(listen_only=False) as wired:
        wired.clock.sleep(0.1)
        wired.board.poll()
        assert wired.board.status is not None
        wired.firmware.silent = True
        wired.board.start()
        assert wired.board.status is None
        assert not wired.board.ready
        assert wired.board.age("STATUS") == 0.0


def test_a_sink_that_fails_does_not_hinder_a_stop():
    with Wired(listen_only=False) as wired:
        wired.board.start()
        wired.clock.sleep(0.01)
        sent = len(wired.firmware.received)

        def full(message):
            raise ValueError("I/O operation on closed file.")

        wired.board.sink = full
        wired.board.stop()
        wired.clock.sleep(0.01)
        assert len(wired.firmware.received) == sent + 4  # current, motors, system
