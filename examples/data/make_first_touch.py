"""Record the shipped "cuboid": a first touch and five random actions, in MuJoCo."""

from types import SimpleNamespace

import numpy as np

from tactilenlp import example_recording
from tactilenlp.simulation.world import World

SEED = 0  # the first seed tried; it is not selected
DURATION, RADIUS = 1.0, 0.1  # [s], [m] of an action, as in the paper
BOUND = 2 * np.pi / 5  # [rad] of both approach angles, as in the paper's simulation
SHORT = 0.017  # [m] from the centroid, where an action of two fingers ends
APART, LOWEST = 0.025, 0.012  # [m] between fingers, and of a finger above the ground
WAITING = np.array([-0.2, 0.0, 0.1])  # [m] the second finger during the first touch


def approach(rng: np.random.Generator, fingers: int) -> np.ndarray:
    """Return directions (fingers, 3) from the object to +X and -X, above the ground."""
    ascension = rng.uniform(-BOUND, BOUND, fingers)
    declination = rng.uniform(0, BOUND, fingers)
    side = np.array([1.0, -1.0])[:fingers]
    x, y = side * np.cos(ascension), side * np.sin(ascension)
    across = np.stack([x, y, np.tan(declination)], axis=1)
    return across * np.cos(declination)[:, None]


def random_action(rng: np.random.Generator, target: np.ndarray, first: bool):
    """Return a trajectory: straight lines towards a target (3,) [m], minimum jerk."""
    fingers, end = (1, 0.0) if first else (2, SHORT)
    ways = approach(rng, fingers)
    while fingers == 2 and end * np.linalg.norm(ways[0] - ways[1]) < APART:
        ways = approach(rng, fingers)
    time = np.linspace(0, DURATION, 101)
    s = time / DURATION
    distance = RADIUS + (end - RADIUS) * s**3 * (10 - 15 * s + 6 * s**2)
    position = target + distance[:, None, None] * ways
    position[..., 2] = np.maximum(position[..., 2], LOWEST)
    if first:
        waiting = np.broadcast_to(WAITING, position.shape)
        position = np.concatenate([position, waiting], axis=1)
    return SimpleNamespace(time=time, finger_position=position)


def main() -> None:
    rng = np.random.default_rng(SEED)
    yaw = rng.uniform(0, 2 * np.pi)
    world = World(
        side_lengths=rng.uniform(0.03, 0.06, 3),
        position=rng.uniform(-0.02, 0.02, 2),
        quaternion=[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)],
    )
    centroid = world.pose[:3]
    for action in range(6):
        # Later targets come from an estimate: here the truth with an error of 5 mm.
        error = rng.normal(0, 0.005, 3) if action else np.zeros(3)
        data = world.execute(random_action(rng, centroid + error, first=action == 0))
        moved = 1e3 * np.linalg.norm(world.pose[:3] - centroid)
        touches, centroid = data.contact.sum(axis=0), world.pose[:3]
        print(f"action {action}: contact samples {touches}, moved {moved:.1f} mm")
    world.save(example_recording("cuboid"))
    upright = 1 - 2 * (world.pose[4:6] ** 2).sum()  # z of the body's z axis
    tilt = np.degrees(np.arccos(min(1.0, upright)))
    print(f"cuboid.npz: {world.measurements}; final tilt {tilt:.2f} degrees")
    assert tilt < 1, "the object tumbled"


if __name__ == "__main__":
    main()
