"""Repeat the paper's simulation study: error against number of actions, by policy.

    python examples/benchmarks/exploration_study.py folder [--trials 10]
        [--objects cuboid|polytope] [--actions 5]
        [--policies eig random fisher farthest] [--starts ours paper] [--noise]
        [--executor processes|dask|mpi|none] [--address tcp://scheduler:8786]

The objects are cuboids of 3 to 6 cm, or Platonic solids of 2 cm bounding radius that
are estimated as polytopes, at random poses within 2 cm of the centre
(exploration_objects.py).  One finger touches first, centred on the truth; then two
fingers act five times, or eight times on a solid.  A trial has the same object, pose
and first touch under every policy, so that policies are compared in pairs.  Every trial
is saved in one file (study.py) when it is done; called again, the study resumes from
it.  `ours` starts from the first touch, `paper` from a random guess of 1 to 3 cm
(cuboids only).  --noise: sensors with 1 mm, 5 degrees and 1 % flipped booleans; the
scene does not tell.  The script writes trials.csv, and by exploration_report.py
bch.png, strip.png and table.txt.
Dask and MPI are extras: pip install "tactilenlp[dask]" or "[mpi]".
"""

from itertools import product

import numpy as np
from exploration_objects import corners, errors, guess_of, world_of
from exploration_report import FILE, report
from study import executor_of, run_study, study_parser, telling, write_csv
from trimesh.transformations import quaternion_matrix

from tactilenlp import Scene, World, explore, vertex_information

ACTIONS = {"cuboid": 5, "polytope": 8}  # of the paper, after the first touch


def run(
    trial: int, policy: str, start: str, actions: int, budget: int, objects="cuboid",
    noisy=False,
) -> list[dict]:  # fmt: skip
    """Return one row an action of a trial."""
    world, rows = world_of(trial, objects, noisy), []
    centre, guess = world.pose[:3], guess_of(trial, start)
    given = {"policy": policy, "actions": actions, "seed": trial, "budget": budget}
    about = {"trial": trial, "policy": policy, "start": start, "objects": objects}
    given |= {"shape": objects}
    try:
        for step in explore(world, Scene(), centre=centre, start=guess, **given):
            row = about | {"action": step.number, "did": step.policy}
            row |= errors(world, step.estimate)
            row["contacts"] = int(step.measurements.contact.sum())
            row["gain"] = step.choice.gain if step.choice else np.nan
            row |= {f"cpu_{name}": s for name, s in step.seconds.items()}
            if objects == "cuboid":
                row["sides_mm"] = [s * 1e3 for s in step.estimate.side_lengths]
            else:
                row["vertex_nats"] = vertex_information(step.estimate).tolist()
            row |= picture(world, step.estimate)
            rows.append(row)
    except Exception as error:  # a trial that breaks is a row, not the study's end
        told = {"action": len(rows), "error": f"{error!r:.300}", "success": False}
        rows.append(about | told)
    return rows


def picture(world: World, estimate) -> dict:
    """Return what the learning strip draws: vertices [mm] about the true centre."""
    where, turn = estimate.position[-1], estimate.rotation()
    centre = world.truth.object_position[-1]
    spot = lambda p: ((p - centre) * 1e3).round(3).tolist()  # noqa: E731
    true = quaternion_matrix(world.truth.object_quaternion[-1])[:3, :3]
    return {
        "vertices": spot(where + estimate.vertices @ turn.T),
        "true_vertices": spot(centre + corners(world) @ true.T),
    }


def study(arguments) -> list[dict]:
    """Run what is not there yet; return the rows of all trials."""
    numbers = range(arguments.first, arguments.first + arguments.trials)
    asked = product(numbers, arguments.policies, arguments.starts)
    actions = arguments.actions
    actions = ACTIONS[arguments.objects] if actions is None else actions
    rest = {"actions": actions, "budget": arguments.budget}
    rest |= {"objects": arguments.objects}
    rest |= {"noisy": True} if arguments.noise else {}
    cases = [(*case, *rest.values()) for case in asked]
    with executor_of(arguments) as executor:
        found = run_study(
            arguments.folder / FILE, "exploration", run, cases, executor, rest,
            say=telling("error", "p2s_mm"),
        )  # fmt: skip
    return [row for rows in found for row in rows]


def tabled(row: dict) -> dict:
    """Return what a table has of a row: all but what there is of each vertex."""
    lists = "vertices", "vertex_nats"
    return {k: v for k, v in row.items() if not k.endswith(lists)}


def main() -> None:
    parser = study_parser(__doc__)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="number of a first trial")
    parser.add_argument("--objects", choices=ACTIONS, default="cuboid")
    parser.add_argument("--actions", type=int, help="5, or 8 on a polytope")
    parser.add_argument("--budget", type=int, default=180)
    parser.add_argument("--policies", nargs="+", default=["eig", "random"])
    parser.add_argument("--starts", nargs="+", default=["ours"])
    parser.add_argument("--noise", action="store_true", help="noisy sensors")
    arguments = parser.parse_args()
    if arguments.objects == "polytope" and "paper" in arguments.starts:
        parser.error("polytopes: --starts ours only")
    rows = study(arguments)
    write_csv(arguments.folder / "trials.csv", [*map(tabled, rows)])
    report(rows, arguments.folder)


if __name__ == "__main__":
    main()
