"""Send a recording again at the recorded times: CAN to buses, bytes to terminals.

These wires replace a robot.  What programs sent, commands of motors for instance, is
not sent: it would move a robot on the same bus.  Nor are pictures, as a pseudo-terminal
is not a camera; `Recording.pictures` reads them.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import replace
from functools import partial
from operator import itemgetter

import can

from tactilenlp.common.validation import check_range

from .can_bus import open_bus, unless_lost
from .clock import Clock, HostClock
from .errors import HardwareError
from .motor_can import COMMAND, REFERENCE
from .recording import Recording
from .rig import CAMERA, ON_CAN, Rig, stream_name
from .serial_tactile import CONFIG_ID

CHANNELS = "239.74.163.{}"  # multicast addresses that are not assigned
REPLAY_SPEEDS = 1e-6, 1000.0  # [1], as fast as recorded
ORDERS = {COMMAND, REFERENCE, CONFIG_ID}  # identifiers of what no device sends
Event = tuple[float, Callable[[], None]]  # when [s], and what sends it


class Replay(AbstractContextManager):
    """Open the wires of a replay; `rig` describes them, `run` sends.

    recording: what to send
    config:    of python-can for a bus, by its number; None: UDP multicast, which other
               processes of this computer receive without any set-up
    """

    def __init__(
        self,
        recording: Recording,
        config: Callable[[int], dict] | None = None,
        clock: Clock | None = None,
    ) -> None:
        self.recording, self.clock = recording, clock or HostClock()
        self._config = config or _multicast
        self._stack = ExitStack()
        self._events: list[Iterator[Event]] = []
        self.rig: Rig | None = None

    def __enter__(self) -> Replay:
        with ExitStack() as stack:
            number = iter(range(1, 255))
            fingers = []
            for one in self.recording.rig.fingers:
                boards = []
                for k in range(2):
                    config = self._config(next(number))
                    self._can(stack, config, stream_name(one.name, f"board {k}"))
                    boards.append(config)
                tactile, stream = one.tactile, stream_name(one.name, "tactile")
                if tactile.wire == ON_CAN:
                    config = self._config(next(number))
                    self._can(stack, config, stream)
                    tactile = replace(tactile, can=config)
                elif tactile.wire != CAMERA:
                    tactile = replace(tactile, source=self._serial(stack, stream))
                boards = tuple(boards)
                fingers.append(replace(one, boards=boards, tactile=tactile))
            self.rig = Rig(tuple(fingers))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exception) -> None:
        self._stack.__exit__(*exception)

    def run(self, speed: float = 1.0) -> int:
        """Send all frames and chunks in order of time; return their number.

        speed: [1], 2 is twice as fast as recorded.
        """
        check_range("speed", speed, *REPLAY_SPEEDS, "", HardwareError)
        begin, first, count = self.clock.now(), None, 0
        for time, send in heapq.merge(*self._events, key=itemgetter(0)):
            first = time if first is None else first
            due = begin + (time - first) / speed
            if (wait := due - self.clock.now()) > 0:
                self.clock.sleep(wait)
            send()
            count += 1
        return count

    def _can(self, stack: ExitStack, config: dict, stream: str) -> None:
        bus = stack.enter_context(open_bus(config, stream))

        def send(message):
            with unless_lost("cannot write", stream):
                bus.send(message)

        self._events.append(
            (message.timestamp, partial(send, message))
            for message in self.recording.messages(stream)
            if _of_device(message)
        )

    def _serial(self, stack: ExitStack, stream: str) -> str:
        """Open a pseudo-terminal, add its chunks to the events, return its name."""
        try:
            import tty  # not on Windows
        except ImportError as bad:
            raise HardwareError(
                "serial bytes cannot be sent", where=stream, got=f"{bad}",
                expected="a system with pseudo-terminals",
                next="replay on Linux or macOS, or a recording of sensors on CAN",
            ) from bad  # fmt: skip
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        stack.callback(os.close, ours)
        stack.callback(os.close, theirs)
        chunks = self.recording.chunks(stream)
        self._events.append((t, partial(_write, ours, chunk)) for t, chunk in chunks)
        return os.ttyname(theirs)


def _of_device(message: can.Message) -> bool:
    """Return whether a device sent this frame, not a program."""
    order = message.arbitration_id in ORDERS and not message.is_extended_id
    return message.is_rx is not False and not message.is_error_frame and not order


def _write(terminal: int, chunk: bytes) -> None:
    """Write without blocking; bytes that no program reads are dropped, as on a wire."""
    os.set_blocking(terminal, False)
    with suppress(BlockingIOError):
        os.write(terminal, chunk)


def _multicast(number: int) -> dict:
    return {"interface": "udp_multicast", "channel": CHANNELS.format(number)}
