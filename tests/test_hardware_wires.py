"""Motor boards over real wires: slcan on a pseudo-terminal, UDP, SocketCAN."""

import itertools
import os
import time

import can
import numpy as np
import pytest
from bench import FUZZ, refused, terminal, wait_for
from bench_wires import line, slcan

from hardware.errors import BusError, HardwareError, StaleStreamError
from hardware.motor_board import MotorBoard
from hardware.motor_can import Pair, Quantity, decode, encode

__all__ = ["terminal"]  # a fixture
ZERO_CURRENT = b"t00580000000000000000\r"
ports = itertools.count(43200 + os.getpid() % 1000)


def position(k):
    return encode(Pair(Quantity.POSITION, (k / 64, -k / 64)))


def opened(terminal, **options):
    return MotorBoard(slcan(terminal), name="board 0", **options)


def poll_until(board, condition):
    def polled():
        board.poll()
        return condition()

    wait_for(polled)


def test_frames_come_through_an_slcan_adapter(terminal):
    with opened(terminal) as board:
        terminal.write(b"".join(line(position(k)) for k in range(200)))
        poll_until(board, lambda: len(board.series(Quantity.POSITION)[0]) == 200)
        values = board.series(Quantity.POSITION)[1]
        assert np.array_equal(values[:, 0], np.arange(200) / 64)
        assert board.broken == 0


def test_lines_that_were_garbled_on_the_way_are_counted_not_raised(terminal):
    with opened(terminal) as board:
        for rubbish in (b"t0308ZZ\r", b"t9\r", b"t03080102\r", b"t\r"):
            terminal.write(rubbish + line(position(7)))
        poll_until(board, lambda: len(board.series(Quantity.POSITION)[0]) == 4)
        assert board.broken == 4
        # bytes that are no text also cost what waits behind them, nothing later
        terminal.write(b"\xff\xfe\r")
        poll_until(board, lambda: board.broken == 5)
        terminal.write(line(position(7)))
        poll_until(board, lambda: len(board.series(Quantity.POSITION)[0]) == 5)
        board.check(stale=10.0)


def test_random_bytes_on_the_line_never_raise_or_hang(terminal):
    rng = np.random.default_rng(0)
    with opened(terminal) as board:
        for _ in range(FUZZ // 2000):
            bits = rng.integers(0, 256, 200, dtype=np.uint8)
            bits[rng.random(200) < 0.1] = ord("\r")
            bits[rng.random(200) < 0.1] = ord("t")
            terminal.write(bits.tobytes())
            board.poll()
        end = time.monotonic() + 60
        while not len(board.series(Quantity.POSITION)[0]) and time.monotonic() < end:
            terminal.write(b"\r" + line(position(1)))  # rubbish costs what is behind it
            board.poll()
        assert len(board.series(Quantity.POSITION)[0])


def test_driving_over_slcan_ends_with_zero_current(terminal):
    with opened(terminal, listen_only=False) as board:
        board.start()
        board.command(0.5, 0.5)
        time.sleep(0.02)
        assert ZERO_CURRENT in terminal.read_until(ZERO_CURRENT)
    time.sleep(0.02)
    assert terminal.read_until(ZERO_CURRENT).startswith(ZERO_CURRENT)


def test_an_adapter_that_is_pulled_out_is_missed_within_200_ms(terminal):
    with opened(terminal) as board:
        terminal.write(line(position(0)))
        poll_until(board, lambda: len(board.series(Quantity.POSITION)[0]) == 1)
        board.check(stale=10.0)
        terminal.unplug()

        def look():
            board.poll()
            board.check()

        error, passed = refused(look, since=time.monotonic())
        assert isinstance(error, BusError | StaleStreamError)
        assert "board 0" in str(error)
        assert passed < 0.2


def test_frames_come_over_udp():
    pytest.importorskip("msgpack", reason="udp_multicast needs msgpack")
    config = {"interface": "udp_multicast", "channel": "239.74.163.2"}
    config["port"] = next(ports)
    try:
        bus = can.Bus(**config)
    except (can.CanError, OSError) as bad:
        pytest.skip(f"no multicast here: {bad}")
    with bus, MotorBoard(config) as board:
        for k in range(20):
            bus.send(position(k))
        poll_until(board, lambda: len(board.series(Quantity.POSITION)[0]) == 20)


def test_frames_come_over_socketcan():
    config = {"interface": "socketcan", "channel": "vcan0"}
    try:
        bus = can.Bus(**config)
    except OSError as bad:
        pytest.skip(f"needs vcan: ip link add dev vcan0 type vcan; here: {bad}")
    with bus, MotorBoard(config) as board:
        bus.send(position(1))
        poll_until(board, lambda: len(board.series(Quantity.POSITION)[0]) == 1)


@pytest.mark.parametrize("suffix", [".blf", ".log", ".log.gz"])
def test_a_recorded_bus_reads_as_the_live_one_did(tmp_path, suffix):
    stamps = 1.7e9 + np.arange(500) / 1000
    path = str(tmp_path / f"bus{suffix}")
    with can.Logger(path) as logger:
        for k, stamp in enumerate(stamps):
            message = position(k % 1000)
            message.timestamp, message.channel = stamp, 0
            logger(message)
    board = MotorBoard({})
    with can.LogReader(path) as reader:
        for message in reader:
            board.on_message_received(message)
    read, values = board.series(Quantity.POSITION)
    assert read == pytest.approx(stamps, abs=1e-6)
    assert values[:, 1].tolist() == [-(k % 1000) / 64 for k in range(500)]


def test_random_frames_reach_a_board_and_raise_only_when_it_is_checked():
    rng, board = np.random.default_rng(6), MotorBoard({})
    board._heard["opened"] = board.clock.now()
    identifiers = rng.integers(0, 0x70, FUZZ)
    for identifier in identifiers.tolist():
        message = can.Message(
            arbitration_id=identifier,
            data=rng.bytes(rng.integers(0, 9)),
            is_extended_id=bool(rng.random() < 0.05),
            is_error_frame=bool(rng.random() < 0.05),
            is_remote_frame=False,
        )
        board.on_message_received(message)
    assert board.broken > 0
    assert board.errors > 0
    with pytest.raises(HardwareError):
        board.check()


def test_flipped_bits_of_real_frames_decode_or_raise_frame_errors():
    rng = np.random.default_rng(7)
    decoded = 0
    for k in range(FUZZ):
        message = position(k % 1000)
        bit = int(rng.integers(0, 64 + 11))
        if bit < 64:
            message.data[bit // 8] ^= 1 << bit % 8
        else:
            message.arbitration_id ^= 1 << (bit - 64)
        try:
            decoded += isinstance(decode(message), Pair)
        except HardwareError:
            continue
    assert decoded > FUZZ // 2  # a flipped value cannot be told: CAN's own CRC does
