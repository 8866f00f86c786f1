"""Simulate the firmware of a motor board on a CAN bus.

Streams are off until they are requested, a status is sent every second, motors align
for a while after they are first enabled, and silence beyond the receive time-out
disables the system while an enabled motor has a current.
"""

from __future__ import annotations

from collections.abc import Mapping

import can
import numpy as np

from .errors import FrameError
from .motor_can import (
    Command,
    Content,
    Fault,
    Order,
    Pair,
    Quantity,
    Reference,
    Status,
    decode,
    encode,
)

STATUS_PERIOD = 1.0  # [s] of the firmware
STREAMS = {Command[f"SEND_{one.name}"]: one for one in Quantity}
RECEIVED = 20_000  # commands that are kept at least: 80 s of them
MOTORS = {Command.ENABLE_MOTOR_1: 0, Command.ENABLE_MOTOR_2: 1}


class SimulatedBoard:
    """Simulate the board at the other end of a MotorBoard; `with` opens the bus.

    config:    of python-can, the same channel as the MotorBoard's
    alignment: [s] until a motor that is enabled first is ready
    streams:   quantities it can send; fewer make a faster simulation
    period:    [s] of its status

    `current` (2,) [A] is the current of the motors: the references while they are
    enabled and ready, otherwise zero.  `sending` holds the quantities whose streams are
    switched on.
    """

    def __init__(
        self,
        config: Mapping,
        *,
        alignment: float = 0.05,
        streams: tuple[Quantity, ...] = tuple(Quantity),
        period: float = STATUS_PERIOD,
    ) -> None:
        self.config, self.alignment, self.streams = dict(config), alignment, streams
        self.period = period
        self.system_enabled, self.fault = True, Fault.NONE
        self.reference = np.zeros(2)
        self.received: list[Content] = []
        self.silent = False
        self._enabled = np.zeros(2, bool)
        self._ready_at = np.full(2, np.inf)
        self.sending: set[Quantity] = set()
        self._timeout, self._heard_at = 0.0, 0.0
        self._status_at = -np.inf
        self._now = 0.0
        self._bus: can.BusABC | None = None

    def __enter__(self) -> SimulatedBoard:
        self._bus = can.Bus(**self.config)
        return self

    def __exit__(self, *exception) -> None:
        self._bus.shutdown()

    @property
    def ready(self) -> np.ndarray:
        """Which motors (2,) are aligned."""
        return self._now >= self._ready_at

    @property
    def live(self) -> bool:
        """Whether any current flows."""
        return bool(self.current.any())

    @property
    def current(self) -> np.ndarray:
        """The currents (2,) [A] that flow."""
        flows = self._enabled & self.ready & self.system_enabled
        return np.where(flows, self.reference, 0.0)

    def listen(self, now: float) -> None:
        """Process all received frames; `now` [s]."""
        self._now = now
        while (message := self._bus.recv(timeout=0)) is not None:
            try:
                content = decode(message)
            except FrameError:
                continue  # the firmware ignores unknown frames
            if content is not None:
                self.received.append(content)
                if len(self.received) > 2 * RECEIVED:
                    del self.received[:RECEIVED]
                self._obey(content)
        live = bool((self._enabled & (self.reference != 0)).any())
        if self._timeout and live and now - self._heard_at > self._timeout:
            self.fail(Fault.RECEIVE_TIMEOUT)

    def fail(self, fault: Fault) -> None:
        """Switch the system off, as any fault does, and report it at once."""
        self.system_enabled, self.fault = False, fault
        self._enabled[:] = False
        self._status_at = -np.inf

    def talk(
        self,
        measured: Mapping[Quantity, np.ndarray],
        now: float,
        stamp: float | None = None,
    ) -> None:
        """Send the status if it is due, and each stream (2,) that is switched on.

        stamp: [s] of the wall clock for the frames, None: now.
        """
        stamp = now if stamp is None else stamp
        self._now = now
        if self.silent:
            return
        if now - self._status_at >= self.period:
            self._status_at = now
            self.send(encode(self._status(), stamp))
        for quantity, values in measured.items():
            if quantity in self.sending:
                pair = Pair(quantity, tuple(map(float, values)))
                self.send(encode(pair, stamp))

    def send(self, message: can.Message) -> None:
        """Send any frame, a fault of the bus for instance."""
        self._bus.send(message)

    def _status(self) -> Status:
        enabled, ready = map(bool, self._enabled), map(bool, self.ready)
        return Status(self.system_enabled, tuple(enabled), tuple(ready), self.fault)

    def _obey(self, content: Content) -> None:
        match content:
            case Reference(values):
                self.reference, self._heard_at = np.array(values), self._now
            case Order(command, value) if command in MOTORS:
                self._enable(MOTORS[command], bool(value))
            case Order(Command.ENABLE_SYSTEM, value):
                self.system_enabled, self.fault = bool(value), Fault.NONE
                self._status_at = -np.inf
            case Order(Command.RECEIVE_TIMEOUT, value):
                self._timeout = value / 1000
            case Order(Command.SEND_ALL, value):
                self.sending = set(self.streams) if value else set()
            case Order(command, value) if command in STREAMS:
                change = self.sending.add if value else self.sending.discard
                change(STREAMS[command])

    def _enable(self, motor: int, on: bool) -> None:
        self._enabled[motor] = on and self.system_enabled
        if on and np.isinf(self._ready_at[motor]):
            self._ready_at[motor] = self._now + self.alignment
