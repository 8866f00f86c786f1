"""Benchmark `solve_estimate(shape="polytope")`: error and cost by actions and stage.

python examples/benchmarks/estimate_polytope.py ../shared/scenes/platonic_*_?.npz
... --actions 3 6 9 --vertices 8 20 30 --table polytope.csv --picture polytope.png
    [--executor processes|dask|mpi|none]

Truth is read here, never by the package.  t2e, e2t: mean distance of the true surface
to the estimated one, and back; touched: of the true contact points to the estimate.
CPU seconds exclude the derivation of kinds.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # of every library, said before numpy comes

import argparse
from itertools import product
from pathlib import Path
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation
from study import add_executor, executor_of, mapped, write_csv
from trimesh.convex import convex_hull
from trimesh.proximity import closest_point_naive

from formulations.polytope import polytope
from tactilenlp import Measurements, Scene, solve_estimate, surface_distance
from tactilenlp.kind import seconds_deriving

STAGES = {"vertices": "quasi_static", "impulses": "violation_implicit"}
TARGETS = {  # of nine actions of clean scenes, with impulses
    "t2e_mm": 1.0, "e2t_mm": 1.2, "touched_mm": 0.25, "third_mm": 0.1, "cpu_s": 6.0,
}  # fmt: skip


def truth(file, last):
    """Return the true surface at a sample, and the true contact points on it."""
    with np.load(file) as known:
        R = Rotation.from_quat(np.roll(known["object_quaternion"], -1, axis=1))
        p, vertices = known["object_position"], known["vertices"]
        t, f = np.nonzero(known["truth_contact"][: last + 1])
        n = known["truth_normal"][t, f]
        radius = np.broadcast_to(known["finger_radius"], known["truth_contact"].shape)
        r = known["truth_finger_position"][t, f] - radius[t, f, None] * n
    body = R[t].inv().apply(r - p[t])
    return convex_hull(R[last].apply(vertices) + p[last]), R[last].apply(body) + p[last]


def measured(file, actions, vertices, stage, start=None):
    """Return one row of the table, and the estimate."""
    data = Measurements.load(file)
    data = data.select(np.unique(data.action)[:actions])
    began, derived = process_time(), seconds_deriving[0]
    estimate = solve_estimate(
        data, Scene.load(file), shape=polytope(vertices), formulation=STAGES[stage],
        start=start, throw=False,
    )  # fmt: skip
    cpu = process_time() - began
    mesh, points = truth(file, data.samples - 1)
    d = surface_distance(mesh, estimate.mesh())
    z = np.sort(estimate.mesh().vertices[:, 2])
    touched = closest_point_naive(estimate.mesh(), points)[1]
    return {
        "scene": Path(file).stem, "actions": actions, "vertices": vertices,
        "stage": stage, "start": "scratch" if start is None else "incremental",
        "solved": estimate.success, "t2e_mm": 1e3 * d.a_to_b, "e2t_mm": 1e3 * d.b_to_a,
        "touched_mm": 1e3 * touched.mean(), "third_mm": 1e3 * z[2],
        "iterations": estimate.iterations, "cpu_s": cpu,
        "kinds_s": seconds_deriving[0] - derived,
    }, estimate  # fmt: skip


def rows_of(file, vertices, stage, actions, incremental):
    """Return the rows of a file for every number of actions, and for one more."""
    rows = [measured(file, n, vertices, stage)[0] for n in actions]
    if incremental:
        _, early = measured(file, actions[-1] - 1, vertices, stage)
        rows.append(measured(file, actions[-1], vertices, stage, early)[0])
    return rows


def summary(rows):
    """Print mean, median, p90 and worst by actions, vertices and stage; the targets."""
    figures = ("t2e_mm", "e2t_mm", "touched_mm", "third_mm", "cpu_s")
    print(f"{'actions vertices stage start':40} solved", *(f"{f:>27}" for f in figures))
    keys = ("actions", "vertices", "stage", "start")
    for group in dict.fromkeys(tuple(r[k] for k in keys) for r in rows):
        mine = [r for r in rows if tuple(r[k] for k in keys) == group]
        solved = sum(r["solved"] for r in mine)
        cells = [[r[f] for r in mine] for f in figures]
        spread = [(np.mean(c), *np.quantile(c, (0.5, 0.9, 1.0))) for c in cells]
        text = [" /".join(f"{value:5.2f}" for value in s) for s in spread]
        print(f"{group!s:40} {solved:2}/{len(mine):2}", *(f"{t:>27}" for t in text))
    print(
        "mean / median / p90 / worst; targets of the means, 9 actions, impulses:",
        TARGETS,
    )


def picture(rows, path):
    """Draw error against actions and against CPU seconds, a curve for each stage."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.5), sharey=True)
    for stage in STAGES:
        mine = [r for r in rows if r["stage"] == stage and r["start"] == "scratch"]
        for ax, key in zip(axes, ("actions", "cpu_s"), strict=True):
            ax.plot([r[key] for r in mine], [r["t2e_mm"] for r in mine], "o", alpha=0.5,
                    label=stage)  # fmt: skip
            ax.set_xlabel({"actions": "actions", "cpu_s": "CPU time [s]"}[key])
    axes[0].axhline(TARGETS["t2e_mm"], color="0.5", linestyle="--")
    axes[0].set_ylabel("truth to estimate [mm]")
    axes[1].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--actions", type=int, nargs="+", default=[9])
    parser.add_argument("--vertices", type=int, nargs="+", default=[20])
    parser.add_argument("--stages", nargs="+", default=[*STAGES], choices=STAGES)
    parser.add_argument("--incremental", action="store_true", help="one more action")
    parser.add_argument("--table", default="polytope.csv")
    parser.add_argument("--picture")
    add_executor(parser, "none")
    chosen = parser.parse_args()
    cases = product(
        chosen.scenes, chosen.vertices, chosen.stages, [chosen.actions],
        [chosen.incremental],
    )  # fmt: skip
    with executor_of(chosen, __file__) as executor:
        rows = [row for some in mapped(executor, rows_of, cases) for row in some]
    write_csv(chosen.table, rows)
    summary(rows)
    if chosen.picture:
        picture(rows, chosen.picture)


if __name__ == "__main__":
    main()
