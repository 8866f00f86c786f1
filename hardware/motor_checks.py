"""Refuse the state of a motor board: a fault, silence."""

from __future__ import annotations

from .errors import BoardError, StaleStreamError
from .motor_can import Fault, Status


def check_fault(name: str, status: Status | None) -> None:
    """Raise BoardError where a board reports a fault."""
    if status is not None and status.fault is not Fault.NONE:
        fix = "remove the cause of the fault, then start the board again"
        told = {"where": name, "got": status.fault.name, "next": fix}
        raise BoardError("switched itself off", **told)


def check_heard(name: str, stream: str, age: float, limit: float) -> None:
    """Raise StaleStreamError where a stream is silent for longer than the limit [s]."""
    if not age <= limit:
        raise silent(name, stream, f"silence for {age:.3f} s", limit)


def silent(name: str, stream: str, got: str, limit: float) -> StaleStreamError:
    """Return the error of a stream of which one sample every `limit` [s] is heard."""
    return StaleStreamError(
        f"no {stream.lower()} is heard",
        where=name,
        got=got,
        expected=f"one every {limit} s",
        next="check the power, the bus, and that the board is told to send",
    )
