"""Convert between the motors on the boards of a finger and its joints.

joint angle [rad] = motor [rev] * 2 pi / gear - zero angle, torque [N m] = current [A] *
torque constant * gear.  Encoders count from their position at power-up: zero angles are
found by homing, per robot (index or end stop, plus an offset).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactilenlp.common.validation import check_range, is_whole, numbers_of
from tactilenlp.errors import typed_call

from .clock import Clock
from .errors import BoardError, LimitError, RigError
from .motor_board import RECEIVE_TIMEOUT, MotorBoard
from .motor_stop import stop_boards
from .ranges import check_ranges

READY = 10.0  # [s], alignment after power-up takes a few seconds
POLL = 0.01  # [s]
TURNS = 4 * math.pi  # [rad], largest zero angle of a joint
PLACES = {(0, 0), (0, 1), (1, 0), (1, 1)}  # (board, motor)
KRPM = 1000 * 2 * math.pi / 60  # [rad/s]


@typed_call(RigError)
@dataclass(frozen=True)
class JointMap:
    """Hold which motor moves which joint of a finger, and its constants.

    motors: (board, motor) of the three joints, each numbered from 0.  The default is
            that of the reference driver's code, which its documentation contradicts
    zero:   (3,) [rad], the zero angles
    gear:   [1], motor turns per joint turn
    torque_constant: [N m / A] of a motor
    """

    motors: tuple[tuple[int, int], ...] = ((1, 0), (0, 0), (0, 1))
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gear: float = 9.0
    torque_constant: float = 0.02

    def __post_init__(self) -> None:
        given = self.motors if isinstance(self.motors, tuple | list) else ()
        pairs = [p for p in given if isinstance(p, tuple | list)]
        whole = {tuple(p) for p in pairs if all(map(is_whole, p))}
        if len(given) != 3 or len(whole & PLACES) != 3:
            raise RigError(
                "not a map of three joints",
                where="motors",
                got=self.motors,
                expected="three different (board, motor) out of 0 and 1",
            )
        check_ranges("zero", self.zero, 3, -TURNS, TURNS, "rad", RigError)
        check_range("gear", self.gear, 1.0, 100.0, "", RigError)
        constant = self.torque_constant
        check_range("torque_constant", constant, 1e-4, 1.0, "N m/A", RigError)

    def angles(self, revolutions: np.ndarray) -> np.ndarray:
        """Return joint angles (..., 3) [rad] of motors (..., board, motor) [rev]."""
        turns = self._joints(_motors("revolutions", revolutions))
        return turns * (2 * math.pi / self.gear) - np.array(self.zero)

    def velocities(self, krpm: np.ndarray) -> np.ndarray:
        """Return joint velocities (..., 3) [rad/s] of motors (..., 2, 2) [krpm]."""
        return self._joints(_motors("krpm", krpm)) * (KRPM / self.gear)

    def revolutions(self, angles: np.ndarray) -> np.ndarray:
        """Return motor positions (..., 2, 2) [rev]; the fourth motor stays at 0."""
        turns = (_angles("angles", angles) + self.zero) * (self.gear / (2 * math.pi))
        return self._boards(turns)

    def krpm(self, velocities: np.ndarray) -> np.ndarray:
        """Return motor velocities (..., 2, 2) [krpm] of joint velocities [rad/s]."""
        return self._boards(_angles("velocities", velocities) * (self.gear / KRPM))

    def currents(self, torques: np.ndarray) -> np.ndarray:
        """Return motor currents (..., 2, 2) [A] of joint torques (..., 3) [N m]."""
        return self._boards(_angles("torques", torques) / self.newton_metres)

    def torques(self, currents: np.ndarray) -> np.ndarray:
        """Return joint torques (..., 3) [N m] of motor currents (..., 2, 2) [A]."""
        return self._joints(_motors("currents", currents)) * self.newton_metres

    @property
    def newton_metres(self) -> float:
        """The joint torque per current [N m / A]."""
        return self.torque_constant * self.gear

    def _joints(self, motors: np.ndarray) -> np.ndarray:
        board, motor = np.array(self.motors).T
        return motors[..., board, motor]

    def _boards(self, joints: np.ndarray) -> np.ndarray:
        motors = np.zeros((*joints.shape[:-1], 2, 2))
        board, motor = np.array(self.motors).T
        motors[..., board, motor] = joints
        return motors


def _motors(where: str, values: object) -> np.ndarray:
    return numbers_of(f"JointMap, {where}", values, LimitError, ..., 2, 2)


def _angles(where: str, values: object) -> np.ndarray:
    return numbers_of(f"JointMap, {where}", values, LimitError, ..., 3)


def start_motors(
    boards: list[MotorBoard],
    clock: Clock,
    timeout: float = RECEIVE_TIMEOUT,
    patience: float = READY,
) -> None:
    """Start all boards at once, and wait until their motors are aligned.

    timeout: [s] of silence after which a board switches itself off from then on.
    Raises BoardError for a fault, where alignment takes longer than `patience` [s], and
    where a board is stopped meanwhile; all boards are stopped then.
    """
    check_range("start_motors, patience", patience, POLL, 600.0, "s", LimitError)
    try:
        for board in boards:
            board.start()
        end = clock.now() + patience
        while waiting := [board for board in boards if not board.ready]:
            clock.sleep(POLL)
            for board in boards:
                if not board.driving:
                    raise BoardError(
                        "was stopped while it started", where=board.name,
                        next="read the log for what stopped it, then start again",
                    )  # fmt: skip
                board.poll()
                board.check(stale=patience)
            if clock.now() > end:
                raise BoardError(
                    "is not ready",
                    where=waiting[0].name,
                    got=repr(waiting[0].status),
                    expected=f"both motors aligned within {patience} s",
                    next="check that the joints move freely and the motor supply is on",
                )
        for board in boards:
            board.command(0.0, 0.0)
            board.watch(timeout)
    except BaseException:
        stop_boards(boards)
        raise
