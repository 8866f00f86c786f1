"""Benchmark each reduction: sizes, time and optimum with it and without it.

python examples/benchmarks/reductions.py ../shared/scenes/cuboid_0[0-2].npz

Every way of writing one problem starts at the same hypothesis, the best of a search.
Times are medians of passes that try all ways in turn, so that ratios are of one run;
a first pass, uncounted, derives the kinds.  Sensors, ground or friction that a scene
has not are other problems, with optima of their own, and stand apart.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # of every library, said before numpy comes

import argparse
import csv
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import Measurements, Problem, Scene, SolverOptions, solve_estimate
from tactilenlp.precision import precision_of, smoothed
from tactilenlp.reduce import Reductions, reduce
from tactilenlp.solve import solve_levels
from tactilenlp.tipping import lifted

BASE = "all reductions"
EXACT = ("still", "far", "absent")
OFF = {BASE: (), **{f"without {n}": (n,) for n in (*EXACT, "planar")}}
OFF |= {"planar alone": EXACT, "no reduction": (*EXACT, "planar")}
HEADS = ("variables", "constraints", "terms", "presolve", "joint", "ms/it", "CPU s")


def one_finger(data, arrays: bool) -> Measurements:
    """Return the data of finger 0; the others never valid, or not in the arrays."""
    keys = ("time", "finger_position", "finger_radius", "contact", "normal", "action")
    given = {key: getattr(data, key) for key in (*keys, "valid")}
    if not arrays:
        return Measurements(
            **given | {"valid": data.valid & (np.arange(data.fingers) < 1)}
        )
    per_finger = ("finger_position", "contact", "normal", "valid")
    given |= {key: given[key][:, :1] for key in per_finger}
    return Measurements(**given | {"finger_radius": data.finger_radius[:1]})


def problems(data, scene) -> dict:
    """Return (measurements, scene, reductions off) by name."""
    slippery = replace(scene, friction_ground=0.0, friction_finger=0.0)
    floating = replace(scene, ground=None, gravity=0.0)
    out = {name: (data, scene, off) for name, off in OFF.items()}
    if data.fingers > 1:
        out["second finger never valid"] = one_finger(data, False), scene, ()
        out["no second finger"] = one_finger(data, True), scene, ()
    return out | {
        "no friction": (data, slippery, ()),
        "no ground": (data, floating, ()),
    }


def solved(data, scene, off, theta, x) -> dict:
    """Build and solve one problem from theta (3,) [m] and planar poses x (3, T)."""
    began = process_time()
    precision = precision_of(data, scene)
    data, choice = smoothed(data, precision), Reductions.of(off)
    x = x if choice.planar else lifted(theta, x)
    window = reduce(data, scene, CUBOID, precision, choice, guess=(theta, x))
    problem = Problem()
    page.build(problem, window, scene, CUBOID)
    start = {"theta": theta, "x": x[:, window.last]}
    solution = solve_levels(problem, page.LEVELS, start, SolverOptions())
    *presolve, joint = solution.iterations_by_level
    return {
        "variables": problem.size,
        "constraints": problem.rows,
        "terms": sum(term.instances for term in problem.terms.values()),
        "presolve": sum(presolve),
        "joint": joint,
        "ms/it": 1e3 * solution.seconds["solve"] / max(1, solution.iterations),
        "CPU s": process_time() - began,
        "optimum": solution.objective,
        "status": solution.status,
    }


def tried(*arguments) -> dict:
    """Return what a problem took, or its failure."""
    try:
        return solved(*arguments)
    except Exception as error:  # whatever it is, it is a line of the table
        failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return dict.fromkeys((*HEADS, "optimum"), np.nan) | {"status": failure}


def scene_table(file, passes) -> list[dict]:
    """Return a row for every way of writing the problem of one recording."""
    data, scene = Measurements.load(file), Scene.load(file)
    best = solve_estimate(data, scene, throw=False).hypotheses[0]
    ways = {
        name: (*way, best.theta, best.x) for name, way in problems(data, scene).items()
    }
    _, *runs = [
        {name: tried(*way) for name, way in ways.items()} for _ in range(1 + passes)
    ]
    rows = []
    for name in ways:
        row = {"scene": Path(file).stem, "way": name} | runs[-1][name]
        for key in ("ms/it", "CPU s"):
            row[key] = float(np.median([run[name][key] for run in runs]))
        ratio = [run[name]["CPU s"] / run[BASE]["CPU s"] for run in runs]
        apart = row["optimum"] - runs[-1][BASE]["optimum"]
        rows.append(row | {"times as long": float(np.median(ratio)), "apart": apart})
    return rows


def print_table(rows) -> None:
    print(f"\n{rows[0]['scene']:28}" + "".join(f"{head:>12}" for head in HEADS)
          + "   x as long       optimum     apart")  # fmt: skip
    for row in rows:
        sizes = "".join(f"{row[head]:12.0f}" for head in HEADS[:5])
        print(
            f"{row['way']:28}{sizes}{row['ms/it']:12.2f}{row['CPU s']:12.2f}"
            f"{row['times as long']:12.2f}{row['optimum']:14.4f}{row['apart']:10.4f}"
            f"  {'' if row['status'] == 'Solve_Succeeded' else row['status'][:200]}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--passes", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    arguments = parser.parse_args()
    rows = []
    for file in arguments.files:
        rows += (found := scene_table(file, arguments.passes))
        print_table(found)
    print(
        "\nTimes as long as with all reductions, over all files: median (least, most)"
    )
    for way in OFF:
        ratio = [row["times as long"] for row in rows if row["way"] == way]
        print(f"{way:28}{np.median(ratio):8.2f} ({min(ratio):.2f}, {max(ratio):.2f})")
    arguments.out.mkdir(parents=True, exist_ok=True)
    with open(arguments.out / "reductions.csv", "w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
