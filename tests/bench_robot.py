"""A simulated robot with its bench and world, and ways for its fingers."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from hardware.bench import Bench
from hardware.clock import HostClock
from hardware.kinematics import finger
from hardware.motor_can import Reference
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.tape import Tape
from hardware.world import RobotWorld

BEYOND = tuple(finger("edu_dair", 180).forward([1.1, 0.9, -1.7]))  # joint 0 ends at 1
BOX = (0.058, 0.049, 0.053)  # [m], the paper's
numbers = itertools.count()


def trajectory(*lines, duration=1.0, steps=31):
    """Straight lines of all fingers, from and to (3,) [m]; one point: parked."""
    s = np.linspace(0, 1, steps)[:, None]
    ends = [line if len(line) == 2 else line * 2 for line in lines]
    paths = [np.array(a) + s * np.subtract(b, a) for a, b in ends]
    return SimpleNamespace(
        time=duration * s[:, 0], finger_position=np.stack(paths, axis=1)
    )


AWAY = [(-0.1, 0.01, 0.05)]
PUSH = trajectory([(0.07, 0.0, 0.04), (-0.02, 0.0, 0.03)], AWAY, duration=0.75)
SQUEEZE = trajectory(
    [(0.09, 0.0, 0.05), (0.02, 0.0, 0.03)],
    [(-0.09, 0.0, 0.05), (-0.02, 0.0, 0.03)],
    duration=0.6,
)
FREE = trajectory(
    [(0.1, 0.0, 0.06), (0.08, 0.0, 0.06)],
    [(-0.1, 0.0, 0.06), (-0.08, 0.0, 0.06)],
    duration=0.2,
)


def poised(first=FREE):
    """Joint angles at the start of a trajectory: no time is lost on the way there."""
    rig = simulated_rig("optoforce_can")
    tips = zip(rig.fingers, first.finger_position[0], strict=True)
    return [one.geometry.inverse(p) for one, p in tips]


class Patient(SimulatedRobot, HostClock):
    """A robot whose clock counts as real: its fingers are kept up by a thread."""


class Setup:
    """A simulated robot, its bench and its world."""

    def __init__(self, kind="optoforce_can", tape=None, make=SimulatedRobot, **options):
        if kind == "densetact":
            pytest.importorskip("cv2", reason="needs tactilenlp[optical]")
        self.rig = options.pop("rig", None)
        self.rig = self.rig or simulated_rig(kind, f"world {next(numbers)}")
        options.setdefault("angles", poised())
        self.robot = make(self.rig, BOX, **options)
        self.trace = []
        self.robot.after = self.look
        self.tape = Tape(tape, self.rig) if tape else None
        reader = self.robot.reader
        self.bench = Bench(
            self.rig,
            tape=self.tape,
            clock=self.robot,
            reader=reader,
            listen_only=False,
        )
        self.world = RobotWorld(self.bench)

    def look(self, now):
        self.trace.append((now, self.robot.tips))

    def __enter__(self):
        self.robot.__enter__()
        if self.tape:
            self.tape.__enter__()
        self.bench.__enter__()
        return self

    def __exit__(self, *exception):
        self.bench.__exit__(*exception)
        if self.tape:
            self.tape.__exit__(*exception)
        self.robot.__exit__(*exception)

    def after(self, delay, action):
        """Do something once, so many seconds from now on the robot's clock."""
        due, done = self.robot.now() + delay, []

        def look(now):
            self.look(now)
            if now >= due and not done:
                done.append(now)
                action()

        self.robot.after = look
        return done

    @property
    def boards(self):
        """All simulated boards, which have received what was sent so far."""
        boards = [board for one in self.robot.fingers for board in one.boards]
        for board in boards:
            board.listen(self.robot.now())
        return boards

    def references(self):
        """The currents that each board was commanded."""
        return [
            [c.values for c in board.received if isinstance(c, Reference)]
            for board in self.boards
        ]

    def motors_enabled(self):
        """Whether any motor is enabled, by what its board has received."""
        return any(board._enabled.any() for board in self.boards)

    def left_in_peace(self):
        """All motors got zero current, and no current flows."""
        assert not any(board.current.any() for board in self.boards)
        return all(said[-1:] in ([], [(0.0, 0.0)]) for said in self.references())


def stop_a_board(setup):
    setup.robot.fingers[1].boards[0].silent = True
