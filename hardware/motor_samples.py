"""Keep what a motor board measured: all samples, or the newest of each quantity."""

from __future__ import annotations

from collections import deque

import numpy as np

from .errors import StaleStreamError
from .motor_can import Quantity

CONNECT = "check the power, the bus, and that the board is told to send"


class MotorSamples:
    """Hold the samples of a board by quantity.

    name:     of the board, in errors
    remember: keep all samples for `series`; otherwise, as after `forget`, only the
              newest one of each quantity, so that memory does not grow
    """

    def __init__(self, name: str, remember: bool) -> None:
        self.name = name
        most = None if remember else 1
        self._series = {quantity: deque(maxlen=most) for quantity in Quantity}

    def series(self, quantity: Quantity) -> tuple[np.ndarray, np.ndarray]:
        """Return the stamps (n,) [s] and values (n, 2) of all frames remembered."""
        rows = np.array(self.rows(quantity), float).reshape(-1, 3)
        return rows[:, 0], rows[:, 1:]

    def rows(self, quantity: Quantity) -> list[tuple[float, float, float]]:
        """Return the stamp [s] and two values of all frames remembered, as a copy."""
        return list(self._series[quantity])

    def newest(self, quantity: Quantity) -> np.ndarray:
        """Return the newest values (2,); raises StaleStreamError if there are none."""
        return np.array(self._newest(quantity)[1:])

    def stamp(self, quantity: Quantity) -> float:
        """Return the stamp [s] of these."""
        return self._newest(quantity)[0]

    def remember(self) -> None:
        """Drop the series but for the newest sample, and keep all new samples."""
        self.forget()
        self._series = {key: deque(rows) for key, rows in self._series.items()}

    def forget(self) -> None:
        """Drop the series but for the newest sample, and keep only the newest."""
        self._series = {key: deque(rows, 1) for key, rows in self._series.items()}

    def _newest(self, quantity: Quantity) -> tuple[float, float, float]:
        if not (rows := self._series[quantity]):
            what, got = f"no {quantity.name.lower()} is heard", "nothing so far"
            raise StaleStreamError(what, where=self.name, got=got, next=CONNECT)
        return rows[-1]
