"""Explore on a simulation of the paper's robot, through all its buses and cameras.

    python examples/09_explore_on_the_robot.py [picture.png]

It has four CAN buses, two cameras behind soft domes, and joint zeros that are wrong by
about a degree: each tip is 3 to 5 mm from its reported position.  With a robot of your
own, omit `robot`, and load the rig that describes it: hardware/README.md.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix, translation_matrix

from hardware.bench import Bench
from hardware.kinematics import joints_about
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.world import RobotWorld
from tactilenlp import JointZeros, Scene, Workspace, explore, plot_top, surface_distance

LIMIT = 3.0  # [mm] largest error accepted: as far as the tips are off
SIDES, DEGREE = (0.058, 0.049, 0.053), np.deg2rad(1.0)  # [m], the paper's box; [rad]
WRONG = np.deg2rad([[0.9, -0.7, 0.8], [-0.8, 0.9, -0.6]])  # errors of the joint zeros
WHERE = [[0.05, 0.0, 0.04], [-0.05, 0.0, 0.04]]  # [m] where each tip works, roughly

plt.switch_backend("Agg")  # write to a file, without a screen
picture = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("robot.png")
print("A first touch and two chosen actions take 40 s ...", flush=True)
if find_spec("cv2") is None:
    sys.exit('The cameras need OpenCV: pip install "tactilenlp[optical]".')
rig = simulated_rig("densetact")
turn = [np.cos(0.3), 0, 0, np.sin(0.3)]  # 0.6 rad about the vertical
robot = SimulatedRobot(rig, SIDES, quaternion=turn, mass=0.5, zero_error=WRONG)

joints = joints_about([finger.geometry for finger in rig.fingers], WHERE)
scene = Scene(sigma_normal=0.01, sigma_offset=JointZeros(DEGREE, **joints))
options = {"clock": robot, "reader": robot.reader, "listen_only": False}
with robot, Bench(rig, **options) as bench, RobotWorld(bench) as world:
    radius = float(world.finger_radius[0])
    space = Workspace.robot(finger_radius=radius, stiffness=160.0, max_force=1.7)
    for step in explore(world, scene, 2, workspace=space, centre=(0, 0), seed=0):
        place = translation_matrix(robot.pose[:3]) @ quaternion_matrix(robot.pose[3:])
        true, found = box(SIDES, place), step.estimate.mesh()
        off = 1e3 * surface_distance(found, true).mean
        wrong = 1e3 * np.linalg.norm(step.estimate.finger_offset, axis=1)
        print(f"Action {step.number} ({step.policy}): {off:.2f} mm off; tips found")
        print(f"  {wrong[0]:.1f} and {wrong[1]:.1f} mm from their reports", flush=True)

truth = {"position": robot.pose[None, :3], "quaternion": robot.pose[None, 3:]}
plot_top(step.estimate, -1, truth | {"side_lengths": np.array(SIDES)})
plt.savefig(picture, dpi=120, bbox_inches="tight")
print(f"The picture is in {picture}.")
if off > LIMIT:
    sys.exit(f"The surface is {off:.2f} mm off on average: more than {LIMIT} mm.")
print(f"With four buses and two cameras the surface is {off:.2f} mm off on average.")
