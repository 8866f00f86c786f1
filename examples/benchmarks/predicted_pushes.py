"""Compare predicted pushes with simulated ones: how far a body follows, when it tips.

    python examples/benchmarks/predicted_pushes.py folder [--count 120]
        [--forces 8 1.7] [--bodies box tall solid]

Boxes of 30 to 60 mm, tall boxes (20 to 50 mm wide, 40 to 90 mm high) and Platonic
solids of 20 mm radius; random actions of two fingers whose servos give at most so many
newtons.  The prediction knows the body and where it lies.  Ways are those of the last
sample, of bodies that do not tip: a radian of turn counts as ARM.  Printed are for each
force the error of the way (median, mean, 90 %), true and predicted ways, how many
bodies are said to move more than MOVES that stay within half of it, and how many of
those tip whose centre of pressure comes so near to the edge of the support polygon.
The script writes predicted_pushes.csv and predicted_pushes.png.
"""

import argparse
from itertools import pairwise, product
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
from exploration_objects import corners, world_of
from study import one_thread, write_csv

from formulations.polytope import polytope
from formulations.rigid_body import ARM
from formulations.shape import CUBOID
from tactilenlp import Workspace, World
from tactilenlp.exploration.push_model import push_function
from tactilenlp.geometry.support import Standing
from tactilenlp.geometry.transforms import rotation_of

SENSORS = 1e3, 0.2e-3, 0.02  # [1/m], [m], [rad]: they do not change the motion
SOLID = polytope()
RATE = 30  # steps of an action
MOVES = 1e-3  # [m]
TIPS = np.radians(1.0)  # [rad] of the largest tilt
SIDES = {  # [m], least and largest
    "box": ([0.03] * 3, [0.06] * 3), "tall": ([0.02, 0.02, 0.04], [0.05, 0.05, 0.09]),
}  # fmt: skip
MARGINS = -np.inf, -10.0, -5.0, -2.0, 0.0, 2.0, 5.0, np.inf  # [mm]


def compared(number: int, force: float, kind: str = "box") -> dict:
    """Return true and predicted way [m], tilt [rad] and margin [m] of a body.

    It is pushed by a random action.
    """
    rng = np.random.default_rng([number, 40])
    space, body = Workspace(max_force=force), {}
    if kind == "solid":
        body["vertices"] = world_of(number, "polytope").vertices
    else:
        body["side_lengths"] = rng.uniform(*SIDES[kind])
    yaw = rng.uniform(-np.pi, np.pi)
    turn = (np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
    world = World(**body, quaternion=turn, max_force=force)
    begin, before = world.pose, rotation_of(world.pose[3:])
    vertices = before.apply(corners(world)) + begin[:3]
    space = space.around(np.linalg.norm(vertices - begin[:3], axis=1).max())
    action = space.random(rng)
    told, margin = predicted(world, vertices, action.positions(begin[:3], RATE + 1))
    world.execute(action.trajectory(begin[:3]))
    truth = world.truth
    turned = rotation_of(truth.object_quaternion) * before.inv()
    moved = np.diff(truth.object_position[[0, -1], :2], axis=0)[0]
    true = np.r_[moved, turned[-1].as_rotvec()[2]]
    metric = np.array([1, 1, ARM])
    off, way, promised = (
        float(np.linalg.norm(metric * v)) for v in (told - true, true, told)
    )
    upright = np.clip(turned.as_matrix()[:, 2, 2], -1, 1)
    tilt = float(np.arccos(upright).max())
    about = {"force_n": force, "kind": kind, "body": number}
    ways = {"off": off, "true": way, "said": promised}
    return about | ways | {"tilt": tilt, "margin": margin}


def predicted(world, vertices, path) -> tuple[np.ndarray, float]:
    """Return planar motion (3,) [m, m, rad] under a path (n, F, 3), least margin [m].

    vertices: (V, 3) [m] of the world's body, where it lies.
    """
    begin, (steps, fingers) = world.pose, (len(path) - 1, path.shape[1])
    if world.side_lengths is None:
        shape = SOLID.pushed(SOLID, vertices.size)
        vertices, path = vertices - begin[:3], path - begin[:3]
        z, centre = vertices.ravel(), np.zeros(3)
    else:
        yaw = rotation_of(begin[3:]).as_rotvec()[2]
        shape, z, centre = CUBOID, np.r_[world.side_lengths, begin[:2], yaw], begin[:3]
    goals, k = path.reshape(steps + 1, -1).T, len(z)
    push = push_function(shape, False, fingers, steps)
    rest = np.zeros(3), goals[:, 0], np.zeros(3), np.zeros((3, k)), np.zeros((3, 3))
    weight = world.mass * world.gravity
    frictions = world.friction_ground, world.friction_finger
    known = (*frictions, weight, Workspace.stiffness, world.max_force)
    told = world.finger_radius, known, SENSORS, 1.0
    out = push(*rest, z, goals[:, :-1], goals[:, 1:], *told)
    motion, wrench = out[2].full().T, out[-1].full().T
    known = np.zeros((len(vertices), 2, 1)), np.zeros((1, 1))  # exactly
    standing = Standing(vertices - centre, centre, np.zeros(2), *known)
    margin, _ = standing.margin(motion, wrench, weight)
    return motion[-1], float(margin.min())


def said(rows, force: float) -> str:
    """Return the lines of one force: ways of what does not tip, what tips by margin."""
    of_force = [row for row in rows if row["force_n"] == force]
    mine = [row for row in of_force if row["tilt"] < TIPS]
    at = SimpleNamespace(
        **{k: 1e3 * np.array([r[k] for r in mine]) for k in ("off", "true", "said")}
    )
    limit = 1e3 * MOVES
    false = ((at.said > limit) & (at.true < limit / 2)).sum()
    lines = [
        f"{force:g} N: off by {np.median(at.off):.2f} mm (median), {at.off.mean():.2f} "
        f"(mean), {np.quantile(at.off, 0.9):.2f} (90 %); ways {np.median(at.true):.2f} "
        f"true, {np.median(at.said):.2f} predicted; over {limit:g} mm: "
        f"{(at.true > limit).sum()} true, {(at.said > limit).sum()} predicted, {false} "
        f"of these within {limit / 2:g} mm; n = {len(mine)}"
    ]
    for kind in dict.fromkeys(row["kind"] for row in of_force):
        bodies = [row for row in of_force if row["kind"] == kind]
        lines.append(f"  {kind}: {tipped(bodies)}")
    return "\n".join(lines)


def tipped(rows) -> str:
    """Return how many tip, by the margin of the centre of pressure."""
    margin = 1e3 * np.array([row["margin"] for row in rows])
    tips = np.array([row["tilt"] > TIPS for row in rows])
    parts = []
    for low, high in pairwise(MARGINS):
        here = (margin >= low) & (margin < high)
        if here.any():
            parts.append(f"{low:g} to {high:g} mm {tips[here].sum()} of {here.sum()}")
    return f"{tips.sum()} of {len(tips)} tip; by margin " + ", ".join(parts)


def picture(rows, path: Path) -> None:
    """Draw predicted over true ways, and tilts over margins."""
    figure, (left, right) = plt.subplots(ncols=2, figsize=(8.4, 4.0))
    for force in sorted({row["force_n"] for row in rows}):
        mine = [row for row in rows if row["force_n"] == force]
        slid = [row for row in mine if row["tilt"] < TIPS]
        ways = ([1e3 * row[k] for row in slid] for k in ("true", "said"))
        left.plot(*ways, "o", ms=3, alpha=0.6, label=f"{force:g} N")
        tilt = np.degrees([row["tilt"] for row in mine])
        margin = [1e3 * row["margin"] for row in mine]
        right.plot(margin, tilt, "o", ms=3, alpha=0.6, label=f"{force:g} N")
    top = max(*left.get_xlim(), *left.get_ylim())
    left.plot([0, top], [0, top], color="0.6", lw=1)
    left.set(xlabel="true way [mm]", ylabel="predicted way [mm]")
    right.axvline(0, color="0.6", lw=1)
    right.set(xlabel="predicted margin of the centre of pressure [mm]")
    right.set_yscale("symlog", linthresh=np.degrees(TIPS))
    right.set(ylabel="largest true tilt [deg]", xlim=(-25, 20), ylim=(0, 100))
    left.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    one_thread()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=120, help="bodies of a kind")
    parser.add_argument("--forces", type=float, nargs="+", default=[8.0, 1.7])
    parser.add_argument("--bodies", nargs="+", default=[*SIDES, "solid"])
    chosen = parser.parse_args()
    numbers = range(chosen.count)
    cases = product(numbers, chosen.forces, chosen.bodies)
    rows = [compared(*case) for case in cases]
    write_csv(chosen.folder / "predicted_pushes.csv", rows)
    picture(rows, chosen.folder / "predicted_pushes.png")
    for force in chosen.forces:
        print(said(rows, force))


if __name__ == "__main__":
    main()
