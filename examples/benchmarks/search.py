"""Measure the search: objective reached on each recording, and what it costs.

    python examples/benchmarks/search.py ../shared/scenes/cuboid_*.npz [--actions 6 2]
    ... --against de9af66 (a commit, or the folder of a checkout) [--out FILE]
    ... --wide --keep

Each estimate is solved from scratch.  `above` is its lowest objective less the best
known one of this recording, kept in best_objectives.csv over all searches;
--keep lowers the entries there that a converged estimate undercuts.  --wide: with
WIDE starts instead of 4 to 6, from the path of multiple shooting, and, of boxes, from
the true path: what any search could find, for that table.  `mm`: mean exact
surface distance at the last sample.  CPU seconds exclude the derivation of term
functions: an estimate that derives some is repeated.  With --against, both trees solve
each recording in turn, each in one process that stays.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # of every library, before numpy is imported

import argparse
import csv
import json
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import process_time

import numpy as np
from regress import ROOT, serve, tree_of, true_mesh, truth_of, worker

BEST = Path(__file__).with_name("best_objectives.csv")
WIDE = 24  # starts of the page, and hypotheses, of a search for the best known
REACHED, FAR = 0.5, 5.0  # [nats] above the best known: reached; far off
# The refinement of an estimate, by its name here and in older commits:
REFINEMENTS = "solve_from_hypotheses", "refined"
COLUMNS = ("objective", "above", "cpu_s", "solves", "iterations", "mm")


@contextmanager
def counted():
    """Count within a block: yields [solves, iterations, least objective of the page].

    The estimate is the most probable optimum, which need not be the lowest one.
    """
    from tactilenlp.estimation import optima
    from tactilenlp.solvers import solve as solving

    counts, solve = [0, 0, np.inf], solving.solve
    name = next(n for n in REFINEMENTS if hasattr(optima, n))
    refine = getattr(optima, name)
    most = 0  # samples: a search action by action also solves parts of the data

    def counting(*args, **options):
        solution = solve(*args, **options)
        counts[0] += 1
        counts[1] += solution.iterations
        return solution

    def noting(job, *args, **options):
        nonlocal most
        found, samples = refine(job, *args, **options), job.data.samples
        if samples >= most:
            good = [s.solution.objective for s in found if s.solution.success]
            counts[2] = min([counts[2] if samples == most else np.inf, *good])
            most = samples
        return found

    solving.solve = counting
    setattr(optima, name, noting)
    try:
        yield counts
    finally:
        solving.solve = solve
        setattr(optima, name, refine)


def loaded(file: str, actions: int) -> tuple:
    """Return truth, measurements, scene and class of a recording's first actions."""
    from tactilenlp import Measurements, Scene

    truth, data, scene = truth_of(file), Measurements.load(file), Scene.load(file)
    shape = "cuboid" if "side_lengths" in truth else "polytope"
    return truth, data.select(np.unique(data.action)[:actions]), scene, shape


def measure(file: str, actions: int) -> dict:
    """Return the row of one recording with the package that is imported."""
    from tactilenlp import solve_estimate, surface_distance
    from tactilenlp.nlp.term_functions import default_cache

    truth, data, scene, shape = loaded(file, actions)
    derived = None
    while derived != default_cache().derived:
        derived, began = default_cache().derived, process_time()
        with counted() as counts:
            found = solve_estimate(data, scene, shape=shape, throw=False)
        seconds = process_time() - began
    for key in ("object_position", "object_quaternion"):
        truth[key] = truth[key][: data.samples]
    return {
        "recording": Path(file).stem, "actions": data.actions,
        "objective": min(found.objective, counts[2]), "success": bool(found.success),
        "cpu_s": seconds, "solves": counts[0], "iterations": counts[1],
        "mm": 1e3 * surface_distance(found.mesh(), true_mesh(truth)).mean,
        "sizes_mm": [round(1e3 * s, 2) for s in found.theta] if shape == "cuboid"
        else [],
        "models": [s.name for s in found.skipped],
    }  # fmt: skip


def measure_widely(file: str, actions: int) -> dict:
    """Return the row of one recording whose objective is the lowest that is found."""
    from tactilenlp import Options, solve_estimate

    row = measure(file, actions)
    truth, data, scene, shape = loaded(file, actions)
    wide = Options(starts=WIDE, hypotheses=WIDE)
    with counted() as counts:
        solve_estimate(data, scene, shape=shape, options=wide, throw=False)
    found = [row["objective"], counts[2]]
    if shape == "cuboid":
        shot = solve_estimate(data, scene, formulation="multiple_shooting", throw=False)
        true = [truth[k] for k in ("object_position", "object_quaternion")]
        paths = [
            (truth["side_lengths"], *true), (shot.theta, shot.position, shot.quaternion)
        ]  # fmt: skip
        found += [solved_along(data, scene, *path) for path in paths]
    return row | {"objective": min(found), "success": True}


def solved_along(data, scene, theta, position, quaternion) -> float:
    """Return the objective of the page solved from a path of a box that slid."""
    from tactilenlp import Options
    from tactilenlp.interface.request import read_request
    from tactilenlp.interface.session import Session
    from tactilenlp.local.local_solve import solved_from
    from tactilenlp.problem.hypothesis import Hypothesis

    page, n = "violation_implicit", data.samples
    request, _ = read_request(
        data, scene, "cuboid", page, Options(), None, None, Session()
    )
    yaw = np.unwrap(2 * np.arctan2(quaternion[:n, 3], quaternion[:n, 0]))
    x = np.vstack([position[:n, :2].T, yaw])
    start = Hypothesis(np.asarray(theta), x, 0.0, ("given",))
    found = solved_from(request.job, start).solution
    return found.objective if found.success else np.inf


def best_known() -> dict[tuple, float]:
    """Return the best objective ever found by (recording, actions)."""
    if not BEST.exists():
        return {}
    with open(BEST, newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {(r["recording"], int(r["actions"])): float(r["objective"]) for r in rows}


def keep(best: dict) -> None:
    """Write the best objectives, sorted by recording and number of actions."""
    with open(BEST, "w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(["recording", "actions", "objective"])
        table.writerows([*key, f"{value:.4f}"] for key, value in sorted(best.items()))


def judge(rows, best) -> dict:
    """Set `above` of every row; return the best objectives with those of the rows."""
    best = dict(best)
    for row in (r for r in rows if r.get("success")):
        key = row["recording"], row["actions"]
        best[key] = min(best.get(key, np.inf), row["objective"])
    for row in (r for r in rows if "objective" in r):
        least = best.get((row["recording"], row["actions"]), -np.inf)
        row["above"] = row["objective"] - least
    return best


def summary(rows, name: str) -> str:
    """Return one line on the rows of a tree."""
    good = [r for r in rows if r.get("success")]
    if not good:
        return f"{name}: nothing converged"
    above = np.array([r["above"] for r in good])
    cpu, mm = (np.array([r[key] for r in good]) for key in ("cpu_s", "mm"))
    solves = np.median([r["solves"] for r in good])
    return (
        f"{name}: {len(good)} of {len(rows)} converged, "
        f"{np.sum(above <= REACHED)} within {REACHED} nats, "
        f"{np.sum(above > FAR)} above {FAR:.0f}; CPU median {np.median(cpu):.2f}, "
        f"worst {cpu.max():.2f} s, sum {cpu.sum():.1f} s; {solves:.0f} solves; "
        f"mm median {np.median(mm):.3f}, 90 % {np.quantile(mm, 0.9):.3f}, "
        f"worst {mm.max():.3f}"
    )


def line_of(row) -> str:
    """Return the line of one row."""
    if "error" in row:
        return f"  {row['error']}"
    cells = " ".join(f"{name} {row[name]:.3f}" for name in COLUMNS if name in row)
    return f"  {row['recording']} {row['actions']}: {cells} {row['sizes_mm']}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*")
    parser.add_argument("--actions", type=int, nargs="+", default=[100])
    parser.add_argument("--against", help="a commit, or the folder of a checkout")
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--wide", action="store_true", help="find the best known")
    parser.add_argument("--out", type=Path, help="JSON of all rows")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(lambda wide, *case: (measure_widely if wide else measure)(*case))
        return
    found, best = {"here": []}, best_known()
    with ExitStack() as stack:
        trees = {"here": ROOT}
        if arguments.against:
            trees["there"] = stack.enter_context(tree_of(arguments.against))
            found["there"] = []
        asked = {n: worker(tree, __file__) for n, tree in trees.items()}
        workers = {n: stack.enter_context(one) for n, one in asked.items()}
        for file in arguments.files:
            for actions in arguments.actions:
                for name, ask in workers.items():
                    case = str(Path(file).resolve()), actions
                    found[name].append(ask(arguments.wide, *case))
                best = judge([row for rows in found.values() for row in rows], best)
                for name, rows in found.items():
                    print(f"{name:6}", line_of(rows[-1]), flush=True)
    if arguments.keep:
        keep(best)
    if arguments.out:
        arguments.out.write_text(json.dumps(found))
    for name, rows in found.items():
        print(summary(rows, name))
    if arguments.against:
        pairs = zip(found["here"], found["there"], strict=True)
        seconds = [[row.get("cpu_s", np.nan) for row in pair] for pair in pairs]
        ratios = [a / b for a, b in seconds if np.isfinite(a * b)]
        print(f"paired ratio of CPU seconds, median: {np.median(ratios):.2f}")


if __name__ == "__main__":
    main()
