"""Open a CAN bus of python-can, and read it without blocking.

The back ends raise different errors: OSError for a missing SocketCAN interface,
ValueError or IndexError for a garbled line of slcan, CanOperationError for bytes that
are not text, after which the line stays in the buffer until it is flushed.  Here there
are two cases: a BusError if the bus is lost, a call of `on_error` if a frame is lost.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager

import can

from .clock import WallStamps
from .errors import BusError, translated

log = logging.getLogger(__name__)
POLL_LIMIT = 4096  # [frames] per reading: a flooded bus must not block the caller
GARBLED = (ValueError, IndexError)


def open_bus(config: Mapping, name: str) -> can.BusABC:
    """Open a bus from a configuration of python-can; raises BusError."""
    fix = "check interface and channel of python-can, and that the link is up"
    with translated(BusError, "cannot be opened", name, fix):  # a driver may lack
        bus = can.Bus(**config)
    if (port := getattr(bus, "serialPortOrig", None)) is not None:
        port.flush = lambda: None  # slcan waits there, for ever if the adapter hangs
    return bus


def close_bus(bus: can.BusABC, name: str) -> None:
    """Close a bus; log its errors."""
    quietly(bus.shutdown, name)
    if (port := getattr(bus, "serialPortOrig", None)) is not None:
        quietly(port.close, name)  # slcan leaves it open if it cannot say goodbye


def waiting(
    bus: can.BusABC,
    name: str,
    on_error: Callable[[Exception], None],
    stamps: WallStamps,
) -> list[can.Message]:
    """Return all received frames, stamped by the clock of the run.

    Raises BusError if the bus is lost and no frame was received before.
    """
    messages: list[can.Message] = []
    try:
        with unless_lost("cannot read", name):
            for message in _read(bus, on_error):
                messages.append(message)
    except BusError as bad:
        if not messages:
            raise
        on_error(bad)  # a bus that is lost raises again at the next reading
    stamps.look(all_read=len(messages) < POLL_LIMIT)
    for message in messages:
        message.timestamp = stamps(message.timestamp)
    return messages


def _read(
    bus: can.BusABC, on_error: Callable[[Exception], None]
) -> Iterator[can.Message]:
    """Yield the received frames.

    Not by `bus.recv(timeout=0)`: it measures its time-out by the wall clock, and blocks
    for as long as that clock is set back meanwhile.
    """
    for _ in range(POLL_LIMIT):
        try:
            message, filtered = bus._recv_internal(timeout=0)
        except (can.CanError, OSError) as bad:
            if not isinstance(bad.__cause__, UnicodeDecodeError):
                raise
            bus.flush()
            on_error(bad)
        except GARBLED as bad:
            on_error(bad)
        else:
            if message is None:
                return
            if filtered or bus._matches_filters(message):
                yield message


def unless_lost(what: str, name: str) -> AbstractContextManager:
    """Return a block that raises BusError where the bus is lost."""
    fix = "check that the adapter is plugged in"
    return translated(BusError, what, name, fix, (can.CanError, OSError))


def quietly(action: Callable[[], None], name: str) -> None:
    """Run an action that ends something; log its error, so that the next ones run.

    Any error, of a sink that records it too: all boards must be stopped.
    """
    try:
        action()
    except Exception as bad:
        log.warning("%s: while stopping: %s", name, bad)
