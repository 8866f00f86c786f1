"""Frames of tactile sensors: cut anywhere, damaged, rubbish."""

import numpy as np
import pytest
from bench import FUZZ, capture, forces

from hardware.errors import FrameError
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

REAL = bytes.fromhex("AA07080A2D6A0000FFF7FFFB00070551")


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
    return all(
        np.array_equal(f.temperature, g.temperature)
        and np.array_equal(f.field, g.field)
        for f, g in zip(frames, others, strict=True)
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
    for wrong in ((200, 0), (1000, 7), ("1000", 0)):
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
