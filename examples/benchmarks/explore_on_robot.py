"""Explore on the simulated robot under the paper's conditions, through all its wires.

python examples/benchmarks/explore_on_robot.py --trials 6 --zero-error 1.0

A box of 58 x 49 x 53 mm and 0.5 kg, two opposing fingers of a TriFingerEdu with
rendered DenseTact pictures, approach angles within pi / 4, starts at random within
2 cm.  The zero angles of the joints are wrong by `--zero-error` degrees (one standard
deviation), constant in a trial.  Writes <output>.csv, a row per trial, policy and step,
and <output>.png in the paper's form; the truth serves only to judge.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # of every library, said before numpy comes

import argparse
import csv
from time import process_time

import matplotlib

matplotlib.use("Agg")
import numpy as np
import trimesh
from matplotlib import pyplot as plt
from scipy import stats
from scipy.spatial.transform import Rotation

from hardware.bench import Bench
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.world import RobotWorld
from tactilenlp import Scene, Workspace, explore, surface_distance
from tactilenlp.metrics import chamfer_code

BOX = (0.058, 0.049, 0.053)  # [m], the paper's
NEAR = 0.02  # [m], starts about the middle of the workspace
PUSH = 160.0, 1.7  # [N/m], [N] of a finger: stiffness and strength of its joints
COLUMNS = ("trial", "policy", "step", "p2s_mm", "bch_mm", "side_error_mm", "cpu_s")


def true_mesh(pose: np.ndarray) -> trimesh.Trimesh:
    """Return the box at a pose (7,), position [m] and quaternion wxyz."""
    placed = np.eye(4)
    placed[:3, :3] = Rotation.from_quat(np.roll(pose[3:], -1)).as_matrix()
    placed[:3, 3] = pose[:3]
    return trimesh.creation.box(BOX, transform=placed)


def trial(number: int, policy: str, options: argparse.Namespace):
    """Yield a row after the first touch and after each action."""
    rng = np.random.default_rng([number, 5])
    place, yaw = rng.uniform(-NEAR, NEAR, 2), rng.uniform(-np.pi, np.pi)
    robot = SimulatedRobot(
        simulated_rig("densetact", f"{number} {policy}"),
        BOX,
        position=place,
        quaternion=(np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)),
        zero_error=np.deg2rad(options.zero_error) * rng.normal(size=(2, 3)),
        seed=number,
    )
    past: list[tuple[float, np.ndarray]] = []
    robot.after = lambda now: past.append((now, robot.pose))
    wires = {"clock": robot, "reader": robot.reader, "listen_only": False}
    with robot, Bench(robot.rig, **wires) as bench:
        world = RobotWorld(bench)
        stiffness, force = PUSH
        radius = float(world.finger_radius.max())
        space = Workspace.robot(
            finger_radius=radius, radius=0.12, stiffness=stiffness, max_force=force
        )
        began = process_time()
        for step in explore(
            world, Scene(), options.actions, policy, seed=number, workspace=space,
            centre=(*place, BOX[2] / 2), budget=options.budget,
        ):  # fmt: skip
            end = world.origin + step.measurements.time[-1]
            row = np.searchsorted([now for now, _ in past], end)
            mesh, true = step.estimate.mesh(), true_mesh(past[row][1])
            sides = np.sort(step.estimate.side_lengths) - np.sort(BOX)
            yield {
                "trial": number,
                "policy": policy,
                "step": step.number,
                "p2s_mm": 1e3 * surface_distance(mesh, true).mean,
                "bch_mm": 1e3 * chamfer_code(mesh, true),
                "side_error_mm": 1e3 * np.abs(sides).max(),
                "cpu_s": process_time() - began,
            }


def draw(path: str, rows: list[dict], policies: list[str]) -> None:
    """Save mean and 95 % interval of the mean of each policy after every step."""
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.4))
    titles = "exact surface distance [mm]", "bCH of the paper's code [mm]"
    for axes, key, title in zip(panels, ("p2s_mm", "bch_mm"), titles, strict=True):
        for policy in policies:
            steps, means, halves = summary(rows, policy, key)
            axes.plot(steps, means, "o-", label=policy)
            axes.fill_between(steps, means - halves, means + halves, alpha=0.2)
        axes.set(xlabel="actions after the first touch", ylabel=title, ylim=(0, None))
        axes.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def summary(rows: list[dict], policy: str, key: str):
    """Return steps, means, and half widths of the 95 % interval of the mean."""
    mine = [row for row in rows if row["policy"] == policy]
    steps = sorted({row["step"] for row in mine})
    groups = [[row[key] for row in mine if row["step"] == step] for step in steps]
    means = np.array([np.mean(group) for group in groups])
    halves = [
        stats.t.ppf(0.975, len(g) - 1) * stats.sem(g) if len(g) > 1 else 0.0
        for g in groups
    ]
    return np.array(steps), means, np.array(halves)


def main() -> None:
    """Run all trials, write as they come, draw and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first trial"
    )
    parser.add_argument("--actions", type=int, default=5)
    parser.add_argument("--policies", nargs="+", default=["eig", "random"])
    parser.add_argument("--zero-error", type=float, default=1.0, help="[deg]")
    parser.add_argument("--budget", type=int, default=60, help="evaluations per choice")
    parser.add_argument("--output", default="explore_on_robot")
    options = parser.parse_args()
    rows = []
    with open(f"{options.output}.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for number in range(options.first, options.first + options.trials):
            for policy in options.policies:
                for row in trial(number, policy, options):
                    rows.append(row)
                    writer.writerow(row)
                    file.flush()
    draw(f"{options.output}.png", rows, options.policies)
    last = max(row["step"] for row in rows)
    for policy in options.policies:
        ends = [r for r in rows if r["policy"] == policy and r["step"] == last]
        p2s, bch = ([row[key] for row in ends] for key in ("p2s_mm", "bch_mm"))
        print(
            f"{policy}: after {last} actions p2s {np.median(p2s):.2f} mm "
            f"(median of {len(ends)}), bCH {np.mean(bch):.2f} mm (mean)"
        )


if __name__ == "__main__":
    main()
