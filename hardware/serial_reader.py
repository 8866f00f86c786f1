"""Read a tactile sensor on a serial line or on CAN; reconnect after an unplug."""

from __future__ import annotations

import logging
from collections.abc import Callable

import can
import serial

from . import serial_tactile as codec
from .can_bus import close_bus, open_bus, waiting
from .clock import Clock, WallStamps
from .reader import FIRST_WAIT, QUEUE, Inbox, Reader

log = logging.getLogger(__name__)
READ_TIME = 0.02  # [s] that a read waits for a first byte
LOST = serial.SerialException, OSError  # either is raised when a port disappears


class SerialTactile(Reader):
    """Read a port in a thread; `with` opens it and does not wait for the sensor.

    url:       "/dev/ttyACM0", or another port of pyserial
    framer:    splits the bytes into frames, and counts them
    baudrate:  [Bd], None: that of the framer's sensor
    configure: bytes sent whenever the port is opened, e.g. `encode_configuration`
    sink:      called with every chunk and its time, to record it

    A lost port is opened again after 0.05 s, then after twice as long each time up to
    2 s.  `opened` counts the successes; `check` raises while the port is lost.
    """

    def __init__(
        self,
        url: str,
        framer: codec.OptoForceFramer | codec.AnySkinFramer,
        *,
        baudrate: int | None = None,
        name: str = "sensor",
        configure: bytes = b"",
        sink: Callable[[bytes, float], None] | None = None,
        clock: Clock | None = None,
    ) -> None:
        super().__init__(name, clock)
        self.url, self.framer = url, framer
        self.baudrate = framer.baudrate if baudrate is None else baudrate
        self.configure, self.sink = configure, sink
        self.opened = 0

    def _until_lost(self) -> str:
        # names of udev have colons, too: /dev/serial/by-path/pci-0000:00:14.0-usb-0:1
        options = {"exclusive": True} if "://" not in self.url else {}
        options |= {"baudrate": self.baudrate, "timeout": READ_TIME}
        try:
            with serial.serial_for_url(self.url, **options) as port:
                self.framer.reset()
                self.opened += 1
                if self.configure:
                    port.write(self.configure)
                self._wait = FIRST_WAIT
                self._read(port)
        except LOST as bad:
            return f"{type(bad).__name__}: {bad}"
        return "closed"

    def _read(self, port: serial.SerialBase) -> None:
        while not self._leave.is_set():
            chunk = port.read(max(1, port.in_waiting))
            now = self.clock.now()
            if not chunk:
                continue
            if self.sink is not None:
                self.sink(chunk, now)
            if frames := self.framer.feed(chunk):
                self._keep(now, frames)


class OptoForceCan(Inbox, can.Listener):
    """Read an OptoForce sensor on CAN: packets in frames of identifier 0x100.

    config: of python-can.  If an adapter can be opened only once, use this as the sink
    of its MotorBoard: `MotorBoard(..., sink=sensor)`.
    queue: frames that wait to be taken, see Inbox
    """

    def __init__(
        self,
        config: dict | None = None,
        *,
        name: str = "sensor",
        sink: Callable[[can.Message], None] | None = None,
        clock: Clock | None = None,
        queue: int | None = QUEUE,
    ) -> None:
        super().__init__(name, clock, queue)
        self.config, self.sink = config, sink
        self.framer = codec.OptoForceFramer()
        self._bus: can.BusABC | None = None
        self._stamps: WallStamps | None = None

    def __enter__(self) -> OptoForceCan:
        if self.config is not None:
            self._bus = open_bus(self.config, self.name)
            self._stamps = WallStamps(self.clock)
        return super().__enter__()

    def __exit__(self, *exception) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            close_bus(bus, self.name)

    def poll(self) -> None:
        """Read all received frames of the sensor's own bus, if it has one."""
        if self._bus is not None:
            for message in waiting(self._bus, self.name, self.on_error, self._stamps):
                self.on_message_received(message)

    def on_message_received(self, msg: can.Message) -> None:
        """Process one frame; an error frame of class 0x100 is not of the sensor."""
        if self.sink is not None:
            self.sink(msg)
        foreign = msg.is_error_frame or msg.is_extended_id or msg.is_remote_frame
        if foreign or msg.arbitration_id != codec.DATA_ID:
            return
        if frames := self.framer.feed(bytes(msg.data)):
            self._keep(msg.timestamp, frames, self.clock.now())

    def on_error(self, exc: Exception) -> None:
        """Count a frame that could not be read."""
        self.framer.broken += 1
        log.debug("%s: %s", self.name, exc)

    def take(self) -> list[tuple[float, object]]:
        """Return the frames since the last call, each with its stamp [s]."""
        self.poll()
        return super().take()
