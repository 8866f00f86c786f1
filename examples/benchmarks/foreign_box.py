"""Boxes of random sizes, and where two fingers push them."""

from dataclasses import dataclass

import numpy as np

SIDES = (0.03, 0.03, 0.04), (0.055, 0.055, 0.07)  # [m] from, to
NEAR, FAR = 0.012, 0.03  # [m] between fingertips and the box's circle, at first
AIM = 0.006  # [m] standard deviation of where fingers aim, from the centre
OPPOSITE = 0.5  # [rad] standard deviation of the second finger's direction


@dataclass(frozen=True)
class Box:
    """A box, its pushes and what is told of it: all drawn from one number.

    scale: factor of its sides; radius: [m] of the fingertips that push it.
    """

    number: int
    scale: float = 1.0
    radius: float = 0.01

    def __post_init__(self) -> None:
        rng = np.random.default_rng([2028, self.number])
        draw = {
            "sides": self.scale * rng.uniform(*SIDES),
            "mass": float(rng.uniform(0.2, 0.7)),
            "ground": float(rng.uniform(0.3, 0.5)),
            "finger": float(rng.uniform(0.4, 0.75)),
            "yaw": float(rng.uniform(0, 2 * np.pi)),
        }
        for name, value in draw.items():
            object.__setattr__(self, name, value)

    def pushes(self, rng, centre, heights, above=0.0):
        """Return where an action's two fingers start and where they aim (2, 3) [m]."""
        heading = rng.uniform(0, 2 * np.pi)
        angles = heading + np.array([0, np.pi + rng.normal(0, OPPOSITE)])
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        out = (
            np.linalg.norm(self.sides[:2]) / 2 + self.radius + rng.uniform(NEAR, FAR, 2)
        )
        low = self.radius + 1e-3
        z = np.maximum(rng.uniform(*heights, 2) * self.sides[2], low)[:, None]
        aim = centre[:2] + rng.normal(0, AIM, (2, 2))
        start = np.hstack([centre[:2] + ways * out[:, None], z])
        if above:
            down = rng.uniform(0, above, 2)[:, None]
            start[:, :2] -= (1 - np.cos(down)) * ways * out[:, None]
            start[:, 2:] += np.sin(down) * (out[:, None] + self.sides[2])
        return start, np.hstack([aim, z])
