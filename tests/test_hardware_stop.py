"""How a robot is stopped: all boards at once, whatever one of them does."""

import time
from contextlib import suppress
from dataclasses import replace

import can
import pytest
from bench import terminal
from bench_robot import FREE, Setup, numbers
from bench_wires import slcan

from hardware.bench import Bench
from hardware.errors import BusError
from hardware.motor_board import SEND_TIME, MotorBoard
from hardware.motor_can import REFERENCE
from hardware.simulated_robot import simulated_rig

__all__ = ["terminal"]  # a fixture
ZERO = bytes(8)


@pytest.fixture
def listening():
    """A rig on virtual wires, and a bus that hears each board's commands."""
    rig = simulated_rig("optoforce_can", f"stop {next(numbers)}")
    ends = [can.Bus(**board) for one in rig.fingers for board in one.boards]
    yield rig, ends
    for end in ends:
        end.shutdown()


def heard(bus):
    """Return the identifiers and data of what a bus received."""
    frames = []
    while (message := bus.recv(timeout=0)) is not None:
        frames.append((message.arbitration_id, bytes(message.data)))
    return frames


def fill(board):
    """Command until the board's adapter takes no more."""
    while True:
        board.command(0.1, 0.1)


def test_an_adapter_that_hangs_is_given_up_at_once(terminal):
    """Nothing reads from the terminal: its buffer fills, then a write waits."""
    with MotorBoard(slcan(terminal), name="hung", listen_only=False) as board:
        began = time.monotonic()
        with pytest.raises(BusError, match="hung: cannot write"):
            fill(board)
        assert time.monotonic() - began < 10.0
        began = time.monotonic()
        board.stop()
        assert time.monotonic() - began < 20 * SEND_TIME


def test_nothing_waits_until_a_port_is_drained(terminal, monkeypatch):
    """To drain a port has no time-out: with an adapter that hangs it takes for ever."""
    with MotorBoard(slcan(terminal), listen_only=False) as board:

        def drain(port):
            raise AssertionError("waits for the adapter")

        monkeypatch.setattr("termios.tcdrain", drain)
        board.command(0.1, 0.1)
        board.stop()
    assert b"t0058" in terminal.read_until(b"t0058")


def test_the_port_of_an_adapter_that_hangs_is_closed(terminal):
    with MotorBoard(slcan(terminal), listen_only=False) as board:
        port = board.bus.serialPortOrig
        with pytest.raises(BusError):
            fill(board)
    assert not port.is_open


def test_a_board_on_an_adapter_that_hangs_does_not_delay_the_others(
    terminal, listening
):
    rig, ends = listening
    first, second = rig.fingers
    hung = replace(first, boards=(slcan(terminal), first.boards[1]))
    with Bench(replace(rig, fingers=(hung, second)), listen_only=False) as bench:
        with pytest.raises(BusError):
            fill(bench.boards[0])
        began = time.monotonic()
        bench.stop()
        assert time.monotonic() - began < 20 * SEND_TIME
        for end in ends[1:]:
            assert heard(end)[0] == (REFERENCE, ZERO)


def test_zero_current_goes_to_all_boards_before_one_is_disabled(listening):
    rig, _ = listening
    with Bench(rig, listen_only=False) as bench:
        order = []
        for board in bench.boards:
            send = board.bus.send

            def spy(message, *given, send=send):
                order.append((message.arbitration_id, bytes(message.data)))
                send(message, *given)

            board.bus.send = spy
        bench.stop()
        assert order[:4] == [(REFERENCE, ZERO)] * 4
        assert len(order) == 16


def test_a_recording_that_is_slow_delays_no_stop(listening):
    rig, ends = listening
    counts = []

    def slow(message):
        counts.append([len(heard(end)) for end in ends])

    with Bench(rig, listen_only=False) as bench:
        for board in bench.boards:
            board.sink = slow
        bench.stop()
        assert counts[0] == [4, 4, 4, 4]  # all frames went before the first is recorded
        assert len(counts) == 16


@pytest.mark.parametrize("error", [RuntimeError, can.CanError, KeyboardInterrupt])
def test_an_error_of_one_board_does_not_keep_the_others_from_stopping(listening, error):
    rig, ends = listening
    with Bench(rig, listen_only=False) as bench:
        send = bench.boards[0].bus.send

        def explode(message, timeout):
            bench.boards[0].bus.send = send
            raise error("once")

        bench.boards[0].bus.send = explode
        if error is KeyboardInterrupt:  # a second Ctrl-C is not lost
            with pytest.raises(KeyboardInterrupt):
                bench.stop()
        else:
            bench.stop()
        assert [len(heard(end)) for end in ends] == [3, 4, 4, 4]


def test_a_frame_that_an_adapter_does_not_take_ends_an_action():
    with Setup() as setup:
        setup.world.start()

        def fill():
            def full(message, timeout):
                assert timeout == SEND_TIME
                raise can.CanTimeoutError("transmit buffer full")

            setup.bench.boards[1].bus.send = full

        setup.after(0.1, fill)
        with pytest.raises(BusError, match="finger 0, board 1: cannot write"):
            setup.world.execute(FREE)
        assert not any(board.current.any() for board in setup.boards[2:])


@pytest.mark.parametrize("harm", [None, KeyboardInterrupt])
def test_a_bench_that_did_not_drive_stops_no_board_when_it_is_closed(listening, harm):
    rig, ends = listening
    with suppress(KeyboardInterrupt), Bench(rig, listen_only=False) as bench:
        bench.boards[0].ask()
        if harm is not None:
            raise harm
    assert [len(heard(end)) for end in ends] == [2, 0, 0, 0]
    with Bench(rig, listen_only=False) as bench:
        bench.boards[3].command(0.1, 0.1)
    assert [heard(end)[k] for k, end in zip((0, 0, 0, 1), ends, strict=True)] == [
        (REFERENCE, ZERO)
    ] * 4
    with Bench(rig, listen_only=False) as bench:
        bench.stop()  # one that is told to is always sent
    assert [len(heard(end)) for end in ends] == [4, 4, 4, 4]
