"""Record the shipped "polytope": nine touches of an octahedron, in MuJoCo."""

import numpy as np
from make_first_touch import random_action
from scipy.spatial.transform import Rotation

from tactilenlp import example_recording
from tactilenlp.simulation.world import World

SEED = 0  # the first seed tried; it is not selected
RADIUS = 0.022  # [m] of the sphere about the corners
FINGER = 0.006  # [m] thin enough to touch overhanging faces
ACTIONS = 9
LYING = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0]  # on one of its faces


def main() -> None:
    rng = np.random.default_rng(SEED)
    corners = LYING.apply(RADIUS * np.vstack([np.eye(3), -np.eye(3)]))
    yaw = rng.uniform(0, 2 * np.pi)
    world = World(
        vertices=corners,
        position=rng.uniform(-0.01, 0.01, 2),
        quaternion=[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)],
        finger_radius=(FINGER, FINGER),
    )
    for action in range(ACTIONS):
        error = rng.normal(0, 0.003, 3) if action else np.zeros(3)
        target = world.pose[:3] + error
        data = world.execute(random_action(rng, target, first=action == 0))
        print(f"action {action}: contact samples {data.contact.sum(axis=0)}")
    world.save(example_recording("polytope"))
    upright = 1 - 2 * (world.pose[4:6] ** 2).sum()  # z of the body's z axis
    assert upright > np.cos(np.radians(1)), "the object tumbled"


if __name__ == "__main__":
    main()
