"""Compare predicted pushes with simulated ones: how far does a body follow an action?

    python examples/benchmarks/predicted_pushes.py folder [--count 120]
        [--forces 8 1.7]

Boxes of 30 to 60 mm, random actions of two fingers whose servos give at most so many
newtons.  The prediction knows the body and where it lies.  Ways are those of the last
sample: a radian of turn counts as ARM.  Printed are for each force the error of the way
(median, mean, 90 %), true and predicted ways, and how many bodies are said to move more
than MOVES that stay within half of it.  The script writes predicted_pushes.csv and
predicted_pushes.png.
"""

import argparse
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
from study import one_thread, write_csv

from formulations.rigid_body import ARM
from formulations.shape import CUBOID
from tactilenlp import Scene, Workspace, World
from tactilenlp.exploration.expected_information import push_constants
from tactilenlp.exploration.push_model import push_function
from tactilenlp.geometry.transforms import rotation_of

SENSORS = 1e3, 0.2e-3, 0.02  # [1/m], [m], [rad]: they do not change the motion
RATE = 30  # steps of an action
MOVES = 1e-3  # [m]


def compared(number: int, force: float) -> dict:
    """Return the true and the predicted way [m] of a box under a random action."""
    rng = np.random.default_rng([number, 40])
    sides, yaw = rng.uniform(0.03, 0.06, 3), rng.uniform(-np.pi, np.pi)
    world = World(
        sides, quaternion=(np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)), max_force=force
    )
    space = Workspace(max_force=force)
    action, begin = space.random(rng), world.pose
    world.execute(action.trajectory(begin[:3]))
    truth = world.truth
    turned = rotation_of(truth.object_quaternion[[0, -1]])
    moved = np.diff(truth.object_position[[0, -1], :2], axis=0)[0]
    true = np.r_[moved, (turned[1] * turned[0].inv()).as_rotvec()[2]]
    z = np.r_[sides, begin[:2], yaw]
    told = predicted(z, action.positions(begin[:3], RATE + 1), space)
    metric = np.array([1, 1, ARM])
    off, way, promised = (
        float(np.linalg.norm(metric * v)) for v in (told - true, true, told)
    )
    return {"force_n": force, "box": number, "off": off, "true": way, "said": promised}


def predicted(z, path, space) -> np.ndarray:
    """Return the planar motion (3,) [m, m, rad] of a box z under a path (n, F, 3)."""
    goals, fingers, k = path.reshape(len(path), -1).T, space.fingers, len(z)
    push = push_function(CUBOID, False, fingers, len(path) - 1)
    rest = np.zeros(3), goals[:, 0], np.zeros(3), np.zeros((3, k)), np.zeros((3, 3))
    radius = np.full(fingers, space.finger_radius)
    told = radius, push_constants(Scene(), space), SENSORS, 1.0
    return push(*rest, z, goals[:, :-1], goals[:, 1:], *told)[2].full()[:, -1]


def said(rows, force: float) -> str:
    """Return the line of one force, in mm."""
    mine = [row for row in rows if row["force_n"] == force]
    at = SimpleNamespace(
        **{k: 1e3 * np.array([r[k] for r in mine]) for k in ("off", "true", "said")}
    )
    limit = 1e3 * MOVES
    false = ((at.said > limit) & (at.true < limit / 2)).sum()
    return (
        f"{force:g} N: off by {np.median(at.off):.2f} mm (median), {at.off.mean():.2f} "
        f"(mean), {np.quantile(at.off, 0.9):.2f} (90 %); ways {np.median(at.true):.2f} "
        f"true, {np.median(at.said):.2f} predicted; over {limit:g} mm: "
        f"{(at.true > limit).sum()} true, {(at.said > limit).sum()} predicted, {false} "
        f"of these within {limit / 2:g} mm; n = {len(mine)}"
    )


def picture(rows, path: Path) -> None:
    """Draw predicted over true ways."""
    figure, axes = plt.subplots(figsize=(4.2, 4.0))
    for force in sorted({row["force_n"] for row in rows}):
        mine = [row for row in rows if row["force_n"] == force]
        ways = ([1e3 * row[k] for row in mine] for k in ("true", "said"))
        axes.plot(*ways, "o", ms=3, alpha=0.6, label=f"{force:g} N")
    top = 1e3 * max(max(row["true"], row["said"]) for row in rows)
    axes.plot([0, top], [0, top], color="0.6", lw=1)
    axes.set(xlabel="true way [mm]", ylabel="predicted way [mm]")
    axes.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    one_thread()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=120, help="boxes")
    parser.add_argument("--forces", type=float, nargs="+", default=[8.0, 1.7])
    chosen = parser.parse_args()
    rows = [compared(k, f) for f in chosen.forces for k in range(chosen.count)]
    write_csv(chosen.folder / "predicted_pushes.csv", rows)
    picture(rows, chosen.folder / "predicted_pushes.png")
    for force in chosen.forces:
        print(said(rows, force))


if __name__ == "__main__":
    main()
