"""Boxes and hulls of random sizes, and where fingers push them."""

from dataclasses import dataclass

import numpy as np
from exploration_objects import lying_on, solid_of
from trimesh.convex import convex_hull

from tactilenlp.geometry.faces import polygons

SIDES = (0.03, 0.03, 0.04), (0.055, 0.055, 0.07)  # [m] from, to
NEAR, FAR = 0.012, 0.03  # [m] between fingertips and the box's circle, at first
AIM = 0.006  # [m] standard deviation of where fingers aim, from the centre
OPPOSITE = 0.5  # [rad] standard deviation of the second finger's direction
SOLIDS = 6  # kinds of hulls in turn: five Platonic solids, then an irregular one
CIRCUMRADIUS = 0.02, 0.03  # [m] of a Platonic solid
DIRECTIONS, HALF_AXES = 14, (0.018, 0.028)  # points of an irregular hull; [m]


@dataclass(frozen=True)
class Box:
    """A box, its pushes and what is told of it: all drawn from one number.

    scale: factor of its sides; radius: [m] of the fingertips that push it; mass_factor,
    friction_factor: of its mass and both its frictions; points (V, 3) [m]: the vertices
    of a hull, None of a box.
    """

    number: int
    scale: float = 1.0
    radius: float = 0.01
    mass_factor: float = 1.0
    friction_factor: float = 1.0

    def __post_init__(self) -> None:
        rng = np.random.default_rng([2028, self.number])
        draw = {
            "sides": self.scale * rng.uniform(*SIDES),
            "mass": self.mass_factor * float(rng.uniform(0.2, 0.7)),
            "ground": self.friction_factor * float(rng.uniform(0.3, 0.5)),
            "finger": self.friction_factor * float(rng.uniform(0.4, 0.75)),
            "yaw": float(rng.uniform(0, 2 * np.pi)),
            "points": None,
        }
        for name, value in draw.items():
            object.__setattr__(self, name, value)

    @property
    def height(self) -> float:
        """The height [m] of the body's origin above the ground it lies on."""
        return self.sides[2] / 2

    @property
    def inertia(self) -> np.ndarray:
        """The moments of inertia (3, 3) [kg m^2] about the middle."""
        a, b, c = self.sides**2
        return self.mass / 12 * np.diag([b + c, a + c, a + b])

    def pushes(self, rng, centre, heights, above=0.0, count=2):
        """Return where an action's fingers start and where they aim (F, 3) [m]."""
        heading = rng.uniform(0, 2 * np.pi)
        angles = heading + np.array([0, np.pi + rng.normal(0, OPPOSITE)])
        if count != 2:
            angles = heading + 2 * np.pi / count * np.arange(count)
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        far = rng.uniform(NEAR, FAR, count)
        out = np.linalg.norm(self.sides[:2]) / 2 + self.radius + far
        low = self.radius + 1e-3
        z = np.maximum(rng.uniform(*heights, count) * self.sides[2], low)[:, None]
        aim = centre[:2] + rng.normal(0, AIM, (count, 2))
        start = np.hstack([centre[:2] + ways * out[:, None], z])
        if above:
            down = rng.uniform(0, above, count)[:, None]
            start[:, :2] -= (1 - np.cos(down)) * ways * out[:, None]
            start[:, 2:] += np.sin(down) * (out[:, None] + self.sides[2])
        return start, np.hstack([aim, z])


@dataclass(frozen=True)
class Hull(Box):
    """A convex hull that lies on one of its faces; its origin is its centroid.

    sides (3,) [m]: of the box around it.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        rng = np.random.default_rng([2032, self.number])
        points = self.scale * hull_points(rng, self.number)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "sides", 2 * np.abs(points).max(axis=0))

    @property
    def height(self) -> float:
        return -self.points[:, 2].min()

    @property
    def inertia(self) -> np.ndarray:
        mesh = convex_hull(self.points)
        return self.mass / mesh.volume * mesh.moment_inertia


def hull_points(rng, number: int) -> np.ndarray:
    """Return the vertices (V, 3) [m] of a hull that rests on its lowest face."""
    kind = number % SOLIDS
    if kind < SOLIDS - 1:
        points = rng.uniform(*CIRCUMRADIUS) * solid_of(kind)
    else:
        way = rng.normal(size=(DIRECTIONS, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        points = way * rng.uniform(*HALF_AXES, 3)
    mesh = convex_hull(points)
    points = mesh.vertices - mesh.center_mass
    faces = [(points[corner], n) for corner, n in polygons(points)]
    # On the face nearest to the centroid a body always rests.
    _, outward = min(faces, key=lambda face: float(face[0][0] @ face[1]))
    return lying_on(points, outward)
