"""Measure the effect of the search settings: hypotheses, starts, tolerance.

    python examples/benchmarks/search_settings.py ../shared/scenes/cuboid_0*.npz
        ../shared/scenes/platonic_*_0.npz [--actions 6] [--out benchmark]
        [--executor processes|dask|mpi|none]

Each row is an estimate from scratch with one setting changed from the default.  A
polytope's search has the tolerance as its only setting.  `reached`: converged within 2
nats of the lowest objective that any setting found for this file.  mm: exact mean
distance of the surfaces at the last sample.  The error of a failed estimate is
infinite.  Called again with the same --out, the script runs what is missing (study.py).
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread: before NumPy

import argparse
from pathlib import Path
from time import process_time

import matplotlib.pyplot as plt
import numpy as np
from compare_formulations import front
from study import add_executor, executor_of, run_study, write_csv
from trimesh.convex import convex_hull
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp import Measurements, Options, Scene, solve_estimate, surface_distance
from tactilenlp.errors import TactileError

SETTINGS = {  # name -> options
    "default": {},
    "hypotheses 1": {"hypotheses": 1}, "hypotheses 2": {"hypotheses": 2},
    "hypotheses 8": {"hypotheses": 8},
    "starts 2": {"starts": 2}, "starts 4": {"starts": 4}, "starts 16": {"starts": 16},
    "lean": {"hypotheses": 1, "starts": 2, "rivals": False},
    "no rivals": {"rivals": False},
    "tolerance 1e-3": {"tolerance": 1e-3}, "tolerance 1e-9": {"tolerance": 1e-9},
}  # fmt: skip
OF_POLYTOPES = ("default", "tolerance 1e-3", "tolerance 1e-9")
KEYS = ("file", "actions", "setting")
SAME = 2.0  # [nats] of the lowest objective


def corners(truth) -> np.ndarray:
    """Return the corners of the true body (V, 3) [m], body frame."""
    if "vertices" in truth:
        return truth["vertices"]
    signs = np.indices((2, 2, 2)).reshape(3, 8).T - 0.5
    return signs * truth["side_lengths"]


def run(file, actions, setting) -> dict:
    """Return the row of one estimate."""
    truth, data, scene = np.load(file), Measurements.load(file), Scene.load(file)
    data = data.select(np.unique(data.action)[:actions])
    shape = "cuboid" if "side_lengths" in truth else "polytope"
    row = dict(zip(KEYS, (file, actions, setting), strict=True)) | {"shape": shape}
    row |= {"noisy": "noisy" in file, "mm": np.inf, "nats": np.inf, "converged": False}
    options, began = Options(**SETTINGS[setting]), process_time()
    try:
        estimate = solve_estimate(data, scene, shape=shape, options=options)
    except TactileError as error:
        return row | {"cpu_s": process_time() - began, "status": error.what}
    cpu, last = process_time() - began, data.samples - 1
    true = convex_hull(corners(truth))
    pose = translation_matrix(truth["object_position"][last])
    true.apply_transform(pose @ quaternion_matrix(truth["object_quaternion"][last]))
    mm = 1e3 * surface_distance(estimate.mesh(), true).mean
    return row | {
        "mm": mm, "nats": estimate.objective, "converged": estimate.success,
        "cpu_s": cpu, "iterations": estimate.iterations, "status": estimate.status,
    }  # fmt: skip


def judge(rows) -> None:
    """Say of each row whether it reached the lowest objective found for its file."""
    for r in rows:
        lowest = min(q["nats"] for q in rows if q["file"] == r["file"])
        r["reached"] = bool(r["converged"] and r["nats"] <= lowest + SAME)


def table(rows) -> list[dict]:
    """Print every setting of each shape and noise; return its medians."""
    print(f"{'':26}{'setting':16}{'solved':>8}{'reached':>9}{'mm':>7} "
          f"(quartiles, worst){'CPU s':>8}")  # fmt: skip
    points = []
    for shape, noisy in dict.fromkeys((r["shape"], r["noisy"]) for r in rows):
        group = [r for r in rows if (r["shape"], r["noisy"]) == (shape, noisy)]
        lines = []
        for name in dict.fromkeys(r["setting"] for r in group):
            some = [r for r in group if r["setting"] == name]
            low, mm, high, worst = (
                float(np.quantile([r["mm"] for r in some], q, method="nearest"))
                for q in (0.25, 0.5, 0.75, 1)
            )
            cpu = float(np.median([r["cpu_s"] for r in some]))
            counts = [sum(bool(r[k]) for r in some) for k in ("converged", "reached")]
            lines.append((name, len(some), *counts, low, mm, high, worst, cpu))
        edge = front([(line[-1], line[5]) for line in lines])
        cell = f"{shape}{', noisy' * noisy}"
        for (name, n, ok, at, low, mm, high, worst, cpu), on in zip(
            lines, edge, strict=True
        ):
            print(f"{cell:26}{name:16}{ok:>5}/{n:<2}{at:>6}/{n:<2}{mm:7.2f} ({low:.2f} "
                  f"{high:.2f}, {worst:.2f}){cpu:10.2f}{'  front' * on}")  # fmt: skip
            points.append({"cell": cell, "name": name, "mm": mm, "cpu_s": cpu,
                           "share": at / n, "front": on})  # fmt: skip
    return points


def draw(points, path) -> None:
    """Plot CPU seconds against error; size: share that reached; ring: Pareto front."""
    cells = list(dict.fromkeys(p["cell"] for p in points))
    size = (4.2 * len(cells), 3.8)
    figure, axes = plt.subplots(1, len(cells), figsize=size, layout="constrained",
                                squeeze=False)  # fmt: skip
    for ax, cell in zip(axes.flat, cells, strict=True):
        for p in (p for p in points if p["cell"] == cell):
            edge = "black" if p["front"] else "none"
            ax.scatter(p["cpu_s"], p["mm"], 20 + 120 * p["share"], edgecolor=edge)
            ax.annotate(p["name"], (p["cpu_s"], p["mm"]), fontsize=7,
                        xytext=(4, 4), textcoords="offset points")  # fmt: skip
        ax.set(xscale="log", title=cell, xlabel="median CPU s", ylabel="median mm")
        ax.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def said(case, r) -> str:
    """Return an estimate that ended in words."""
    cell = " ".join([Path(case[0]).stem, *map(str, case[1:])])
    return f"{cell} {r['mm']:.2f} mm {r['cpu_s']:.1f} s {r['status']}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--actions", type=int, nargs="+", default=[6])
    parser.add_argument("--settings", nargs="+", default=[*SETTINGS], choices=SETTINGS)
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    add_executor(parser, "none")
    args = parser.parse_args()
    cells = [
        (file, actions, setting)
        for file in args.files for actions in args.actions for setting in args.settings
        if "side_lengths" in np.load(file) or setting in OF_POLYTOPES
    ]  # fmt: skip

    kept = args.out / "search_settings.jsonl"
    scripts = Path(__file__).with_name("compare_formulations.py"), __file__
    with executor_of(args, *scripts) as executor:
        rows = run_study(kept, "search settings", run, cells, executor, say=said)
    judge(rows)
    write_csv(args.out / "search_settings.csv", rows)
    draw(table(rows), args.out / "search_settings.png")


if __name__ == "__main__":
    main()
