"""Errors of the bench: what, where, got, expected, next."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from tactilenlp.errors import TactileError

if TYPE_CHECKING:
    from collections.abc import Iterator


class HardwareError(TactileError):
    """Base class of all errors of the bench."""


class FrameError(HardwareError, ValueError):
    """A frame, packet or picture does not have the format that it should have."""


class BusError(HardwareError):
    """A bus, serial line or camera cannot be opened, or is lost."""


class BoardError(HardwareError):
    """A motor board reports a fault, or does not follow a command."""


class SensorError(HardwareError):
    """A tactile sensor reports a failure."""


class StaleStreamError(HardwareError):
    """A stream is silent: the newest sample is too old."""


class LimitError(HardwareError, ValueError):
    """A target, speed, current or angle is beyond a limit of the robot."""


class ReachError(LimitError):
    """A point cannot be reached by the finger."""


class ClockError(HardwareError, ValueError):
    """Device times cannot be mapped to host times."""


class RigError(HardwareError, ValueError):
    """The description of the robot is incomplete or contradictory."""


class RecordingError(HardwareError, ValueError):
    """A folder is not a recording, or the recording is incomplete or damaged."""


class CompletenessError(RecordingError):
    """Too many samples are missing; `report` counts them for each stream."""

    def __init__(self, what: str, *, report=None, **parts):
        self.report = report
        super().__init__(what, **parts)


@contextmanager
def translated(
    error: type[HardwareError],
    what: str,
    where: object,
    next: str,
    of: type[Exception] | tuple = Exception,
) -> Iterator[None]:
    """Raise `error` where the block raises one of the errors `of` others.

    Errors of the bench pass: they say more.
    """
    try:
        yield
    except HardwareError:
        raise
    except of as bad:
        got = f"{type(bad).__name__}: {bad}"
        raise error(what, where=str(where), got=got, next=next) from bad
