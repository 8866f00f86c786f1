"""Stop motor boards: zero current on all of them first, whatever happens."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import can

from .motor_can import Command, encode_command, encode_current

if TYPE_CHECKING:
    from .motor_board import MotorBoard

log = logging.getLogger(__name__)
OFF = Command.ENABLE_MOTOR_1, Command.ENABLE_MOTOR_2, Command.ENABLE_SYSTEM


def stop_boards(boards: Iterable[MotorBoard]) -> None:
    """Command zero current on all boards, then disable them, then record all that.

    A board that cannot be reached takes SEND_TIME for each of its four frames; the
    others are stopped meanwhile.  A sink, which may be slow, is called after the last
    frame.  Errors are logged; a Ctrl-C on the way is raised at the end.
    """
    boards = [board for board in boards if board.sends]
    sent: list[tuple[MotorBoard, can.Message]] = []
    raised: list[BaseException] = []

    def send(board: MotorBoard, message: can.Message) -> None:
        board.transmit(message)
        sent.append((board, message))

    for board in boards:
        board.driving = False
    for board in boards:
        _try(raised, board, lambda b=board: send(b, encode_current(0.0, 0.0)))
    for order in OFF:
        for board in boards:
            _try(raised, board, lambda b=board, o=order: send(b, encode_command(o, 0)))
    for board, message in sent:
        _try(raised, board, lambda b=board, m=message: b.record(m))
    if raised:
        raise raised[0]


def _try(raised: list, board: MotorBoard, action: Callable[[], None]) -> None:
    """Run an action; log its error, or note an interruption for later."""
    try:
        action()
    except Exception as bad:
        log.warning("%s: while stopping: %s", board.name, bad)
    except BaseException as bad:
        raised.append(bad)
