"""Encode and decode the CAN frames of an ODRI motor board.

Classic CAN 2.0B at 1 Mbit/s (sample point 86.7 %), identifiers of 11 bits, two
big-endian 32-bit words.  Values are Q24: int32 / 2^24, in [-128, 128).  A board has no
address: every board needs a bus of its own.  From the documents of udriver_firmware.

    0x000 command        value (int32), command       to the board
    0x005 current        motor 1, motor 2 [A]         to the board
    0x010 status         one byte of flags            1 Hz
    0x020 current        motor 1, motor 2 [A]         1 kHz
    0x030 position       motor 1, motor 2 [rev]       1 kHz
    0x040 velocity       motor 1, motor 2 [krpm]      1 kHz
    0x050 analogue       A6, B6 [1]                   1 kHz
    0x060 encoder index  position [rev], motor        when the index passes

No I/O.  An error frame carries its error class in place of the identifier (bus-off is
0x40, which is also the velocity): `decode` tests for an error frame first.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import Enum, IntEnum
from itertools import chain

import can
import numpy as np

from tactilenlp.common.validation import as_number, check_one_of, check_whole
from tactilenlp.errors import shortened

from .errors import BusError, FrameError

ONE = 1 << 24  # counts per unit of a Q24 number
RESOLUTION = 1 / ONE  # [unit of the value]
LOWEST, HIGHEST = -(1 << 31), (1 << 31) - 1  # [counts]
COMMAND, REFERENCE, STATUS, INDEX = 0x000, 0x005, 0x010, 0x060  # identifiers
WORDS = struct.Struct(">ii")
INDEXED = struct.Struct(">iB")
BUS_OFF = 0x40  # [1], error class of linux/can/error.h in an error frame's identifier


class Quantity(Enum):
    """Quantity that a pair of numbers, one per motor, measures; value: identifier."""

    CURRENT = 0x020  # [A]
    POSITION = 0x030  # [rev] of the motor
    VELOCITY = 0x040  # [krpm]
    ANALOGUE = 0x050  # [1]


class Command(IntEnum):
    """Command codes of a board; comments give the value of the command."""

    ENABLE_SYSTEM = 1  # 0 or 1
    ENABLE_MOTOR_1 = 2  # 0 or 1
    ENABLE_MOTOR_2 = 3  # 0 or 1
    ENABLE_SPRING_1 = 4  # 0 or 1
    ENABLE_SPRING_2 = 5  # 0 or 1
    SEND_CURRENT = 12  # 0 or 1, as are all that follow but the time-out
    SEND_POSITION = 13
    SEND_VELOCITY = 14
    SEND_ANALOGUE = 15
    SEND_INDEX = 16
    SEND_ALL = 20
    RECEIVE_TIMEOUT = 30  # [ms], 0: never
    ROLLOVER_ERROR = 31


class Fault(IntEnum):
    """Error codes with which a board switches itself off."""

    NONE = 0
    ENCODER = 1
    RECEIVE_TIMEOUT = 2
    TEMPERATURE = 3
    POSITION_CONVERTER = 4
    POSITION_ROLLOVER = 5
    INVALID = 6
    OTHER = 7


@dataclass(frozen=True)
class Status:
    """The flags of a board: enabled, aligned (ready), and why it switched off."""

    system_enabled: bool
    motor_enabled: tuple[bool, bool]
    motor_ready: tuple[bool, bool]
    fault: Fault


@dataclass(frozen=True)
class Pair:
    """One number per motor: [A], [rev], [krpm] or [1] by its quantity."""

    quantity: Quantity
    values: tuple[float, float]


@dataclass(frozen=True)
class EncoderIndex:
    """The position [rev] at which the index of motor 0 or 1 passed."""

    position: float
    motor: int


@dataclass(frozen=True)
class Order:
    """A command with its value."""

    command: Command
    value: int


@dataclass(frozen=True)
class Reference:
    """The currents that both motors are to have [A]."""

    values: tuple[float, float]


Content = Status | Pair | EncoderIndex | Order | Reference


def to_q24(value: float) -> int:
    """Return the counts of a value: rounded (as documented), saturated at +-128.

    Raises FrameError unless it is a finite number.
    """
    if not math.isfinite(as_number(value)):
        expected, fix = "a finite number", "check how the value was computed"
        got = shortened(value, most=80)
        raise FrameError(
            "no Q24 number", where="value", got=got, expected=expected, next=fix
        )
    return min(max(round(value * ONE), LOWEST), HIGHEST)


def from_q24(counts: int) -> float:
    """Return the value of a number of counts, exactly."""
    return counts / ONE


def encode(content: Content, timestamp: float = 0.0) -> can.Message:
    """Return the frame of this content, stamped [s]; the inverse of `decode`."""
    match content:
        case Order(command, value):
            truth = isinstance(value, bool | np.bool_)
            if truth or as_number(value).is_integer():
                value = int(value)
            check_whole("value (int32)", value, LOWEST, HIGHEST, FrameError)
            identifier, data = COMMAND, WORDS.pack(value, command)
        case Reference(values):
            identifier, data = REFERENCE, WORDS.pack(*map(to_q24, values))
        case Pair(quantity, values):
            identifier, data = quantity.value, WORDS.pack(*map(to_q24, values))
        case EncoderIndex(position, motor):
            identifier, data = INDEX, INDEXED.pack(to_q24(position), motor)
        case Status():
            motors = zip(content.motor_enabled, content.motor_ready, strict=True)
            flags = content.system_enabled, *chain(*motors)
            byte = sum(flag << bit for bit, flag in enumerate(flags))
            identifier, data = STATUS, bytes([byte | content.fault << 5])
        case _:
            raise FrameError(
                "cannot be sent", where="content", got=repr(content),
                expected="a content that this module declares",
            )  # fmt: skip
    return can.Message(
        timestamp=timestamp, arbitration_id=identifier, data=data, is_extended_id=False
    )


def encode_command(command: Command, value: int) -> can.Message:
    """Return the frame of a command: value in the low word, not Q24."""
    known = [int(c) for c in Command]
    check_one_of("command", command, known, "no command", FrameError)
    return encode(Order(Command(command), value))


def encode_current(motor_1: float, motor_2: float) -> can.Message:
    """Return the frame that sets both current references [A]."""
    return encode(Reference((motor_1, motor_2)))


def decode(message: can.Message) -> Content | None:
    """Return the content of a frame, None if it is not of a motor board.

    Raises BusError for an error frame that says that the bus is off, and FrameError for
    a frame of a board with a wrong length or content.  Other error frames, such as
    "restarted", are no loss of the bus.
    """
    if message.is_error_frame:
        if not message.arbitration_id & BUS_OFF:
            return None
        raise BusError(
            "the bus is off",
            where=f"CAN {message.channel or ''}".strip(),
            got=f"error class 0x{message.arbitration_id:03X}",
            next="check wiring, termination and bit rate; then restart the interface",
        )
    if message.is_extended_id or message.is_remote_frame or message.is_fd:
        return None
    identifier, data = message.arbitration_id, bytes(message.data)
    if identifier == STATUS:
        return _status(*_sized(identifier, data, struct.Struct("B")))
    if identifier == INDEX:
        counts, motor = _sized(identifier, data, INDEXED)
        if motor > 1:
            raise _bad(identifier, f"motor {motor}", "motor 0 or 1")
        return EncoderIndex(from_q24(counts), motor)
    if identifier == COMMAND:
        value, code = _sized(identifier, data, WORDS)
        try:
            return Order(Command(code), value)
        except ValueError as bad:
            known = f"one of {[int(c) for c in Command]}"
            raise _bad(identifier, f"command {code}", known) from bad
    if identifier == REFERENCE:
        first, second = _sized(identifier, data, WORDS)
        return Reference((from_q24(first), from_q24(second)))
    if identifier in QUANTITIES:
        first, second = _sized(identifier, data, WORDS)
        return Pair(QUANTITIES[identifier], (from_q24(first), from_q24(second)))
    return None


QUANTITIES = {quantity.value: quantity for quantity in Quantity}


def _sized(identifier: int, data: bytes, layout: struct.Struct) -> tuple:
    """Unpack by the length of the data: slcan keeps the code of a truncated line."""
    if len(data) != layout.size:
        raise _bad(identifier, f"{len(data)} bytes", f"{layout.size} bytes")
    return layout.unpack(data)


def _status(byte: int) -> Status:
    flag = [bool(byte >> bit & 1) for bit in range(5)]
    enabled, ready = (flag[1], flag[3]), (flag[2], flag[4])
    return Status(flag[0], enabled, ready, Fault(byte >> 5))


def _bad(identifier: int, got: str, expected: str) -> FrameError:
    where, fix = f"CAN 0x{identifier:03X}", "check for another device on this bus"
    return FrameError("bad frame", where=where, got=got, expected=expected, next=fix)
