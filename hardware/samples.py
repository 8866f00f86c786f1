"""Take the samples of an action from the drivers of the fingers, as streams.

To take them is quick: lists are copied.  To make arrays of them is not, 0.8 s for an
action of a minute: meanwhile a thread holds the fingers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .motor_can import Quantity
from .streams import FingerStreams, Stream, touch_stream
from .touch import Touch

if TYPE_CHECKING:
    from .bench import FingerBench

BLOCK = 5000  # [rows] that are made an array at once: 3 ms


@dataclass(frozen=True, eq=False)
class Samples:
    """Hold what was received from one finger.

    finger:  its drivers
    boards:  rows of stamp [s] and two positions [rev], for each board
    touches: of its sensor
    """

    finger: FingerBench
    boards: tuple[list[tuple[float, float, float]], ...]
    touches: list[Touch]

    @classmethod
    def of(cls, finger: FingerBench) -> Samples:
        """Return copies of the samples of a finger so far."""
        boards = tuple(board.rows(Quantity.POSITION) for board in finger.boards)
        return cls(finger, boards, list(finger.skin.touches))

    def streams(self) -> FingerStreams:
        """Return them as sorted streams; raises FrameError for fewer than two."""
        rig = self.finger.rig
        boards = tuple(
            Stream.sorted(board.name, *columns(rows), board.broken)
            for board, rows in zip(self.finger.boards, self.boards, strict=True)
        )
        touch = touch_stream(f"{rig.name}, tactile", self.touches)
        geometry, joints = self.finger.geometry, self.finger.joints
        return FingerStreams(
            rig.name, geometry, joints, boards, touch, rig.tactile.latency
        )


def columns(rows: list) -> tuple[np.ndarray, np.ndarray]:
    """Return the stamps (n,) [s] and values (n, 2) of rows.

    In parts of BLOCK rows: during each of them no other thread runs.
    """
    starts = range(0, max(len(rows), 1), BLOCK)
    parts = [np.array(rows[k : k + BLOCK], float).reshape(-1, 3) for k in starts]
    table = np.concatenate(parts)
    return table[:, 0], table[:, 1:]
