"""The errors that the bench raises on purpose: what, where, got, expected, next."""

from __future__ import annotations

from tactilenlp.errors import TactileError


class HardwareError(TactileError):
    """Something on the bench is not as it must be; the root of all errors here."""


class FrameError(HardwareError, ValueError):
    """A frame, packet or picture does not hold what its format promises."""


class BusError(HardwareError):
    """A bus, serial line or camera cannot be opened, or carries nothing any more."""


class BoardError(HardwareError):
    """A motor board reports a fault, or does not do what it was told."""


class StaleStreamError(HardwareError):
    """A stream has fallen silent: the newest sample is older than is safe."""


class LimitError(HardwareError, ValueError):
    """A target, speed, current or angle lies outside what the robot may do."""


class ReachError(LimitError):
    """A point cannot be reached by the finger, whatever its joints do."""


class ClockError(HardwareError, ValueError):
    """Device times cannot be mapped to host times."""


class RigError(HardwareError, ValueError):
    """The description of the robot is missing something, or contradicts itself."""


class RecordingError(HardwareError, ValueError):
    """A recording is incomplete, damaged or not a recording."""


class CompletenessError(RecordingError):
    """Too many samples are missing; `report` says of which stream."""

    def __init__(self, what: str, *, report=None, **parts):
        self.report = report
        super().__init__(what, **parts)
