"""Explore on the simulated robot, in a process that can be killed: its object stays.

    python tests/bench_resume.py folder actions [folder of a killed process]

What is real outlives the program: where object and fingertips are is in a file after
every step of the wires, and the next process begins there, at rest.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from hardware.bench import Bench
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.world import RobotWorld
from tactilenlp import Exploration, Scene, Workspace, explore

BOX = (0.058, 0.049, 0.053)  # [m]
FRICTION = 0.3, 0.05  # [1] of ground and fingers: forces then point along normals
CENTRE, TURN = (0.004, -0.003), 0.2  # [m], [rad] of the box
KEPT, REALITY = "exploration.npz", "reality.bin"
LONGEST = 600.0  # [s] of a process


def robot_in(folder):
    """Return the robot as the last process left it, which writes where things are."""
    rig = simulated_rig("optoforce_can", f"resume {os.getpid()}")
    quaternion = (np.cos(TURN / 2), 0.0, 0.0, np.sin(TURN / 2))
    given = {"position": CENTRE, "quaternion": quaternion, "friction": FRICTION}
    robot = SimulatedRobot(rig, BOX, **given)
    real = Path(folder) / REALITY
    if real.exists():  # fingers may touch the object: it is not to be placed anew
        where = np.fromfile(real)
        robot._plant._data.qpos[:] = where
        robot._tips = where[7:].reshape(-1, 3)
    file = os.open(real, os.O_RDWR | os.O_CREAT)

    def write(now):
        places = np.concatenate([robot.pose, robot.tips.ravel()])
        os.pwrite(file, places.tobytes(), 0)  # in one call: whole, or not at all

    robot.after = write
    return robot


def put_object(robot, left):
    """Put the object where a killed process left it, as a hand would do."""
    real = Path(left) / REALITY
    if real.exists():  # it was killed after the wires had been opened
        robot._plant._data.qpos[:7] = np.fromfile(real)[:7]


def main(folder, actions, left=None):
    """Explore into a folder, or go on there; say each step.

    left: a folder as a killed process left it: in this process, which is not killed,
    the object is put where it was left, after as many steps as are kept there.
    """
    robot = robot_in(folder)
    moved = None if left is None else len(kept(left).steps)
    if moved == 0:
        put_object(robot, left)
    options = {"clock": robot, "reader": robot.reader, "listen_only": False}
    with robot, Bench(robot.rig, **options) as bench:
        world = RobotWorld(bench)
        radius = float(world.finger_radius[0])
        space = Workspace.robot(finger_radius=radius, radius=0.08, duration=0.5)
        scene = Scene(friction_finger=FRICTION[1], sigma_normal=0.05)
        for step in explore(
            world, scene, actions, file=Path(folder) / KEPT, workspace=space,
            centre=CENTRE, budget=40, seed=3,
        ):  # fmt: skip
            print(f"step {step.number}", flush=True)
            if step.number + 1 == moved:
                put_object(robot, left)


class Process:
    """An exploration in a process of its own, which can be killed at any moment."""

    def __init__(self, folder, actions, *left):
        here = Path(__file__).resolve()
        path = os.pathsep.join([str(here.parents[1]), str(here.parent)])
        environment = os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            [sys.executable, *map(str, (here, folder, actions, *left))], text=True,
            env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def wait_for(self, words):
        """Read until it says so; False where it ends before."""
        return any(line.strip() == words for line in self.process.stdout)

    def kill(self, delay=0.0):
        """End it by SIGKILL after a delay [s]; return whether it still ran."""
        end = time.monotonic() + delay
        while time.monotonic() < end and self.process.poll() is None:
            time.sleep(0.005)
        ran = self.process.poll() is None
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(timeout=LONGEST)
        self.process.stdout.close()
        return ran

    def finish(self):
        """Wait for its end; fails unless it ended well."""
        said = self.process.communicate(timeout=LONGEST)[0]
        assert self.process.returncode == 0, said


def kept(folder):
    """Return what a folder keeps of an exploration; an empty one before the first."""
    file = Path(folder) / KEPT
    return Exploration.load(file) if file.exists() else Exploration()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
