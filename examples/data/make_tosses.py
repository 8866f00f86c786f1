"""Record the shipped "tosses": a cube tossed on the ground four times, in MuJoCo.

The cube has the size, mass, inertia and friction that ContactNets reports of its own
(https://github.com/DAIRLab/contact-nets); no pose is from its recordings.
"""

import mujoco
import numpy as np

from tactilenlp import example_recording

SEED = 0  # the first seed tried; it is not selected
HALF_WIDTH, MASS = 0.0524, 0.37  # [m], [kg]
FRICTION, INERTIA = 0.18, 0.81e-3  # [1], [kg m^2] about each axis
RATE, STEPS = 148.0, 40  # [Hz] of the poses, steps of the simulator between two
TOSSES, SECONDS = 4, 0.8  # tosses, [s] of each
DIGITS = 6  # poses are rounded to a micrometre, as a tracker would write them
WORLD = f"""
<mujoco>
  <option timestep="{1 / RATE / STEPS}" cone="elliptic" impratio="10"/>
  <default><geom friction="{FRICTION} 0 0" solref="0.002 1"/></default>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body>
      <freejoint/>
      <inertial pos="0 0 0" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
      <geom type="box" size="{HALF_WIDTH} {HALF_WIDTH} {HALF_WIDTH}"/>
    </body>
  </worldbody>
</mujoco>
"""


def main() -> None:
    model, rng = mujoco.MjModel.from_xml_string(WORLD), np.random.default_rng(SEED)
    data, poses = mujoco.MjData(model), []
    for toss in range(TOSSES):
        mujoco.mj_resetData(model, data)
        turn = rng.normal(size=4)
        height = np.sqrt(3) * HALF_WIDTH + rng.uniform(0.02, 0.1)
        data.qpos[:] = [0, 0, height, *turn / np.linalg.norm(turn)]
        data.qvel[:2], data.qvel[2] = rng.normal(0, 0.5, 2), rng.uniform(-1, 0)
        data.qvel[3:] = rng.normal(0, 5, 3)
        for _ in range(int(SECONDS * RATE)):
            poses.append([toss, *data.qpos])
            mujoco.mj_step(model, data, STEPS)
    poses = np.round(poses, DIGITS)
    np.savez_compressed(
        example_recording("tosses"), toss=poses[:, 0].astype(int), dt=1 / RATE,
        position=poses[:, 1:4], quaternion=poses[:, 4:], mass=MASS,
        half_width=HALF_WIDTH, friction_reported=FRICTION, inertia_reported=INERTIA,
    )  # fmt: skip


if __name__ == "__main__":
    main()
