"""Open a CAN bus of python-can, and read what waits on it without waiting.

What the back ends raise differs: a missing SocketCAN interface a bare OSError, a
garbled line of slcan a ValueError or IndexError, bytes that are no text a
CanOperationError after which the line stays in the buffer until it is flushed.  Here it
becomes one of two: a BusError where the bus is gone, a call of `on_error` where one
frame is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import can

from .clock import WallStamps
from .errors import BusError

POLL_LIMIT = 4096  # [frames] read in one go: a babbling bus must not hang the caller
GARBLED = (ValueError, IndexError)


def open_bus(config: Mapping, name: str) -> can.BusABC:
    """Open a bus by python-can's ordinary configuration; raises BusError."""
    try:
        return can.Bus(**config)
    except (can.CanError, OSError, ValueError, TypeError) as bad:
        raise BusError(
            "cannot be opened",
            where=name,
            got=f"{type(bad).__name__}: {bad}",
            next="check interface and channel of python-can; is the link up?",
        ) from bad


def waiting(
    bus: can.BusABC,
    name: str,
    on_error: Callable[[Exception], None],
    stamps: WallStamps,
) -> list[can.Message]:
    """Return the frames that wait, stamped by the clock of the run.

    Raises BusError where the bus is gone and nothing was read before.
    """
    messages: list[can.Message] = []
    try:
        for message in _read(bus, name, on_error):
            messages.append(message)
    except BusError as bad:
        if not messages:
            raise
        on_error(bad)  # a bus that is gone raises again at the next reading
    stamps.look()
    for message in messages:
        message.timestamp = stamps(message.timestamp)
    return messages


def _read(
    bus: can.BusABC, name: str, on_error: Callable[[Exception], None]
) -> Iterator[can.Message]:
    """Yield the frames that wait; raises BusError where the bus is gone.

    Not by `bus.recv(timeout=0)`: it measures its time-out by the wall clock, and blocks
    for as long as that clock is set back meanwhile.
    """
    for _ in range(POLL_LIMIT):
        try:
            message, filtered = bus._recv_internal(timeout=0)
        except (can.CanError, OSError) as bad:
            if not isinstance(bad.__cause__, UnicodeDecodeError):
                raise lost("read", name, bad) from bad
            bus.flush()
            on_error(bad)
        except GARBLED as bad:
            on_error(bad)
        else:
            if message is None:
                return
            if filtered or bus._matches_filters(message):
                yield message


def lost(verb: str, name: str, bad: Exception) -> BusError:
    """Return the error of a bus that does not carry any more."""
    got, fix = f"{type(bad).__name__}: {bad}", "is the adapter still plugged in?"
    return BusError(f"cannot {verb}", where=name, got=got, next=fix)
