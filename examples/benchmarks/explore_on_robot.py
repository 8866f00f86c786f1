"""Explore on the simulated robot under the paper's conditions, through its buses.

    python examples/benchmarks/explore_on_robot.py folder [--trials 6]
        [--policies eig random] [--actions 5] [--offsets constant ignored]
        [--executor processes|dask|mpi|none]

A box of 58 x 49 x 53 mm and 0.5 kg, two opposing fingers of a TriFingerEdu with
rendered DenseTact pictures, approach angles within pi / 4, starts at random within
2 cm.  The zero angles of all joints are wrong by about a degree, constant in a trial,
so that a tip at rest is 3 to 5 mm from its reported position, as in the paper.

The fingers' joint zeros are unknowns of the estimates that choose the actions
("joints"); afterwards the same touches are estimated with a constant offset of each
finger as an unknown ("constant"), and without offsets ("ignored").  The truth is used
for errors only.  Trials are kept in trials.jsonl and judged.jsonl (study.py), with
their measurements (.npz); called again, the study resumes.  It writes trials.csv,
table.txt and real.png, the paper's figure.
"""

from functools import partial
from itertools import chain, product
from pathlib import Path
from time import process_time

import numpy as np
import trimesh
from chamfer import chamfer_code, chamfer_floor
from judging import placed
from robot_report import OFFSETS, draw, table
from scipy.spatial.transform import Rotation
from study import executor_of, run_study, study_parser, write_csv

from hardware.bench import Bench
from hardware.errors import LimitError
from hardware.kinematics import INITIAL, joints_about
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.world import RobotWorld
from tactilenlp import (
    JointZeros,
    Measurements,
    Options,
    Scene,
    Workspace,
    explore,
    solve_estimate,
)
from tactilenlp.evaluation.metrics import surface_distance
from tactilenlp.geometry.transforms import rotation_of

BOX = (0.058, 0.049, 0.053)  # [m], the paper's
NEAR = 0.02  # [m], starts about the middle of the workspace
ZERO = np.deg2rad(1.0)  # deviation of a joint's zero angle
TIP = 3e-3, 5e-3  # [m], the paper's error of a fingertip at rest
PUSH = 160.0, 1.7  # [N/m], [N] of a finger: stiffness and strength of its joints
# [rad] On flat faces, with right zero angles, normals are 3 mrad off (trials 1390 to
# 1392, 289 samples), alike in the ten samples of a touch, therefore sqrt(10) as much.
NORMAL = 0.01
OFFSET = 4e-3 / np.sqrt(3)  # [m] deviation of each coordinate of a tip 4 mm off
PLACES = [[0.05, 0.0, 0.04], [-0.05, 0.0, 0.04]]  # [m] about which either tip works
OPTIONS = Options(time_limit=300.0)  # [s] on the wall: for a machine that is busy


def zero_errors(rig, rng) -> np.ndarray:
    """Return errors of zero angles (F, 3) [rad] that put each tip TIP off at rest."""
    out = []
    for finger in rig.fingers:
        off = 0.0
        while not TIP[0] < off < TIP[1]:
            error = ZERO * rng.normal(size=3)
            off = np.linalg.norm(finger.geometry.jacobian(INITIAL) @ error)
        out.append(error)
    return np.array(out)


def robot_of(number: int, policy: str) -> SimulatedRobot:
    """Return the robot of a trial: the same object and errors under every policy."""
    rng = np.random.default_rng([number, 5])
    place, yaw = rng.uniform(-NEAR, NEAR, 2), rng.uniform(-np.pi, np.pi)
    rig = simulated_rig("densetact", f"{number} {policy}")
    return SimulatedRobot(
        rig, BOX, position=place, seed=number, zero_error=zero_errors(rig, rng),
        quaternion=(np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)),
    )  # fmt: skip


def scenes_of(rig) -> dict[str, Scene]:
    """Return what is known of the fingers, in the order of OFFSETS."""
    about = joints_about([finger.geometry for finger in rig.fingers], PLACES)
    known = {"joints": JointZeros(ZERO, **about), "constant": OFFSET, "ignored": None}
    return {
        name: Scene(sigma_normal=NORMAL, sigma_offset=known[name]) for name in OFFSETS
    }


def run(
    number: int, policy: str, actions: int, budget: int, folder: Path
) -> list[dict]:
    """Return a row after the first touch and after each action; keep what was felt."""
    robot, past, rows = robot_of(number, policy), [], []
    begin, scene = robot.pose[:3], scenes_of(robot.rig)["joints"]
    robot.after = lambda now: past.append((now, robot.pose))
    wires = {"clock": robot, "reader": robot.reader, "listen_only": False}
    with robot, Bench(robot.rig, **wires) as bench:
        world = RobotWorld(bench)
        stiffness, force = PUSH
        space = Workspace.robot(
            finger_radius=float(world.finger_radius.max()), radius=0.12,
            stiffness=stiffness, max_force=force,
        )  # fmt: skip
        steps = explore(
            world, scene, actions, policy, seed=number, workspace=space,
            centre=begin, budget=budget, options=OPTIONS,
        )  # fmt: skip
        try:
            for step in steps:
                data = step.estimate.measurements
                now = [now for now, _ in past]
                pose = past[np.searchsorted(now, world.origin + data.time[-1])][1]
                row = {"trial": number, "policy": policy, "step": step.number}
                row |= {"last": int(data.action[-1]), "pose": pose.tolist()}
                row |= {"moved_mm": 1e3 * np.linalg.norm(pose[:2] - begin[:2])}
                row |= {"choose_s": step.seconds["choose"], "offset": OFFSETS[0]}
                row |= {"cpu_s": step.seconds["estimate"]}
                rows.append(row | errors(step.estimate, pose))
        except LimitError as stop:  # the robot's own guard ends a trial, not the study
            return [{"trial": number, "policy": policy, "stopped": str(stop)}]
    data.save(folder / f"{number:03d}_{policy}.npz")
    return rows


def judge(
    number: int, policy: str, offset: str, told: list[list[dict]], folder: Path
) -> list[dict]:
    """Return rows of the same touches, the fingers' errors taken another way."""
    data = Measurements.load(folder / f"{number:03d}_{policy}.npz")
    scene, found, out = scenes_of(simulated_rig("densetact"))[offset], None, []
    for row in chain.from_iterable(told):
        if (row["trial"], row["policy"]) != (number, policy):
            continue
        part, began = data.select(range(row["last"] + 1)), process_time()
        found = solve_estimate(part, scene, start=found, options=OPTIONS, throw=False)
        row = row | {"offset": offset, "cpu_s": process_time() - began}
        out.append(row | errors(found, np.array(row["pose"])))
    return out


def completed(cases, told) -> tuple[list, list, list[int]]:
    """Return cases and rows without trials that the robot ended, and these trials."""
    stopped = {row["trial"] for rows in told for row in rows if "stopped" in row}
    kept = [case for case in cases if case[0] not in stopped]
    rows = [rows for rows in told if rows[0]["trial"] not in stopped]
    return kept, rows, sorted(stopped)


def said(case, rows) -> str:
    """Return a trial that ended in words."""
    last = rows[-1]
    found = last.get("stopped") or f"{last['offset']} {last['p2s_mm']:.2f} mm"
    return f"trial {case[0]}, {case[1]}: {found}"


def errors(estimate, pose: np.ndarray) -> dict:
    """Return what an estimate is off from the box at a pose (7,) [mm, deg]."""
    true = placed(trimesh.creation.box(BOX), *np.split(pose, [3]))
    turn, found = rotation_of(pose[3:]), estimate.mesh()
    off, C = error_of(estimate, pose, turn), covariance_of(estimate.information)
    sides, place, yaw = np.split(off, [3, 5])
    centred = found.copy()
    centred.apply_translation(pose[:3] - estimate.position[-1])
    return {
        "p2s_mm": 1e3 * surface_distance(found, true).mean,
        "centred_mm": 1e3 * surface_distance(centred, true).mean,
        "bch_mm": 1e3 * chamfer_code(found, true),
        "bch_floor_mm": 1e3 * chamfer_floor(true),
        "side_mm": 1e3 * np.abs(sides).max(),
        "place_mm": 1e3 * np.linalg.norm(place),
        "yaw_deg": np.degrees(yaw[0]),
        "nees": float(off @ np.linalg.solve(C, off)) / len(off),
        "success": bool(estimate.success),
    }


def error_of(estimate, pose: np.ndarray, turn: Rotation) -> np.ndarray:
    """Return the error (6,) of sides, place and yaw [m, rad], the box named alike."""
    yaw = turn.as_euler("xyz")[2]
    mine = np.arctan2(estimate.rotation()[1, 0], estimate.rotation()[0, 0])
    quarters = round((mine - yaw) / (np.pi / 2))
    sides = np.array(BOX)[[1, 0, 2] if quarters % 2 else [0, 1, 2]]
    off = mine - yaw - quarters * np.pi / 2
    place = estimate.position[-1][:2] - pose[:2]
    return np.r_[estimate.side_lengths - sides, place, off]


def covariance_of(information) -> np.ndarray:
    """Return the covariance (6, 6) of sides, place and yaw [m, rad].

    The body may be tilted or flat.
    """
    maps = information.maps
    rows = maps["side_lengths"], maps["position"][:2], maps["rotation"][2:]
    jacobian = np.vstack(rows)
    C = jacobian @ information.covariance_matrix @ jacobian.T
    if information.ground is not None:
        C[3:, 3:] += information.ground[np.ix_([0, 1, 5], [0, 1, 5])]
    return C


def main() -> None:
    """Run what is not there yet, then write table and figure."""
    parser = study_parser(__doc__)
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--first", type=int, default=0, help="number of a first trial")
    parser.add_argument("--actions", type=int, default=5)
    parser.add_argument("--policies", nargs="+", default=["eig", "random"])
    parser.add_argument("--budget", type=int, default=60, help="evaluations per choice")
    parser.add_argument(
        "--offsets", nargs="*", choices=OFFSETS[1:], default=OFFSETS[1:],
        help="other ways to take the fingers' errors, once all touches are there",
    )  # fmt: skip
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.trials)
    cases = list(product(numbers, options.policies))
    about = {"actions": options.actions, "budget": options.budget}
    size = simulated_rig("densetact").fingers[0].tactile.camera["size"]
    kept, where = about | {"pictures": list(size)}, options.folder
    trial = partial(run, folder=where, **about)
    with executor_of(options) as executor:
        told = run_study(
            where / "trials.jsonl", "robot", trial, cases, executor, kept, said
        )
        cases, told, stopped = completed(cases, told)
        again = partial(judge, told=told, folder=where)
        more = [(*case, offset) for offset in options.offsets for case in cases]
        judged = run_study(
            where / "judged.jsonl", "robot judged", again, more, executor, kept, said
        )
    rows = list(chain.from_iterable(told + judged))
    write_csv(where / "trials.csv", rows)
    steps = range(options.actions + 1)
    words = table(rows, options.policies, steps)
    words += f"\nstopped by the robot, with their pairs left out: {stopped}"
    (where / "table.txt").write_text(words + "\n")
    draw(where / "real.png", rows, options.policies, steps)
    print(words)


if __name__ == "__main__":
    main()
