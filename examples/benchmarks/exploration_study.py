"""Repeat the paper's simulation study: how fast do chosen actions find a cuboid?

    python examples/benchmarks/exploration_study.py folder [--trials 10] [--actions 5]
        [--policies eig random fisher farthest] [--starts ours paper]
        [--executor processes|dask|mpi|none] [--address tcp://scheduler:8786]

Cuboids of 3 to 6 cm at random poses within 2 cm of the centre; one finger touches
first, centred on the truth, then two fingers act five times.  A trial has the same
object, pose and first touch under every policy: pairs.  Every trial is kept in one file
(study.py) as soon as it is done; called again, the study goes on from there.  `ours`
starts from the first touch, `paper` from a random guess of 1 to 3 cm.  Writes
trials.csv and what exploration_report.py makes of it.  Dask and MPI are extras: pip
install "tactilenlp[dask]" or "[mpi]".
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread a process: before NumPy

import argparse
import csv
from itertools import product
from pathlib import Path

import numpy as np
from exploration_report import FILE, report
from study import add_executor, executor_of, run_study
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp import Guess, Scene, World, explore, metrics

SIZES, WITHIN = (0.03, 0.06), 0.02  # [m] of the cuboids, of their centres
GUESSED = (0.01, 0.03)  # [m] sizes of the paper's guesses
SEED = 2026  # of all trials; trial k has generators of (SEED, k)
POINTS = 1000  # a surface


def world_of(trial: int) -> World:
    """Return the trial's object where it lies at first."""
    rng = np.random.default_rng([SEED, trial])
    yaw = rng.uniform(0, 2 * np.pi)
    return World(
        rng.uniform(*SIZES, 3),
        position=WITHIN * np.sqrt(rng.random()) * circle(rng),
        quaternion=[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)],
    )


def circle(rng) -> np.ndarray:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


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
    true = box(world.side_lengths, translation_matrix(where) @ quaternion_matrix(turn))
    found = estimate.mesh()
    exact = metrics.surface_distance(found, true, samples=POINTS)
    sides, pose = (
        estimate.side_lengths,
        (estimate.position[-1], estimate.quaternion[-1]),
    )
    off = metrics.cuboid_errors(sides, *pose, world.side_lengths, where, turn)
    moved = np.linalg.norm(where - truth.object_position[0])
    information = estimate.information
    return {
        "p2s_mm": exact.mean * mm,
        "p2s_max_mm": exact.maximum * mm,
        "bch_mm": metrics.chamfer_code(found, true, POINTS) * mm,
        "bch_floor_mm": metrics.chamfer_floor(true, POINTS) * mm,
        "side_mm": np.abs(off.side_lengths).max() * mm,
        "position_mm": np.linalg.norm(off.position) * mm,
        "rotation_deg": np.degrees(off.rotation_angle),
        "logdet": np.linalg.slogdet(information.matrix)[1],
        "sigma_side_mm": information.sigma("side_lengths").max() * mm,
        "unobserved": len(information.unobserved),
        "success": estimate.success,
        "tilt_deg": np.degrees(np.arccos(min(1, 1 - 2 * (turn[1:3] ** 2).sum()))),
        "moved_mm": moved * mm,
    }


def run(trial: int, policy: str, start: str, actions: int, budget: int) -> list[dict]:
    """Return one row an action of a trial."""
    world, rows = world_of(trial), []
    centre, guess = world.pose[:3], guess_of(trial, start)
    given = {"policy": policy, "actions": actions, "seed": trial, "budget": budget}
    try:
        for step in explore(world, Scene(), centre=centre, start=guess, **given):
            row = {"trial": trial, "policy": policy, "start": start}
            row |= {"action": step.number, "did": step.policy}
            row |= errors(world, step.estimate)
            row["contacts"] = int(step.measurements.contact.sum())
            row["gain"] = step.choice.gain if step.choice else np.nan
            row |= {f"cpu_{name}": s for name, s in step.seconds.items()}
            row["sides_mm"] = [s * 1e3 for s in step.estimate.side_lengths]
            row |= picture(world, step.estimate)
            rows.append(row)
    except Exception as error:  # a trial that breaks is a row, not the study's end
        row = {"trial": trial, "policy": policy, "start": start, "success": False}
        rows.append(row | {"action": len(rows), "error": f"{error!r:.300}"})
    return rows


def picture(world: World, estimate) -> dict:
    """Return what the learning strip draws: vertices [mm] about the true centre."""
    where, turn = estimate.position[-1], estimate.rotation()
    centre = world.truth.object_position[-1]
    spot = lambda p: ((p - centre) * 1e3).round(3).tolist()  # noqa: E731
    true = quaternion_matrix(world.truth.object_quaternion[-1])[:3, :3]
    corners = np.indices((2, 2, 2)).reshape(3, 8).T - 0.5
    return {
        "vertices": spot(where + estimate.vertices @ turn.T),
        "true_vertices": spot(centre + (corners * world.side_lengths) @ true.T),
    }


def study(arguments) -> list[dict]:
    """Run what is not there yet; return the rows of all trials."""
    folder = Path(arguments.folder)
    folder.mkdir(parents=True, exist_ok=True)
    asked = arguments.trials, arguments.policies, arguments.starts
    rest = {"actions": arguments.actions, "budget": arguments.budget}
    cases = [(*case, *rest.values()) for case in product(range(asked[0]), *asked[1:])]
    scripts = __file__, Path(__file__).with_name("exploration_report.py")
    with executor_of(arguments, *scripts) as executor:
        found = run_study(
            folder / FILE, "exploration", run, cases, executor, rest, _words
        )
    return [row for rows in found for row in rows]


def _words(case, rows) -> str:
    last = rows[-1]
    trial, policy, start, *_ = case
    ended = last.get("error") or f"{last['p2s_mm']:.3f} mm"
    return f"trial {trial}, {policy}, {start}: {ended}"


def write_csv(rows: list[dict], path: Path) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    names = [n for n in names if not n.endswith("vertices")]
    with open(path, "w", newline="") as stream:
        table = csv.DictWriter(stream, names, extrasaction="ignore")
        table.writeheader()
        table.writerows(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--actions", type=int, default=5)
    parser.add_argument("--budget", type=int, default=180)
    parser.add_argument("--policies", nargs="+", default=["eig", "random"])
    parser.add_argument("--starts", nargs="+", default=["ours"])
    add_executor(parser)
    arguments = parser.parse_args()
    rows = study(arguments)
    write_csv(rows, Path(arguments.folder) / "trials.csv")
    report(rows, Path(arguments.folder))


if __name__ == "__main__":
    main()
