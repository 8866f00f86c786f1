"""Read one motor board on one CAN bus and, if enabled, command it.

The firmware disables a board that receives nothing for its receive time-out while a
motor has a current.  This also stops the motors if this program fails.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping

import can
import numpy as np

from tactilenlp.common.validation import check_kind
from tactilenlp.errors import typed_call

from . import motor_can as codec
from . import motor_checks as checks
from .can_bus import close_bus, open_bus, unless_lost, waiting
from .clock import Clock, HostClock, WallStamps
from .errors import BoardError, BusError, HardwareError, RigError
from .motor_can import Command, Content, Fault, Pair, Status
from .motor_samples import CONNECT, MotorSamples
from .motor_stop import stop_boards
from .ranges import check_age

log = logging.getLogger(__name__)
STALE = 0.1  # [s] without a position: 100 frames of a healthy board
STATUS_STALE = 3.0  # [s] without a status: three of a healthy board
MAX_CURRENT = 2.0  # [A] of TriFingerEdu
SEND_TIME = 0.01  # [s] that an adapter may take to accept a frame
RECEIVE_TIMEOUT = 0.1  # [s] after which the firmware switches off
SENT = 64  # commands whose echo is known: 0.25 s of them
INDICES = 1000  # events of the encoder index that are kept


@typed_call(RigError)
class MotorBoard(MotorSamples, can.Listener):
    """Hold the state of a board; `with` opens the bus and ends with zero current.

    A board that was neither started nor commanded gets nothing at the end.

    config:      of python-can, e.g. {"interface": "socketcan", "channel": "can0"}
    name:        for messages, e.g. "finger 0, board 1"
    listen_only: never send anything.  A board sends positions only when told to: the
                 program that commands the robot told it
    max_current: [A], beyond it `command` refuses
    sink:        called with every frame that comes or goes, to record it
    clock:       by which the age of a stream is measured
    remember:    keep all samples for `series`; otherwise, as after `forget`, only the
                 newest one of each quantity, so that memory does not grow

    Read with `poll()`, or by `can.Notifier(board.bus, [board])`.  `broken` counts
    frames that could not be decoded, `errors` error frames, of which `check` raises
    bus-off; `faults` holds all that the board reported.
    `poll` maps stamps of the wall clock to `clock`; frames of a Notifier keep theirs.
    """

    def __init__(
        self,
        config: Mapping,
        *,
        name: str = "board",
        listen_only: bool = True,
        max_current: float = MAX_CURRENT,
        sink: Callable[[can.Message], None] | None = None,
        clock: Clock | None = None,
        remember: bool = True,
    ) -> None:
        check_kind("MotorBoard.name", name, str, RigError)
        check_kind(f"{name}, config", config, Mapping, RigError)
        checks.check_current(max_current, name)
        super().__init__(name, remember)
        self.config, self.listen_only = dict(config), listen_only
        self.max_current, self.sink = max_current, sink
        self.clock = clock or HostClock()
        self.driving = False  # from `start` to `stop`
        self.driven = False  # whether it was started or commanded
        self.status: Status | None = None
        self.broken = self.errors = self.foreign = 0
        self.faults: set[Fault] = set()
        self.index: deque[tuple[float, codec.EncoderIndex]] = deque(maxlen=INDICES)
        self._bus: can.BusABC | None = None
        self._stamps: WallStamps | None = None
        self._heard: dict[str, float] = {}
        self._bus_error: BusError | None = None
        self._was_ready, self._order = False, None
        self._sent: deque[bytes] = deque(maxlen=SENT)

    def __enter__(self) -> MotorBoard:
        self._bus = open_bus(self.config, self.name)
        self._stamps = WallStamps(self.clock)
        self._heard["opened"] = self.clock.now()
        return self

    def __exit__(self, *exception) -> None:
        try:
            if self.driven:
                self.stop()
        finally:
            if (bus := self._bus) is not None:
                self._bus = None
                close_bus(bus, self.name)

    # Reading

    @property
    def bus(self) -> can.BusABC:
        """The open bus, for a `can.Notifier`; raises BusError outside of `with`."""
        if self._bus is None:
            fix = "use it in a `with` block"
            raise BusError("is not open", where=self.name, next=fix)
        return self._bus

    def poll(self) -> int:
        """Read all received frames without blocking; return their number."""
        messages = waiting(self.bus, self.name, self.on_error, self._stamps)
        now = self.clock.now()
        for message in messages:  # one that waited is as old as its stamp
            self._receive(message, min(message.timestamp, now))
        return len(messages)

    def on_message_received(self, msg: can.Message) -> None:
        """Process one frame, live or recorded; never raises for its content."""
        self._receive(msg, self.clock.now())

    def _receive(self, msg: can.Message, heard: float) -> None:
        """Process one frame, of which the age is counted from `heard` [s]."""
        if self.sink is not None:
            self.sink(msg)
        self.errors += msg.is_error_frame
        try:
            content = codec.decode(msg)
        except BusError as bad:  # bus-off
            self._bus_error = bad
        except HardwareError as bad:
            self.on_error(bad)
        else:
            if not msg.is_error_frame:
                self._take(msg.timestamp, content, heard)
            order = isinstance(content, codec.Order | codec.Reference)
            if order and bytes(msg.data) not in self._sent:  # of which echoes may come
                self._order = content

    def on_error(self, exc: Exception) -> None:
        """Count a frame that could not be read; `check` detects a silent stream."""
        self.broken += 1
        log.debug("%s: %s", self.name, exc)

    def _take(self, stamp: float, content: Content | None, heard: float) -> None:
        match content:
            case Pair(quantity, values):
                self._series[quantity].append((stamp, *values))
                self._heard[quantity.name] = heard
            case Status():
                self.status = content
                self.faults |= {content.fault} - {Fault.NONE}
                self._heard["STATUS"] = heard
                self._was_ready |= self.ready
            case codec.EncoderIndex():
                self.index.append((stamp, content))
            case _:
                self.foreign += 1

    def age(self, stream: str = "POSITION") -> float:
        """Return the age [s] of a stream's newest sample, or since the bus was opened.

        A frame that `poll` read late is as old as its stamp.
        """
        opened = self._heard.get("opened", -np.inf)
        return self.clock.now() - self._heard.get(stream, opened)

    def check(self, stale: float = STALE) -> None:
        """Raise a bus error, a fault of the board, or the error of a silent stream.

        stale: [s], the largest age of a position.  From `start` to `stop` also of a
        velocity; nobody else may command the board then, and it must stay enabled.
        """
        if self._bus_error is not None:
            bad, self._bus_error = self._bus_error, None
            raise bad
        order = self._order if self.driving else None
        off = self.driving and self._was_ready and not self.ready
        checks.check_state(self.name, self.status, order, off)
        self.check_ages(stale, STATUS_STALE)

    def check_ages(self, stale: float, status: float) -> None:
        """Raise the error of a stream that is silent, as `check` does, and no other.

        stale, status: [s], the largest ages of a position and of a status
        """
        limits = {"POSITION": stale, "STATUS": status}
        if self.driving:
            limits["VELOCITY"] = stale
        for stream, limit in limits.items():
            age, what = self.age(stream), f"no {stream.lower()} is heard"
            check_age(self.name, what, age, limit, CONNECT)

    # Driving

    def ask(self) -> None:
        """Tell the board to send all it measures; no motor is enabled."""
        self._send(codec.encode_current(0.0, 0.0))
        self._send(codec.encode_command(Command.SEND_ALL, 1))

    def start(self, timeout: float = 0.0) -> None:
        """Send the documented start sequence: zero current before anything else.

        timeout: [s] of silence after which the firmware switches off, 0: never.  A
        status of before, which may tell of an earlier fault, counts no longer.
        """
        length = checks.milliseconds(self.name, timeout)
        self._send(codec.encode_current(0.0, 0.0))
        self.poll()
        self.status, self._order = None, None
        self._heard |= dict.fromkeys(("STATUS", "VELOCITY"), self.clock.now())
        self._was_ready, self.driving, self.driven = False, True, True
        self._send(codec.encode_command(Command.RECEIVE_TIMEOUT, length))
        for command in (
            *(Command.ENABLE_SYSTEM, Command.SEND_ALL),
            *(Command.ENABLE_MOTOR_1, Command.ENABLE_MOTOR_2),
        ):
            self._send(codec.encode_command(command, 1))

    @property
    def ready(self) -> bool:
        """Whether both motors are enabled and aligned."""
        if (status := self.status) is None:
            return False
        return status.system_enabled and all(status.motor_enabled + status.motor_ready)

    def watch(self, timeout: float = RECEIVE_TIMEOUT) -> None:
        """Set the receive time-out [s] of the firmware."""
        length = checks.milliseconds(self.name, timeout)
        self._send(codec.encode_command(Command.RECEIVE_TIMEOUT, length))

    def command(self, motor_1: float, motor_2: float) -> None:
        """Set both current references [A]; raises LimitError beyond `max_current`."""
        self.check_currents(motor_1, motor_2)
        self.driven = True
        self._send(codec.encode_current(motor_1, motor_2))

    def check_currents(self, *currents: float) -> None:
        """Raise LimitError unless all currents [A] may be commanded; sends nothing."""
        for current in currents:
            checks.check_command(self.name, current, self.max_current)

    def stop(self) -> None:
        """Command zero current first, then disable; can be called at any time, twice.

        Errors are logged and not raised.  Sends nothing if listen_only.
        """
        stop_boards([self])

    @property
    def sends(self) -> bool:
        """Whether the bus is open, and frames may be sent."""
        return self._bus is not None and not self.listen_only

    def transmit(self, message: can.Message) -> None:
        """Send a frame, stamped, without recording it; raises BusError.

        An adapter that takes no frame for SEND_TIME is lost: the control of the other
        boards must go on.
        """
        if self.listen_only:
            told = {"where": self.name, "next": "open the board with listen_only=False"}
            raise BoardError("only listens", **told)
        message.timestamp = self.clock.now()
        self._sent.append(bytes(message.data))
        with unless_lost("cannot write", self.name):
            self.bus.send(message, SEND_TIME)

    def record(self, message: can.Message) -> None:
        """Give a frame that was sent to the sink."""
        if self.sink is not None:
            message.is_rx = False
            self.sink(message)

    def _send(self, message: can.Message) -> None:
        self.transmit(message)
        self.record(message)
