"""Recordings of the simulated robot, for the tests of what becomes of them."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from hardware.bench import Bench
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.tape import Tape
from hardware.world import RobotWorld

numbers = itertools.count()
S = np.linspace(0, 1, 11)[:, None, None]
ENDS = np.array(
    [[[0.1, 0, 0.06], [-0.1, 0, 0.06]], [[0.08, 0, 0.06], [-0.08, 0, 0.06]]]
)
PATH = SimpleNamespace(
    time=0.4 * S[:, 0, 0], finger_position=ENDS[0] + S * (ENDS[1] - ENDS[0])
)


def recorded(kind, folder, bus="blf"):
    """Record a short action of the simulated robot; return what its world measured."""
    if kind == "densetact":
        pytest.importorskip("cv2", reason="needs tactilenlp[optical]")
    rig = simulated_rig(kind, f"tape {next(numbers)}")
    starts = zip(rig.fingers, ENDS[0], strict=True)
    robot = SimulatedRobot(rig, angles=[f.geometry.inverse(p) for f, p in starts])
    options = {"clock": robot, "reader": robot.reader, "listen_only": False}
    tape = Tape(folder, rig, bus=bus)
    with robot, tape, Bench(rig, tape=tape, **options) as bench:
        world = RobotWorld(bench)
        data = world.execute(PATH)
    return data, world.origin


@pytest.fixture(scope="module")
def taped(tmp_path_factory):
    """A recording with OptoForce sensors on CAN, and what was measured live."""
    folder = tmp_path_factory.mktemp("tape") / "touches"
    return folder, *recorded("optoforce_can", folder)
