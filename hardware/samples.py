"""Take the samples of an action from the drivers of the fingers, as streams.

To take them is quick: lists are copied.  To make arrays of them is not, 0.3 s for an
action of a minute: meanwhile a thread holds the fingers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .motor_can import Quantity
from .streams import FingerStreams, Stream, table, touch_stream
from .touch import Touch

if TYPE_CHECKING:
    from .bench import FingerBench


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
        boards = []
        for board, rows in zip(self.finger.boards, self.boards, strict=True):
            known = table(rows, 3)
            boards.append(
                Stream.sorted(board.name, known[:, 0], known[:, 1:], board.broken)
            )
        touch = touch_stream(f"{rig.name}, tactile", self.touches)
        geometry, joints = self.finger.geometry, self.finger.joints
        return FingerStreams(
            rig.name, geometry, joints, tuple(boards), touch, rig.tactile.latency
        )
