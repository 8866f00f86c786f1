"""Read a device in a thread; hold what was received, and detect silence."""

from __future__ import annotations

import threading
from collections import deque

from .clock import Clock, HostClock
from .errors import HardwareError
from .touch import check_age

STALE = 0.1  # [s], three pictures at 30 Hz
QUEUE = 65_536  # [frames] that wait to be taken: a minute of a sensor at 1 kHz


class Reader:
    """Run `_run` of a subclass in a thread, from the start of `with` to its end.

    name:  of the device, in errors
    clock: for the stamps
    hang:  [s] that leaving waits for a read that does not end, None: for ever
    queue: frames that wait to be taken; older ones are dropped, `dropped` counts them

    `_run` calls `_keep` with what was received, sets `_why` to the reason of a silence,
    and `_broken_down` to the error that ended it.
    """

    def __init__(
        self,
        name: str,
        clock: Clock | None,
        hang: float | None = None,
        queue: int = QUEUE,
    ) -> None:
        self.name, self.clock, self._hang = name, clock or HostClock(), hang
        self._came: deque[tuple[float, object]] = deque(maxlen=queue)
        self.dropped = 0
        self._heard, self._why = self.clock.now(), ""
        self._broken_down: HardwareError | None = None
        self._lock, self._leave = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self):
        self._leave.clear()
        self._heard = self.clock.now()
        self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *exception) -> None:
        self._leave.set()
        if self._thread is not None:
            self._thread.join(timeout=self._hang)
            self._thread = None

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
        """Raise the error of the thread, or StaleStreamError after a longer silence."""
        if self._broken_down is not None:
            raise self._broken_down
        check_age(self.name, self.age, stale, self._why)

    def _keep(self, now: float, came: list) -> None:
        """Store frames with their time of arrival [s], for `take`."""
        self._heard, self._why = now, ""
        with self._lock:
            free = self._came.maxlen - len(self._came)
            self.dropped += max(len(came) - free, 0)
            self._came.extend((now, one) for one in came)
