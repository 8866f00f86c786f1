"""Hold what a device sent until it is taken, detect silence; read it in a thread."""

from __future__ import annotations

import logging
import math
import threading
from collections import deque

from .clock import Clock, HostClock
from .errors import BusError, HardwareError
from .ranges import check_age

log = logging.getLogger(__name__)
STALE = 0.1  # [s], three pictures at 30 Hz
QUEUE = 65_536  # [frames] that wait to be taken: a minute of a sensor at 1 kHz
FIRST_WAIT, LONGEST_WAIT = 0.05, 2.0  # [s] between attempts to open a device again


class Inbox:
    """Hold the frames of a device; `with` starts to measure the time of a silence.

    name:  of the device, in errors
    clock: for the stamps
    queue: frames that wait to be taken, None: all; older ones are dropped, `dropped`
           counts them
    """

    def __init__(
        self, name: str, clock: Clock | None, queue: int | None = QUEUE
    ) -> None:
        self.name, self.clock = name, clock or HostClock()
        self._came: deque[tuple[float, object]] = deque(maxlen=queue)
        self.dropped = 0
        self._heard, self._why = self.clock.now(), ""
        self._lock = threading.Lock()

    def __enter__(self):
        self._heard = self.clock.now()
        return self

    def take(self) -> list[tuple[float, object]]:
        """Return all frames since the last call, each with its time of arrival [s]."""
        with self._lock:
            came = list(self._came)
            self._came.clear()
        return came

    @property
    def age(self) -> float:
        """The time [s] since the last frame, or since the start."""
        return self.clock.now() - self._heard

    def check(self, stale: float = STALE) -> None:
        """Raise StaleStreamError after a longer silence [s]."""
        fix = "check that the sensor is plugged in and powered"
        check_age(self.name, "no touch is sensed", self.age, stale, fix, self._why)

    def _keep(self, stamp: float, came: list, heard: float | None = None) -> None:
        """Store frames with their stamp [s], for `take`.

        heard: [s] when they came, None: that is their stamp
        """
        self._heard, self._why = stamp if heard is None else heard, ""
        most = math.inf if self._came.maxlen is None else self._came.maxlen
        with self._lock:
            self.dropped += max(len(self._came) + len(came) - most, 0)
            self._came.extend((stamp, one) for one in came)


class Reader(Inbox):
    """Read a device in a thread, from the start of `with` to its end.

    hang: [s] that leaving waits for a read that does not end, None: for ever

    `_until_lost` of a subclass opens the device, calls `_keep` with what is received,
    and returns the reason for which it must be opened again: after FIRST_WAIT, which it
    restores in `_wait` when the device works, then after twice as long each time.
    `_broken_down` is the error that ended the thread.
    """

    def __init__(
        self,
        name: str,
        clock: Clock | None,
        hang: float | None = None,
        queue: int = QUEUE,
    ) -> None:
        super().__init__(name, clock, queue)
        self._hang, self._wait = hang, FIRST_WAIT
        self._broken_down: HardwareError | None = None
        self._leave = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self):
        super().__enter__()
        self._leave.clear()
        self._wait = FIRST_WAIT
        self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *exception) -> None:
        self._leave.set()
        if self._thread is not None:
            self._thread.join(timeout=self._hang)
            self._thread = None

    def check(self, stale: float = STALE) -> None:
        """Raise the error of the thread, or StaleStreamError after a longer silence."""
        if self._broken_down is not None:
            raise self._broken_down
        super().check(stale)

    def _run(self) -> None:
        try:
            while not self._leave.is_set():
                why = self._until_lost()
                if self._leave.is_set():
                    return
                self._why = why
                log.info("%s: %s; again in %.2f s", self.name, why, self._wait)
                self._leave.wait(self._wait)
                self._wait = min(2 * self._wait, LONGEST_WAIT)
        except HardwareError as bad:  # the sink: a full disk, for instance
            self._broken_down = bad
        except Exception as bad:  # a wrong URL, or any error of a driver
            told = f"{type(bad).__name__}: {bad}"
            self._broken_down = BusError("cannot be read", where=self.name, got=told)

    def _until_lost(self) -> str:
        raise NotImplementedError
