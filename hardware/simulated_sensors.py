"""Simulate fingertip sensors: DenseTact with pictures, OptoForce with packets.

A sensor is given the force on its tip in the tip's frame, and sends at its rate.
"""

from __future__ import annotations

from collections.abc import Callable

import can
import numpy as np

from .errors import RigError
from .reader import Inbox
from .rig import ON_CAN, Tactile
from .serial_tactile import DATA_ID, WRAP, ForceFrame, encode_force, to_can
from .touch import SCALE

PICTURES, FORCES = 30.0, 100  # [Hz]


class SimulatedCamera(Inbox):
    """Render pictures of a DenseTact at 30 Hz, with the interface of a Camera."""

    def __init__(self, tactile: Tactile, seed: int) -> None:
        super().__init__("camera", None)
        from .optical import Lens
        from .simulated_skin import SimulatedSkin

        lens = Lens(**tactile.touch["lens"])
        width, height = tactile.camera["size"]
        self.R_ts = np.array(tactile.touch["mount"], float)
        self.skin = SimulatedSkin(lens, (height, width), seed)
        self.sink, self.frozen, self._due = None, False, 0.0

    def open(self) -> None:
        """Do nothing: there is no wire."""

    close = open

    def __exit__(self, *exception) -> None:
        self.take()

    def send(
        self, force: np.ndarray, press: np.ndarray, now: float, stamp: float
    ) -> None:
        """Take a picture if it is due; `press` (3,) [N] normal force, tip's frame."""
        if now < self._due or self.frozen:
            return
        self._due = max(self._due, now - 1 / PICTURES) + 1 / PICTURES
        size = float(np.linalg.norm(press))
        out = -self.R_ts.T @ press / size if size > 0 else None
        picture = self.skin.picture(out, size)
        if self.sink is not None:
            self.sink(picture, now)
        self._keep(now, [picture])


class SimulatedDome:
    """Send packets of an OptoForce at 100 Hz, on CAN or to a function of bytes."""

    def __init__(self, tactile: Tactile) -> None:
        self.tactile, self.silent = tactile, False
        self.R_ts = np.array(tactile.touch.get("mount", np.eye(3)), float)
        self.scale = np.array(tactile.touch.get("scale", SCALE), float)
        self.write: Callable[[bytes], None] | None = None
        self._bus, self._counter, self._due = None, 0, 0.0

    def open(self) -> None:
        """Open the bus, if the sensor is on one."""
        if self.tactile.wire == ON_CAN:
            self._bus = can.Bus(**self.tactile.can)

    def close(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.shutdown()

    def send(
        self, force: np.ndarray, press: np.ndarray, now: float, stamp: float
    ) -> None:
        """Send a packet if it is due; `force` (3,) [N] on the tip, in its frame.

        stamp: [s] of the wall clock for the frames.
        """
        if now < self._due or self.silent:
            return
        self._due = max(self._due, now - 1 / FORCES) + 1 / FORCES
        counts = np.rint(self.scale * (self.R_ts.T @ force))
        limited = np.clip(counts, -32768, 32767).astype(int).tolist()
        packet = encode_force(ForceFrame(self._counter, 0, tuple(limited)))
        self._counter = (self._counter + 1) % WRAP
        if self.write is not None:
            self.write(packet)
        elif self._bus is not None:
            for message in to_can(packet, DATA_ID, stamp):
                self._bus.send(message)


def simulated_sensor(tactile: Tactile, seed: int) -> SimulatedCamera | SimulatedDome:
    """Return the simulated sensor of a rig; raises RigError for unknown kinds."""
    if tactile.kind == "densetact":
        return SimulatedCamera(tactile, seed)
    if tactile.kind.startswith("optoforce"):
        return SimulatedDome(tactile)
    raise RigError(
        "cannot be simulated", where="tactile.kind", got=tactile.kind,
        expected="densetact or optoforce",
    )  # fmt: skip
