"""Make the objects of the exploration study; measure the error of an estimate."""

from itertools import product

import numpy as np
from chamfer import chamfer_code, chamfer_floor
from judging import placed
from monte_carlo import NOISE
from scipy.spatial.transform import Rotation
from trimesh.convex import convex_hull

from tactilenlp import Guess, Noise, World
from tactilenlp.evaluation import metrics
from tactilenlp.geometry.faces import polygons

SIZES, WITHIN = (0.03, 0.06), 0.02  # [m] of the cuboids, of their centres
RADIUS = 0.02  # [m] of the sphere around a Platonic solid
GUESSED = (0.01, 0.03)  # [m] sizes of the paper's guesses
SEED = 2026  # of all trials; trial k has generators of (SEED, k)
POINTS = 1000  # a surface
GOLDEN = (1 + 5**0.5) / 2


def solid_of(number: int) -> np.ndarray:
    """Return tetrahedron, cube, octahedron, dodecahedron, icosahedron in turn (V, 3).

    On the unit sphere.
    """
    cube = list(product((-1, 1), repeat=3))
    rolled = [  # of (0, +-1, +-g), for the icosahedron and half the dodecahedron
        [
            np.roll((0, a, b * g), k)
            for k in range(3)
            for a, b in product((-1, 1), (-1, 1))
        ]
        for g in (GOLDEN, GOLDEN**2)
    ]
    solids = (
        [v for v in cube if np.prod(v) > 0],
        cube,
        [*np.eye(3), *-np.eye(3)],
        [*cube, *(v / GOLDEN for v in rolled[1])],
        rolled[0],
    )
    points = np.array(solids[number % len(solids)], float)
    return points / np.linalg.norm(points[0])


def world_of(trial: int, objects: str = "cuboid", noisy: bool = False) -> World:
    """Return the trial's object where it lies at first; noisy: NOISE of the sensors."""
    rng = np.random.default_rng([SEED, trial])
    yaw, sizes = rng.uniform(0, 2 * np.pi), rng.uniform(*SIZES, 3)
    place = {
        "position": WITHIN * np.sqrt(rng.random()) * circle(rng),
        "quaternion": [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)],
    }
    if noisy:
        place["noise"] = Noise(seed=trial, **NOISE)
    if objects == "cuboid":
        return World(sizes, **place)
    points = RADIUS * solid_of(trial)
    outward = points[polygons(points)[0][0]].mean(axis=0)  # of a regular face
    return World(vertices=lying_on(points, outward), **place)


def lying_on(points, outward) -> np.ndarray:
    """Return a body's points (V, 3) turned so that a face's outward normal is down."""
    down, _ = Rotation.align_vectors([[0, 0, -1]], [outward])
    return down.apply(points)


def circle(rng) -> np.ndarray:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def corners(world: World) -> np.ndarray:
    """Return the true vertices (V, 3) [m], body frame."""
    if world.side_lengths is None:
        return world.vertices
    return (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * world.side_lengths


def guess_of(trial: int, start: str) -> Guess | None:
    """Return the paper's guess: small, anywhere within 2 cm of the centre; or none."""
    if start == "ours":
        return None
    rng = np.random.default_rng([SEED, trial, 1])
    place = WITHIN * np.sqrt(rng.random()) * circle(rng)
    return Guess(rng.uniform(*GUESSED, 3), place, rng.uniform(0, 2 * np.pi))


def errors(world: World, estimate) -> dict:
    """Return every metric of an estimate at the end of the last action [mm, deg]."""
    truth, mm = world.truth, 1e3
    where, turn = truth.object_position[-1], truth.object_quaternion[-1]
    true = placed(convex_hull(corners(world)), where, turn)
    found = estimate.mesh()
    exact = metrics.surface_distance(found, true, samples=POINTS)
    information, moved = estimate.information, where - truth.object_position[0]
    unknown = "vertices" if world.side_lengths is None else "side_lengths"
    return _pose_errors(world, estimate, where, turn) | {
        "p2s_mm": exact.mean * mm,
        "p2s_max_mm": exact.maximum * mm,
        "bch_mm": chamfer_code(found, true, POINTS) * mm,
        "bch_floor_mm": chamfer_floor(true, POINTS) * mm,
        "logdet": np.linalg.slogdet(information.matrix)[1],
        "sigma_side_mm": information.sigma(unknown).max() * mm,
        "unobserved": len(information.unobserved),
        "success": estimate.success,
        "tilt_deg": np.degrees(np.arccos(min(1, 1 - 2 * (turn[1:3] ** 2).sum()))),
        "moved_mm": np.linalg.norm(moved) * mm,
    }


def _pose_errors(world: World, estimate, where, turn) -> dict:
    """Return errors of size and pose modulo symmetry; of a hull, of its centroid."""
    pose = estimate.position[-1], estimate.quaternion[-1]
    if world.side_lengths is None:
        return {"position_mm": np.linalg.norm(pose[0] - where) * 1e3}
    sides = estimate.side_lengths
    off = metrics.cuboid_errors(sides, *pose, world.side_lengths, where, turn)
    return {
        "side_mm": np.abs(off.side_lengths).max() * 1e3,
        "position_mm": np.linalg.norm(off.position) * 1e3,
        "rotation_deg": np.degrees(off.rotation_angle),
    }
