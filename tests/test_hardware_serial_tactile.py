"""Tactile sensors on serial lines and on CAN: framing, rubbish, unplugging."""

import itertools
import os
import time

import can
import numpy as np
import pytest
import serial
from bench import FUZZ, ManualClock, Terminal, capture, refused, terminal

from hardware.errors import BusError, FrameError, HardwareError, StaleStreamError
from hardware.serial_reader import OptoForceCan, SerialTactile
from hardware.serial_tactile import (
    CONFIG_ID,
    DATA_ID,
    AnySkinFramer,
    FieldFrame,
    ForceFrame,
    OptoForceFramer,
    encode_configuration,
    encode_field,
    encode_force,
    to_can,
)
from hardware.touch import FieldTouch, ForceTouch, Hysteresis, Tare

__all__ = ["terminal"]  # a fixture
REAL = bytes.fromhex("AA07080A2D6A0000FFF7FFFB00070551")
channels = itertools.count()


def forces(n, seed=0):
    rng = np.random.default_rng(seed)
    counts = rng.integers(-3000, 3000, (n, 3)).tolist()
    return [ForceFrame((65500 + k) % 65536, 0, tuple(c)) for k, c in enumerate(counts)]


def fields(n, chips=5, seed=0):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(n, chips, 4)).astype("<f4").astype(float)
    return [FieldFrame(v[:, 0], v[:, 1:]) for v in values]


def cut(data, rng, longest=200):
    """Cut bytes into chunks of random lengths."""
    while data:
        n = int(rng.integers(1, longest))
        yield data[:n]
        data = data[n:]


def fed(framer, data, seed=0):
    rng = np.random.default_rng(seed)
    return [frame for chunk in cut(data, rng) for frame in framer.feed(chunk)]


def same(frames, others):
    pairs = list(zip(frames, others, strict=True))
    return all(
        np.array_equal(a, b) for f, g in pairs for a, b in zip(f, g, strict=True)
    )


# OptoForce


def test_the_real_capture_has_its_34320_good_and_54_broken_frames():
    data = capture("optoforce_omd_serial.bin").read_bytes()
    whole = OptoForceFramer()
    frames = whole.feed(data)
    assert (len(frames), whole.good, whole.broken, whole.lost) == (34320, 34320, 54, 54)
    pieces = OptoForceFramer()
    assert fed(pieces, data) == frames
    assert vars(pieces) == vars(whole)
    assert {frame.status for frame in frames} == {0}
    depth = [frame.counts[2] for frame in frames]
    assert (min(depth), max(depth)) == (-3316, 24)


def test_the_first_real_packet_reads_as_it_should():
    (frame,) = OptoForceFramer().feed(REAL)
    assert frame == ForceFrame(11626, 0, (-9, -5, 7))
    assert encode_force(frame) == REAL
    assert not frame.fault
    assert not frame.overload


def test_packets_survive_being_cut_anywhere():
    sent = forces(300)
    data = b"".join(map(encode_force, sent))
    for seed in range(5):
        framer = OptoForceFramer()
        assert fed(framer, data, seed) == sent
        assert (framer.broken, framer.lost, framer.skipped) == (0, 0, 0)


def test_a_packet_that_lost_a_byte_costs_itself_alone():
    sent = forces(100)
    packets = [encode_force(frame) for frame in sent]
    packets[40] = packets[40][:9] + packets[40][10:]
    framer = OptoForceFramer()
    assert fed(framer, b"".join(packets)) == sent[:40] + sent[41:]
    assert (framer.good, framer.broken, framer.lost) == (99, 1, 1)


def test_a_sensor_that_was_switched_on_again_has_lost_nothing():
    framer = OptoForceFramer()
    for counter in (10000, 10001, 3, 4):
        framer.feed(encode_force(ForceFrame(counter, 0, (0, 0, 0))))
    assert framer.lost == 0


def test_errors_and_overload_are_told_apart():
    assert ForceFrame(0, 2 << 10, (0, 0, 0)).fault
    assert ForceFrame(0, 1 << 13, (0, 0, 0)).fault
    overload = ForceFrame(0, 1 << 7, (0, 0, 0))
    assert overload.overload
    assert not overload.fault


def test_the_configuration_packet_is_the_documented_one():
    assert encode_configuration(100, 15) == bytes.fromhex("AA0032030A040000ED")
    assert encode_configuration(1000, 0, zero=True)[4:7] == bytes([1, 0, 255])
    for wrong in ((200, 0), (1000, 7)):
        with pytest.raises(FrameError, match="one of"):
            encode_configuration(*wrong)


def test_on_can_it_is_the_same_codec_in_frames_of_eight_bytes():
    sent, framer = forces(20), OptoForceFramer()
    messages = [m for f in sent for m in to_can(encode_force(f), DATA_ID)]
    assert {len(m.data) for m in messages} == {8}
    assert [f for m in messages for f in framer.feed(bytes(m.data))] == sent
    sizes = [len(m.data) for m in to_can(encode_configuration(), CONFIG_ID)]
    assert sizes == [8, 1]


# AnySkin


@pytest.mark.parametrize("chips", [1, 5])
def test_frames_of_a_skin_survive_being_cut_anywhere(chips):
    sent = fields(200, chips)
    data = b"".join(map(encode_field, sent))
    framer = AnySkinFramer(chips)
    assert same(fed(framer, data), sent[1:])  # nothing marks the start of the first
    assert (framer.good, framer.broken) == (199, 0)


def test_a_skin_that_lost_bytes_comes_back_into_step():
    sent = fields(100)
    data = b"".join(map(encode_field, sent))
    cut_out = data[: 40 * 82 + 30] + data[40 * 82 + 37 :]
    framer = AnySkinFramer()
    assert same(fed(framer, cut_out), sent[1:40] + sent[41:])
    assert (framer.good, framer.broken) == (98, 1)


def test_a_delimiter_inside_the_numbers_is_no_delimiter():
    sent = fields(50)
    for frame in sent[::7]:  # the very first too, where nothing is in step yet
        frame.temperature[2] = np.frombuffer(b"\r\n\r\n", "<f4")[0]
    framer = AnySkinFramer()
    assert same(fed(framer, b"".join(map(encode_field, sent))), sent[1:])


@pytest.mark.parametrize("word", ["0000C07F", "0100807F", "0000807F"])
def test_what_is_no_number_is_broken(word):
    sent = bytearray(b"".join(map(encode_field, fields(4))))
    sent[2 * 82 : 2 * 82 + 4] = bytes.fromhex(word)  # quiet NaN, signalling NaN, inf
    framer = AnySkinFramer()
    assert len(fed(framer, bytes(sent))) == 2
    assert framer.broken == 1


def test_a_skin_without_magnetometers_is_refused():
    with pytest.raises(FrameError, match="magnetometers"):
        AnySkinFramer(0)


# Rubbish


@pytest.mark.parametrize("framer", [OptoForceFramer, AnySkinFramer])
def test_random_bytes_make_no_frames_and_no_errors(framer):
    rng, framer = np.random.default_rng(3), framer()
    for chunk in cut(rng.bytes(16 * FUZZ), rng, 4000):
        framer.feed(chunk)
        assert len(framer._buffer) < 4200
    assert framer.good == 0


@pytest.mark.parametrize(
    ("framer", "make", "encode"),
    [(OptoForceFramer, forces, encode_force), (AnySkinFramer, fields, encode_field)],
)
def test_flipped_bits_break_frames_and_nothing_else(framer, make, encode):
    rng, n = np.random.default_rng(4), max(FUZZ // 10, 500)
    sent = make(n)
    data = np.frombuffer(b"".join(map(encode, sent)), np.uint8).copy()
    size = len(data) // n
    hit = rng.choice(n, n // 20, replace=False)
    bits = (1 << rng.integers(0, 8, len(hit))).astype(np.uint8)
    data[hit * size + rng.integers(0, size, len(hit))] ^= bits
    framer = framer()
    found = fed(framer, data.tobytes())
    # most frames come through untouched, a broken one costs at most its neighbour
    assert n - 2 * len(hit) - 1 <= len(found) <= n
    if make is forces:  # the checksum sees every single bit
        assert set(found) <= set(sent)


# Touches


def test_contact_begins_and_ends_at_two_thresholds():
    decide = Hysteresis(on=2.0, off=1.0)
    strengths = [0.5, 1.5, 2.5, 1.5, 0.9, 1.5]
    assert [decide(s) for s in strengths] == [False, False, True, True, False, False]
    for on, off in ((1.0, 2.0), (1.0, 0.0), (np.nan, 1.0)):
        with pytest.raises(FrameError, match="off <= on"):
            Hysteresis(on, off)


def test_thresholds_are_above_everything_felt_without_contact():
    quiet = np.random.default_rng(0).normal(5.0, 0.5, 1000)
    learnt = Hysteresis.learn(quiet, least=1.0)
    assert quiet.max() < learnt.on < 9.0
    assert not any(map(learnt, quiet))
    assert Hysteresis.learn(np.zeros(10), least=1.0).on == 1.0
    with pytest.raises(FrameError, match="without contact"):
        Hysteresis.learn([], least=1.0)


def test_the_zero_is_the_mean_at_rest():
    tare = Tare(10)
    assert [tare(np.array([k])) for k in range(10)] == [None] * 10
    assert tare(np.array([4.5])).tolist() == [0.0]


def test_a_pressed_dome_gives_the_normal_of_what_presses_it():
    touch = ForceTouch(scale=(100, 100, 100), rest=5, mount=np.eye(3))
    x, y, z = 7, -3, 11
    for k in range(5):
        assert touch(k, ForceFrame(k, 0, (x, y, z))) is None
    light = touch(5, ForceFrame(5, 0, (x, y, z - 10)))
    assert (light.contact, light.normal.tolist()) == (False, [0, 0, 0])
    pressed = touch(6, ForceFrame(6, 0, (x + 30, y, z - 40)))
    assert pressed.contact
    assert pressed.strength == pytest.approx(0.5)  # [N]
    # from the object to the finger: into the dome
    assert pressed.normal == pytest.approx([0.6, 0, -0.8])
    assert not touch(7, ForceFrame(7, 1 << 10, (0, 0, 0))).valid


def test_a_skin_knows_whether_it_is_touched_not_where():
    touch = FieldTouch(on=10, off=5, rest=1)
    quiet = FieldFrame(np.full(5, 21.0), np.zeros((5, 3)))
    assert touch(0.0, quiet) is None
    felt = touch(1.0, quiet._replace(field=np.full((5, 3), 4.0)))
    assert felt.contact
    assert not felt.normal.any()


# The port


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.002)


def test_a_port_delivers_the_real_capture_exactly(terminal):
    data = capture("optoforce_omd_serial.bin").read_bytes()
    chunks = []
    sensor = SerialTactile(
        terminal.name, OptoForceFramer(), sink=lambda c, t: chunks.append(c)
    )
    with sensor:
        wait_for(lambda: sensor._opened)
        terminal.write(data)
        wait_for(lambda: sensor.framer.good == 34320)
    assert sensor.framer.broken == 54
    frames = sensor.take()
    assert len(frames) == 34320
    assert sensor.take() == []
    stamps = [stamp for stamp, _ in frames]
    assert stamps == sorted(stamps)
    assert b"".join(chunks)[: len(data)] == data


def test_the_sensor_is_configured_when_it_is_opened(terminal):
    packet = encode_configuration(333, 150)
    with SerialTactile(terminal.name, OptoForceFramer(), configure=packet):
        got = b""
        end = time.monotonic() + 5
        while len(got) < len(packet) and time.monotonic() < end:
            got += terminal.read()
    assert got == packet


def test_an_unplugged_sensor_is_missed_at_once_and_found_again(tmp_path):
    link = tmp_path / "ttyACM0"  # udev gives the same name again
    first = Terminal()
    link.symlink_to(first.name)
    with SerialTactile(str(link), OptoForceFramer(), name="finger 0") as sensor:
        wait_for(lambda: sensor._opened)
        first.write(REAL)
        wait_for(lambda: sensor.framer.good == 1)
        sensor.check(stale=10.0)
        first.unplug()
        link.unlink()
        error, passed = refused(sensor.check, since=time.monotonic())
        assert isinstance(error, StaleStreamError)
        assert "finger 0: no touch is sensed" in str(error)
        assert passed < 0.2
        second = Terminal()
        link.symlink_to(second.name)
        wait_for(lambda: sensor.reconnects == 1)
        second.write(REAL)
        wait_for(lambda: sensor.framer.good == 2)
        sensor.check(stale=10.0)
        second.unplug()


def test_a_silent_sensor_costs_no_time(terminal):
    with SerialTactile(terminal.name, OptoForceFramer()) as sensor:
        wait_for(lambda: sensor._opened)
        before = time.process_time()
        time.sleep(0.3)
        assert time.process_time() - before < 0.1
        with pytest.raises(StaleStreamError, match="silence"):
            sensor.check()


def test_a_port_that_is_not_there_is_said_with_the_reason():
    with SerialTactile("/dev/nowhere", OptoForceFramer()) as sensor:
        time.sleep(0.15)
        with pytest.raises(StaleStreamError, match="No such file"):
            sensor.check()


def test_a_port_is_read_by_one_only(terminal):
    with SerialTactile(terminal.name, OptoForceFramer()) as sensor:
        wait_for(lambda: sensor._opened)
        with SerialTactile(terminal.name, OptoForceFramer()) as other:
            wait_for(lambda: other._why)
            assert "lock" in other._why or "Resource" in other._why
        with pytest.raises(serial.SerialException):
            serial.Serial(terminal.name, exclusive=True)


def test_a_sink_that_fails_ends_in_its_own_error(terminal):
    def full(chunk, now):
        raise HardwareError("the disk is full")

    with SerialTactile(terminal.name, OptoForceFramer(), sink=full) as sensor:
        wait_for(lambda: sensor._opened)
        terminal.write(REAL)
        wait_for(lambda: sensor._broken_down)
        with pytest.raises(HardwareError, match="the disk is full"):
            sensor.check()


def test_a_sensor_on_can_is_read_beside_the_boards():
    config = {"interface": "virtual", "channel": f"tactile {next(channels)}"}
    clock = ManualClock()
    with can.Bus(**config) as bus, OptoForceCan(config, clock=clock) as sensor:
        for frame in forces(30):
            for message in to_can(encode_force(frame), DATA_ID):
                bus.send(message)
            bus.send(can.Message(arbitration_id=0x30, data=bytes(8)))
        restarted = can.Message(arbitration_id=DATA_ID, data=bytes(8))
        restarted.is_error_frame = True
        bus.send(restarted)
        assert [frame for _, frame in sensor.take()] == forces(30)
        assert sensor.framer.skipped == 0
        sensor.check()
        clock.sleep(0.2)
        with pytest.raises(StaleStreamError):
            sensor.check()


def test_a_sensor_on_a_bus_that_is_not_there_says_so():
    with pytest.raises(BusError, match="cannot be opened"):
        OptoForceCan({"interface": "socketcan", "channel": "can97"}).__enter__()
    assert OptoForceCan().take() == []


def test_ports_are_closed_when_they_are_left(terminal):
    before = len(os.listdir("/proc/self/fd"))
    with SerialTactile(terminal.name, OptoForceFramer()) as sensor:
        wait_for(lambda: sensor._opened)
    assert len(os.listdir("/proc/self/fd")) == before
