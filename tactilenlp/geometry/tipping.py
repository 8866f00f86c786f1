"""Kinematics and fall of a cuboid that tips over a bottom edge.

Planar poses are x = (x, y, yaw), free ones (p_wo, rotation vector), as the pages have
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from formulations.shape import CUBOID

QUARTER_TURN = np.pi / 2  # [rad] after which it lies on the next face
LEAST_TIPPING_SPEED = 1.05  # [-] of the speed that just carries it over the edge
FALL_SUBSTEPS = 20  # integration steps of the falling pendulum per sample


@dataclass(frozen=True, eq=False)
class Tip:
    """A cuboid that tips about a bottom edge, from planar pose `x` (3,).

    It falls towards -side of its horizontal `axis`; angle (n,) [rad] at the samples
    of the action, 0 before it tips; end [rad]: the last angle,
    QUARTER_TURN, or 0 where it falls back.
    """

    axis: int
    side: float
    angle: np.ndarray
    end: float = QUARTER_TURN

    @cached_property
    def renamed(self) -> np.ndarray:
        """The rotation S (3, 3) of body coordinates, q_lying = S q_o, by `end`."""
        over = -self.side * self.end * np.cross([0, 0, 1.0], np.eye(3)[self.axis])
        return Rotation.from_rotvec(over).as_matrix().round()

    @property
    def landed(self) -> int:
        """The first sample of the action at which it lies, or their number."""
        return int(np.count_nonzero(self.angle < QUARTER_TURN))

    def fall(self, x) -> np.ndarray:
        """Return the horizontal direction (3,) in which it falls from x (3,)."""
        ahead = x[2] + self.axis * QUARTER_TURN
        return -self.side * np.array([np.cos(ahead), np.sin(ahead), 0.0])

    def poses(self, theta, x) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n + 1, 3) [m] and rotations from x (3,), at last lying."""
        turns = self.turns(x)
        R_wo = Rotation.from_euler("z", x[2]).as_matrix()
        return self.positions(theta, x, turns), turns @ R_wo

    def turns(self, x) -> np.ndarray:
        """Return the rotations (n + 1, 3, 3) about the edge, world frame, from x."""
        over = np.outer([*self.angle, self.end], np.cross([0, 0, 1.0], self.fall(x)))
        return Rotation.from_rotvec(over).as_matrix()

    def positions(self, theta, x, turns) -> np.ndarray:
        """Return the positions (n + 1, 3) [m] from x (3,); turns: about the edge."""
        p_wo = np.r_[x[:2], theta[2] / 2]
        edge = np.r_[(p_wo + self.fall(x) * theta[self.axis] / 2)[:2], 0.0]
        return edge + turns @ (p_wo - edge)


def fall(size, angle, samples, gravity, dt) -> np.ndarray:
    """Return the angles (samples,) [rad] of a box that tips over its edge and lands.

    size: depth and height [m]; angle [rad]: so far, one per sample of dt [s].  The
    speed is at least LEAST_TIPPING_SPEED times that which carries it over the edge.
    """
    depth, height = size
    over = np.arctan2(depth, height)
    pull = 1.5 * gravity / np.hypot(depth, height)  # m g r / I about the edge
    now = angle[-1]
    speed = (angle[-1] - angle[-2]) / dt if len(angle) > 1 else 0.0
    if now < over:
        least = np.sqrt(2 * pull * (1 - np.cos(over - now)))
        speed = max(speed, LEAST_TIPPING_SPEED * least)
    out = []
    for _ in range(samples):
        for _ in range(FALL_SUBSTEPS):
            speed += pull * np.sin(now - over) * dt / FALL_SUBSTEPS
            now = min(now + speed * dt / FALL_SUBSTEPS, QUARTER_TURN)
        out.append(now)
    return np.array(out)


def planar_to_free(theta, x, shape=CUBOID) -> np.ndarray:
    """Return planar poses x (3, T) of a body lying flat as free poses (6, T)."""
    o = np.zeros(x.shape[1])
    return np.vstack([x[:2], o + float(shape.rest_height(theta)), o, o, x[2]])
