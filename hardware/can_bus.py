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
    bus: can.BusABC, name: str, on_error: Callable[[Exception], None]
) -> Iterator[can.Message]:
    """Yield the frames that wait; raises BusError where the bus is gone."""
    for _ in range(POLL_LIMIT):
        try:
            message = bus.recv(timeout=0)
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
            yield message


def lost(verb: str, name: str, bad: Exception) -> BusError:
    """Return the error of a bus that does not carry any more."""
    got, fix = f"{type(bad).__name__}: {bad}", "is the adapter still plugged in?"
    return BusError(f"cannot {verb}", where=name, got=got, next=fix)
