"""Split the byte streams of tactile sensors into frames, without I/O.

OptoForce OMD, big-endian, 16 bytes, on a serial line (1 Mbaud) as on CAN (0x100):

    AA 07 08 0A | counter u16 | status u16 | Fx Fy Fz i16 [counts] | sum u16

AnySkin and ReSkin, little-endian, no header, no checksum, no time:

    t x y z f32 per magnetometer [deg C, uT] | CR LF

A framer takes chunks of any size, returns the good frames that they complete, and
synchronises again after damaged bytes.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import NamedTuple

import can
import numpy as np

from tactilenlp.common.validation import check_kind, check_one_of, check_whole

from .errors import FrameError

HEADER = bytes.fromhex("AA07080A")
PACKET = struct.Struct(">4sHHhhhH")
CONFIGURE = bytes.fromhex("AA003203")
DATA_ID, CONFIG_ID = 0x100, 0x101  # identifiers on CAN
SPEEDS = {0: 0, 1000: 1, 333: 3, 100: 10, 30: 33, 10: 100}  # [Hz] -> period [ms]
FILTERS = {0: 0, 500: 1, 150: 2, 50: 3, 15: 4, 5: 5, 1.5: 6}  # [Hz] -> code
WRAP = 1 << 16  # counts of the sample counter
RESTART = WRAP // 2  # a larger gap is a restart of the sensor
DELIMITER = b"\r\n"
MOST_CHIPS = 1000  # magnetometers of one skin
WORD = 4  # [bytes] of a float32; four words a magnetometer


class ForceFrame(NamedTuple):
    """One sample of an OptoForce sensor.

    counter: [1], samples modulo 65536
    status:  bits 0-2 sensor, 4-9 overload, 10-12 sensor error, 13-15 error of the unit
    counts:  (Fx, Fy, Fz), the force on the sensor; z points out of the dome's top
    """

    counter: int
    status: int
    counts: tuple[int, int, int]

    @property
    def fault(self) -> bool:
        """Whether sensor or unit report an error; overload is none."""
        return self.status >> 10 != 0

    @property
    def overload(self) -> bool:
        """Whether a force is beyond its range."""
        return self.status >> 4 & 0x3F != 0


@dataclass(frozen=True, eq=False, slots=True)
class FieldFrame:
    """One sample of a magnetic skin: (M,) [deg C] and (M, 3) [uT] of M chips."""

    temperature: np.ndarray
    field: np.ndarray


class OptoForceFramer:
    """Find OptoForce packets; `good`, `broken` (bad checksum) and `lost` count them.

    `lost` are samples that the counter skips, `skipped` are bytes outside packets.  A
    good packet with the counter of the one before is no new sample: it is not returned,
    and counted in `repeated`.
    """

    baudrate = 1_000_000  # [Bd]

    def __init__(self) -> None:
        self.good = self.broken = self.lost = self.skipped = self.repeated = 0
        self._buffer = bytearray()
        self._last: int | None = None

    def feed(self, chunk: bytes) -> list[ForceFrame]:
        """Return the good frames that this chunk completes."""
        buffer, frames = self._buffer, []
        buffer += chunk
        at = 0
        while (start := buffer.find(HEADER, at)) >= 0:
            self.skipped += start - at
            at = start
            if len(buffer) - start < PACKET.size:
                break
            frame = self._frame(bytes(buffer[start : start + PACKET.size]))
            if frame is None:  # the next packet may begin inside
                at += 1
                self.skipped += 1
            else:
                at += PACKET.size
                if frame.counter != self._last:
                    frames.append(frame)
                self._count(frame.counter)
        else:
            keep = max(at, len(buffer) - len(HEADER) + 1)
            self.skipped += keep - at
            at = keep
        del buffer[:at]
        return frames

    def reset(self) -> None:
        """Drop the bytes of an incomplete packet, after a lost connection."""
        self._buffer.clear()

    def _frame(self, packet: bytes) -> ForceFrame | None:
        _, counter, status, *counts, told = PACKET.unpack(packet)
        if sum(packet[:-2]) % WRAP != told:
            self.broken += 1
            return None
        self.good += 1
        return ForceFrame(counter, status, tuple(counts))

    def _count(self, counter: int) -> None:
        """Count samples that were lost before this one, or that it is no new one."""
        last, self._last = self._last, counter
        if counter == last:
            self.repeated += 1
        elif last is not None:
            gap = (counter - last - 1) % WRAP
            self.lost += gap if gap < RESTART else 0


class AnySkinFramer:
    """Find frames of AnySkin or ReSkin between two delimiters one frame apart.

    One random frame in a thousand contains CR LF, hence two of them; the first frame of
    a stream is not used, as its start is not marked.  `broken` counts losses of
    synchronisation and frames that are not finite; lost frames cannot be counted, and
    `lost` stays 0.
    """

    baudrate = 115_200  # [Bd]

    def __init__(self, magnetometers: int = 5) -> None:
        check_whole("magnetometers", magnetometers, 1, MOST_CHIPS, FrameError)
        self.good = self.broken = self.lost = self.skipped = 0
        size = 4 * WORD * magnetometers
        pattern = rb"%b(.{%d})(?=%b)" % (DELIMITER, size, DELIMITER)
        self._whole = re.compile(pattern, re.DOTALL)
        self._most = size + 2 * len(DELIMITER) - 1  # [bytes] in which no frame is whole
        self._buffer = bytearray()
        self._in_step = False

    def feed(self, chunk: bytes) -> list[FieldFrame]:
        """Return the good frames that this chunk completes."""
        self._buffer += chunk
        frames, at = [], 0
        while found := self._whole.search(self._buffer, at):
            self._skip(found.start() - at)
            frames.append(self._frame(found[1]))
            at, self._in_step = found.end(), True
        rest = max(at, len(self._buffer) - self._most)
        self._skip(rest - at)
        del self._buffer[:rest]
        return [frame for frame in frames if frame is not None]

    def reset(self) -> None:
        """Drop the bytes of an incomplete frame, after a lost connection."""
        self._buffer.clear()
        self._in_step = False

    def _skip(self, count: int) -> None:
        """Count bytes outside of frames, and that the framer lost its step there."""
        self.skipped += count
        if count and self._in_step:
            self.broken, self._in_step = self.broken + 1, False

    def _frame(self, payload: bytes) -> FieldFrame | None:
        words = np.frombuffer(payload, "<f4").reshape(-1, 4)
        if not np.isfinite(words).all():  # before the cast: some NaNs make it warn
            self.broken += 1
            return None
        self.good += 1
        words = words.astype(float)
        return FieldFrame(words[:, 0], words[:, 1:])


def encode_force(frame: ForceFrame) -> bytes:
    """Return the packet (16 bytes) of an OptoForce sample; simulated sensors use it."""
    body = PACKET.pack(HEADER, frame.counter, frame.status, *frame.counts, 0)[:-2]
    return body + (sum(body) % WRAP).to_bytes(2, "big")


def encode_field(frame: FieldFrame) -> bytes:
    """Return the bytes of a sample of a magnetic skin, with its delimiter."""
    words = np.column_stack([frame.temperature, frame.field])
    return words.astype("<f4").tobytes() + DELIMITER


def encode_configuration(
    speed: int = 1000, filter: float = 0, zero: bool = False
) -> bytes:
    """Return the packet (9 bytes) that sets rate [Hz], low-pass [Hz] and zero.

    speed:  0 (stop), 10, 30, 100, 333 or 1000 Hz
    filter: 0 (none), 1.5, 5, 15, 50, 150 or 500 Hz
    """
    for name, value, known in (("speed", speed, SPEEDS), ("filter", filter, FILTERS)):
        check_one_of(name, value, sorted(known), "no such rate", FrameError, "Hz")
    check_kind("zero", zero, bool, FrameError)
    codes = bytes([SPEEDS[speed], FILTERS[filter], 255 if zero else 0])
    return CONFIGURE + codes + sum(CONFIGURE + codes).to_bytes(2, "big")


def to_can(packet: bytes, identifier: int, timestamp: float = 0.0) -> list[can.Message]:
    """Return the frames of at most 8 bytes that carry a packet over CAN."""
    return [
        can.Message(
            timestamp=timestamp,
            arbitration_id=identifier,
            data=packet[k : k + 8],
            is_extended_id=False,
        )
        for k in range(0, len(packet), 8)
    ]
