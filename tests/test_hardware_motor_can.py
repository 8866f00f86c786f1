"""The wire format of the motor boards: documented frames, limits, rubbish."""

import can
import numpy as np
import pytest
from bench import FUZZ

from hardware import motor_can as codec
from hardware.errors import BusError, FrameError
from hardware.motor_can import (
    Command,
    EncoderIndex,
    Fault,
    Order,
    Pair,
    Quantity,
    Reference,
    Status,
    decode,
    encode,
)

ANYTHING = [
    Order(Command.RECEIVE_TIMEOUT, 300),
    Order(Command.ENABLE_MOTOR_2, 1),
    Reference((0.25, -1.5)),
    Status(True, (True, False), (False, True), Fault.POSITION_ROLLOVER),
    Status(False, (False, False), (False, False), Fault.NONE),
    EncoderIndex(-3.25, 1),
    *(Pair(quantity, (0.125, -100.0)) for quantity in Quantity),
]


def frame(identifier, data, **more):
    more = {"is_extended_id": False} | more
    return can.Message(arbitration_id=identifier, data=bytes(data), **more)


def written(message):
    return f"{message.arbitration_id:03X}#{bytes(message.data).hex().upper()}"


@pytest.mark.parametrize(
    ("message", "documented"),
    [  # in the order in which the documents start the motors
        (codec.encode_current(0, 0), "005#0000000000000000"),
        (codec.encode_command(Command.RECEIVE_TIMEOUT, 0), "000#000000000000001E"),
        (codec.encode_command(Command.ENABLE_SYSTEM, 1), "000#0000000100000001"),
        (codec.encode_command(Command.SEND_ALL, 1), "000#0000000100000014"),
        (codec.encode_command(Command.ENABLE_MOTOR_1, 1), "000#0000000100000002"),
        (codec.encode_command(Command.ENABLE_MOTOR_2, 1), "000#0000000100000003"),
        # more than a byte of milliseconds
        (codec.encode_command(Command.RECEIVE_TIMEOUT, 300), "000#0000012C0000001E"),
        (codec.encode_current(0.1, -0.1), "005#0019999AFFE66666"),
        (codec.encode_current(2.0, -128.0), "005#0200000080000000"),
    ],
)
def test_the_documented_frames_come_out(message, documented):
    assert written(message) == documented
    assert not message.is_extended_id


def test_a_joint_angle_on_the_wire_is_the_documented_word():
    revolutions = 0.9 * 9 / (2 * np.pi)  # 0.9 rad, gear 9, zero angle 0
    assert codec.to_q24(revolutions) == 0x014A0611


@pytest.mark.parametrize("content", ANYTHING, ids=repr)
def test_whatever_is_encoded_is_decoded_to_the_same(content):
    assert decode(encode(content)) == content


def test_a_number_is_rounded_to_the_nearest_count():
    values = np.random.default_rng(0).uniform(-128, 127.9, 1000)
    for value in values.tolist():
        back = codec.from_q24(codec.to_q24(value))
        assert abs(back - value) <= codec.RESOLUTION / 2


def test_numbers_beyond_the_range_are_saturated_not_wrapped():
    largest = codec.from_q24(codec.to_q24(1e9))
    assert largest == 128 - codec.RESOLUTION
    assert codec.from_q24(codec.to_q24(128.0)) == largest
    assert codec.from_q24(codec.to_q24(-1e9)) == -128.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_never_sent(value):
    with pytest.raises(FrameError, match="finite"):
        codec.encode_current(0.0, value)


@pytest.mark.parametrize("value", [1, 1.0, True, np.True_, np.int64(1), np.float64(1)])
def test_a_command_value_is_one_whole_number_or_a_boolean(value):
    message = codec.encode_command(Command.ENABLE_SYSTEM, value)
    assert written(message) == "000#0000000100000001"


@pytest.mark.parametrize(
    "value", [1 << 31, -1e10, 0.5, np.nan, np.inf, "1", None, [1], 10**400]
)
def test_a_command_value_must_fit_its_word(value):
    with pytest.raises(FrameError, match="int32"):
        codec.encode_command(Command.RECEIVE_TIMEOUT, value)


@pytest.mark.parametrize("error_class", [0x10, 0x20, 0x30, 0x40, 0x60, 0x100])
def test_an_error_frame_is_never_read_as_a_measurement(error_class):
    # its class stands in the place of the identifier: bus-off looks like a velocity
    message = frame(error_class, bytes(8), is_error_frame=True)
    if not error_class & 0x40:  # warnings, and that the controller was restarted
        assert decode(message) is None
        return
    with pytest.raises(BusError, match=f"the bus is off.*0x{error_class:03X}"):
        decode(message)


@pytest.mark.parametrize("identifier", [0x000, 0x005, 0x010, 0x020, 0x030, 0x060])
def test_frames_of_a_wrong_length_are_refused(identifier):
    right = {0x010: 1, 0x060: 5}.get(identifier, 8)
    for size in set(range(9)) - {right}:
        with pytest.raises(FrameError, match=f"0x{identifier:03X}.*{right} bytes"):
            decode(frame(identifier, bytes(size)))


def test_a_short_line_of_an_slcan_adapter_keeps_the_wrong_length_code():
    short = frame(0x030, bytes(3))
    short.dlc = 8
    with pytest.raises(FrameError, match="3 bytes"):
        decode(short)


def test_motors_and_commands_that_are_none_are_refused():
    with pytest.raises(FrameError, match="motor 0 or 1"):
        decode(frame(0x060, bytes([0, 0, 0, 0, 2])))
    with pytest.raises(FrameError, match="command 99"):
        decode(frame(0x000, bytes([0, 0, 0, 1, 0, 0, 0, 99])))


def test_frames_of_other_devices_are_left_alone():
    for other in (
        frame(0x100, bytes(8)),  # OptoForce on the same bus
        frame(0x7FF, bytes(2)),
        frame(0x030, bytes(8), is_extended_id=True),
        frame(0x030, b"", is_remote_frame=True),
    ):
        assert decode(other) is None


def test_rubbish_raises_nothing_but_frame_errors():
    rng = np.random.default_rng(5)
    known = 0
    for _ in range(FUZZ):
        size, identifier = rng.integers(0, 9), rng.choice([0, 5, 16, 32, 48, 96, 7])
        message = frame(int(identifier), rng.bytes(size))
        message.dlc = int(rng.integers(0, 9))
        try:
            known += decode(message) is not None
        except FrameError:
            continue
    assert known > 0
