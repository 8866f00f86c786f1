"""Refuse the state of a motor board, and commands beyond its bounds."""

from __future__ import annotations

from tactilenlp.common.validation import as_number, check_range
from tactilenlp.errors import shortened

from .errors import BoardError, LimitError
from .motor_can import Fault, Order, Reference, Status

LARGEST_CURRENT = 2.2  # [A] of TriFingerPro: no bound may be larger
LONGEST_TIMEOUT = 10.0  # [s]


def check_state(
    name: str, status: Status | None, order: Order | Reference | None, off: bool
) -> None:
    """Raise BoardError for what a board may not report while it is used.

    order: a command of another master on its bus
    off:   whether it was ready, and is so no longer
    """
    if status is not None and status.fault is not Fault.NONE:
        fix = "remove the cause of the fault, then start the board again"
        what, got = "switched itself off", status.fault.name
    elif order is not None:
        fix = "end the other program that commands the robot"
        what, got = "is commanded by another master", repr(order)
    elif off:
        fix = "check the motor supply, and that no other program commands the board"
        what, got = "is not enabled any more", repr(status)
    else:
        return
    raise BoardError(what, where=name, got=got, next=fix)


def check_current(bound: float, name: str) -> None:
    """Raise LimitError unless this may bound the currents [A] of a board."""
    check_range(f"{name}, max_current", bound, 0.0, LARGEST_CURRENT, "A", LimitError)


def check_command(name: str, current: object, most: float) -> None:
    """Raise LimitError unless a current [A] is a number within its bound."""
    if not abs(as_number(current)) <= most:
        raise LimitError(
            "too much current",
            where=name,
            got=f"{shortened(current, str, 80)} A",
            expected=f"at most {most} A",
            next="bound the torque from which the current is computed",
        )


def milliseconds(name: str, timeout: float) -> int:
    """Return a time-out [s] in ms; one that rounds to 0 (never) is refused."""
    least = 0.0 if timeout == 0 else 1e-3
    check_range(
        f"{name}, time-out", timeout, least, LONGEST_TIMEOUT, "s (0: never)", LimitError
    )
    return round(1e3 * timeout)
