"""Benchmark each reduction: sizes, time and optimum with it and without it.

python examples/benchmarks/reductions.py ../shared/scenes/cuboid_0?.npz
    [--executor processes|dask|mpi|none]

Both ways of writing one problem start at the same hypothesis, the best of a search.
Times are medians of passes that try all ways in turn, so that ratios are of one run;
a first pass, uncounted, derives the kinds.

Still, far, absent and planar leave out what one recording does not need.  Frictionless,
one finger and no ground are other scenes, each written with and without what it has
not: tangential impulses that no cone allows, a finger that never measures, a ground
without friction a metre below a simulated box that floats.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # of every library, said before numpy comes

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from types import SimpleNamespace

import numpy as np
from study import add_executor, executor_of, mapped, write_csv

from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import (
    Ground,
    Measurements,
    Problem,
    Scene,
    SolverOptions,
    solve_estimate,
)
from tactilenlp.floating import floated, plane_of_touch
from tactilenlp.precision import precision_of, smoothed
from tactilenlp.reduce import Reductions, reduce
from tactilenlp.simulate import World
from tactilenlp.solve import solve_levels
from tactilenlp.tipping import lifted

BASE = "all reductions"
EXACT = ("still", "far", "absent")
NONE = (*EXACT, "planar")
PAIRS = {  # what is left out: with it, without it
    **{name: (f"without {name}", BASE) for name in NONE},
    "frictionless": ("tangential impulses kept", "no friction"),
    "one finger": ("second finger never valid", "no second finger"),
    "no ground": ("ground out of reach", "no ground"),
    "still, far, absent": ("planar alone", BASE),
    "all": ("no reduction", BASE),
}
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
REACH = 1.0  # [m] over a ground out of reach
HEADS = ("variables", "constraints", "terms", "presolve", "joint", "ms/it", "CPU s")


@dataclass(frozen=True)
class Way:
    """One way of writing a problem: reductions off; up [m] from the guessed height."""

    data: Measurements
    scene: Scene
    off: tuple = ()
    up: float = 0.0


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


def problems(data, scene) -> dict[str, Way]:
    """Return the ways of writing the problem of a recording, and of scenes like it."""
    slippery = replace(scene, friction_ground=0.0, friction_finger=0.0)
    out = {BASE: Way(data, scene), "planar alone": Way(data, scene, EXACT)}
    out |= {f"without {name}": Way(data, scene, (name,)) for name in NONE}
    if data.fingers > 1:
        out["second finger never valid"] = Way(one_finger(data, False), scene)
        out["no second finger"] = Way(one_finger(data, True), scene)
    return out | {
        "no reduction": Way(data, scene, NONE),
        "no friction": Way(data, slippery),
        "tangential impulses kept": Way(data, slippery, ("frictionless",)),
    }


def floating() -> tuple[dict[str, Way], np.ndarray, np.ndarray]:
    """Return both ways for a box that two fingers squeeze, and where it was found."""
    world = World((0.04, 0.06, 0.05), position=(0, 0, 0.2), ground=None, gravity=0.0)
    left, right = [(-0.06, 0.008, 0.204), (0, 0.008, 0.204)], [(0.07, -0.01, 0.196)]
    path = np.stack([left, [*right, (0.035, -0.01, 0.196)]], axis=1)
    world.execute(SimpleNamespace(time=np.array([0, 1.2]), finger_position=path))
    data, scene = world.measurements, Scene(ground=None, gravity=0, friction_ground=0)
    raised = data.transformed(np.eye(3), np.array([0, 0, REACH]))
    below = replace(scene, ground=Ground())
    ways = {
        "no ground": Way(data, scene, ("planar",)),
        "ground out of reach": Way(raised, below, ("planar",), REACH),
    }
    best = solve_estimate(data, scene, throw=False).hypotheses[0]
    h = floated(best, plane_of_touch(data, CUBOID.size_prior[0]))
    return ways, h.theta, h.x


def written(way, theta, x):
    """Return the problem and its start, from theta (3,) [m], planar poses x (3, T)."""
    precision = precision_of(way.data, way.scene)
    data, choice = smoothed(way.data, precision), Reductions.of(way.off)
    if not choice.planar:
        x = lifted(theta, x) if len(x) == 3 else x
        x = x + np.array([[0], [0], [way.up], [0], [0], [0]])
    window = reduce(data, way.scene, CUBOID, precision, choice, guess=(theta, x))
    if way.up:  # it does not rest there
        window = replace(window, rest=window.rest.pick(slice(0)))
    problem = Problem()
    page.build(problem, window, way.scene, CUBOID)
    return problem, {"theta": theta, "x": x[:, window.last]}


def solved(way, theta, x) -> dict:
    """Build and solve one problem."""
    began = process_time()
    problem, start = written(way, theta, x)
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
    """Return a row for every way of writing the problem of one recording.

    file: None, for the box that floats.
    """
    if file is None:
        return timed("a floating box", *floating(), passes)
    data, scene = Measurements.load(file), Scene.load(file)
    best = solve_estimate(data, scene, throw=False).hypotheses[0]
    ways = problems(data, scene)
    return timed(Path(file).stem, ways, best.theta, best.x, passes)


def timed(scene, ways, theta, x, passes) -> list[dict]:
    """Return a row for every way, with median times; a first pass is not counted."""
    _, *runs = [
        {name: tried(way, theta, x) for name, way in ways.items()}
        for _ in range(passes + 1)
    ]
    rows = []
    for name in ways:
        row = {"scene": scene, "way": name} | runs[-1][name]
        for key in ("ms/it", "CPU s"):
            row[key] = float(np.median([run[name][key] for run in runs]))
        rows.append(row)
    return rows


def print_table(rows) -> None:
    print(f"\n{rows[0]['scene']:28}" + "".join(f"{head:>12}" for head in HEADS)
          + "       optimum")  # fmt: skip
    for row in rows:
        sizes = "".join(f"{row[head]:12.0f}" for head in HEADS[:5])
        print(
            f"{row['way']:28}{sizes}{row['ms/it']:12.2f}{row['CPU s']:12.2f}"
            f"{row['optimum']:14.4f}"
            f"  {'' if row['status'] == 'Solve_Succeeded' else row['status'][:200]}",
            flush=True,
        )


def print_pairs(rows) -> None:
    """Print what each reduction saves, medians over the scenes where both converge."""
    print("\nWhat is left out         scenes    variables          terms"
          "          ms/it          CPU s   times faster (least, most)"
          "   optimum apart (median, most)")  # fmt: skip
    found = {(row["scene"], row["way"]): row for row in rows}
    for name, (more, less) in PAIRS.items():
        both = [
            (found[scene, more], found[scene, less])
            for scene in {row["scene"]: None for row in rows}
            if (scene, more) in found
        ]
        good = [pair for pair in both if all(r["status"] in SOLVED for r in pair)]
        text = f"{name:22}{len(good):4} of {len(both):2}"
        if good:
            for key, digits in (
                ("variables", 0),
                ("terms", 0),
                ("ms/it", 2),
                ("CPU s", 2),
            ):
                before, after = (np.median([p[k][key] for p in good]) for k in (0, 1))
                text += f"{before:9.{digits}f}{after:7.{digits}f}"
            ratio = [a["CPU s"] / b["CPU s"] for a, b in good]
            apart = [abs(a["optimum"] - b["optimum"]) for a, b in good]
            text += f"{np.median(ratio):10.2f} ({min(ratio):.2f}, {max(ratio):.2f})"
            text += f"{np.median(apart):20.1e} {max(apart):.1e}"
        print(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--passes", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    add_executor(parser, "none")
    arguments = parser.parse_args()
    rows, files = [], [*arguments.files, None]
    with executor_of(arguments, __file__) as executor:
        cases = [(file, arguments.passes) for file in files]
        for found in mapped(executor, scene_table, cases):
            rows += found
            print_table(found)
    print_pairs(rows)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_csv(arguments.out / "reductions.csv", rows)


if __name__ == "__main__":
    main()
