"""Estimate random cylinders, prisms and ellipsoids from touches simulated in MuJoCo.

    python examples/benchmarks/shape_classes.py cylinder 0 1 2 [--light]

Classes: cylinder, ellipsoid, prism3, prism5, prism6.  Sizes are uniform in 30 to 60 mm
(an ellipsoid lies on its shortest axis), place and heading are random.  A finger pushes
from two sides, at a random height, through 63 mm towards the middle; then it touches
the top and pushes from a third side.  --light: six touches that end 2 mm inside where
the body was, from all sides and above.  Options are the defaults, friction and mass are
known.  A line tells sizes [mm], their deviations, the mean distance of the surfaces,
and how far the body tilted.
"""

import argparse
from types import SimpleNamespace

import casadi as ca
import numpy as np
import trimesh
from study import one_thread

from tactilenlp import (
    CYLINDER,
    ELLIPSOID,
    Scene,
    World,
    prism,
    solve_estimate,
    surface_distance,
)
from tactilenlp.errors import NotConverged
from tactilenlp.geometry.transforms import rotation_of
from tactilenlp.tracking.surface import body_surface

CLASSES = {
    "cylinder": CYLINDER, "ellipsoid": ELLIPSOID,
    "prism3": prism(3), "prism5": prism(5), "prism6": prism(6),
}  # fmt: skip
SIZES = 30e-3, 60e-3  # [m]
RADIUS = 10e-3  # [m] of a fingertip
SCENE = Scene(mass=0.5, friction_ground=0.3, friction_finger=0.5)


def line(start, end, away):
    """Return a minimum-jerk motion of a second from start to end (3,) [m]."""
    time = np.linspace(0, 1, 101)
    s = (time**3 * (10 - 15 * time + 6 * time**2))[:, None]
    moving = np.add(start, s * np.subtract(end, start))
    still = np.broadcast_to(away, moving.shape)
    return SimpleNamespace(time=time, finger_position=np.stack([moving, still], 1))


def body_of(name, rng):
    """Return sizes (n,) [m] and vertices (V, 3) [m] of a random body."""
    theta = rng.uniform(*SIZES, CLASSES[name].theta)
    if name != "ellipsoid":
        return theta, body_surface(CLASSES[name], theta)
    theta = np.sort(theta)[::-1]
    return theta, trimesh.creation.icosphere(3).vertices * theta / 2


def push(world, rng, first):
    """Push from three sides, and touch the top before the last push."""
    for k in range(3):
        angle = first + k * 2 * np.pi / 3 + rng.uniform(-0.4, 0.4)
        height = np.ptp(np.asarray(world.vertices)[:, 2])
        z = max(0.012, rng.uniform(0.3, 0.6) * height)
        out = np.array([np.cos(angle), np.sin(angle)])
        beside = rng.uniform(-0.006, 0.006) * np.array([-out[1], out[0]])
        away, middle = [*(-0.2 * out), 0.1], world.pose[:2]
        if k == 2:
            over = middle + 0.005 * out
            top = max(0.02, 2 * world.pose[2] + 0.0095)
            world.execute(line([*over, 0.1], [*over, top], away))
            middle = world.pose[:2]
        ends = ([*(middle + way * out + beside), z] for way in (0.075, 0.012))
        world.execute(line(*ends, away))


def touch(world, shape, theta, rng, first):
    """Touch lightly from six directions, each 2 mm into where the body is."""
    q = ca.SX.sym("q", 3)
    distance = ca.Function("distance", [q], [shape.distance(ca.DM(theta), q, 1e-4)])
    for k in range(6):
        turn = rotation_of(world.pose[3:]).as_matrix()
        angle, rise = first + 2.4 * k, rng.uniform(-0.2, 0.9)
        level = np.cos(rise)
        out = np.array([np.cos(angle) * level, np.sin(angle) * level, np.sin(rise)])
        farthest = (np.asarray(world.vertices) @ turn.T @ out).max() + RADIUS
        ways = np.linspace(farthest + 0.005, 0.01, 400)
        away = np.asarray(distance.map(400)(turn.T @ out[:, None] * ways)).ravel()
        hit = ways[np.argmax(away < RADIUS)]
        start, end = (world.pose[:3] + w * out for w in (farthest + 0.02, hit - 0.002))
        start[2], end[2] = max(start[2], 0.012), max(end[2], 0.0105)
        world.execute(line(start, end, [-0.2 * out[0], -0.2 * out[1], 0.12]))


def main(arguments):
    one_thread()
    for seed in arguments.seeds:
        rng = np.random.default_rng([seed, 7])
        shape = CLASSES[arguments.name]
        theta, vertices = body_of(arguments.name, rng)
        yaw, place = rng.uniform(0, 2 * np.pi), rng.uniform(-0.01, 0.01, 2)
        turned = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        world = World(vertices=vertices, position=place, quaternion=turned)
        first = rng.uniform(0, 2 * np.pi)
        if arguments.light:
            touch(world, shape, theta, rng, first)
        else:
            push(world, rng, first)
        try:
            estimate, said = solve_estimate(world.measurements, SCENE, shape=shape), ""
        except NotConverged as error:
            estimate, said = error.estimate, "not converged, "
        true = world.true_body(world.measurements.time[-1]).mesh
        off = surface_distance(estimate.mesh(), true)
        sigma = np.sqrt(np.diag(estimate.information.covariance_matrix))[: len(theta)]
        up = rotation_of(world.truth.object_quaternion).as_matrix()[:, 2, 2]
        tilt = np.degrees(np.arccos(np.clip(up, -1, 1))).max()
        true, found, sigma = (
            (1e3 * v).round(2) for v in (theta, estimate.theta, sigma)
        )
        print(
            f"{seed}: {said}true {true}, found {found} ± {sigma} mm, surface "
            f"{1e3 * off.mean:.2f} mm, tilt {tilt:.1f} deg, "
            f"{estimate.seconds['total']:.1f} CPU s", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=CLASSES)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--light", action="store_true", help="six light touches")
    main(parser.parse_args())
