"""Measure `solve_estimate(shape="polytope")`: error and cost by actions and vertices.

    python examples/benchmarks/estimate_polytope.py folder scenes/platonic_*_?.npz
        [--actions 3 6 9] [--vertices 8 20 50] [--hard 5] [--incremental]
        [--executor processes|dask|mpi|none]

Called again with the same folder, the script runs what is missing.  Polytopes of 20
vertices are solved with and without impulses, for each of --actions; the others with
impulses, from the most actions.  --hard records Platonic solids on slippery ground with
sticky fingers (the paper's 0.1 and 1.0) and adds them.  --incremental also measures the
last action alone.

The truth is read here, never by the package.  t2e, e2t: mean distance from the true
surface to the estimated one, and back; touched: from the true contact points to the
estimate; third: height of the third-lowest vertex; ratio: median of |error| / sigma of
supporting planes with three touches or more; wrong: those beyond 1 mm and 5 sigma.  CPU
seconds exclude the derivation of term functions; a case that derives some is repeated.
"""

from dataclasses import replace
from pathlib import Path
from time import process_time
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
from exploration_objects import SEED, world_of
from judging import planes_off
from matplotlib.ticker import MaxNLocator
from study import study_parser, table, tabled_study, telling
from trimesh.convex import convex_hull
from trimesh.proximity import closest_point_naive

from formulations.polytope import polytope
from tactilenlp import Measurements, Scene, Workspace, solve_estimate, surface_distance
from tactilenlp.geometry.transforms import rotation_of
from tactilenlp.nlp.term_functions import default_cache

STAGES = {"vertices": "quasi_static", "impulses": "violation_implicit"}
SCRATCH, INCREMENTAL = "scratch", "incremental"
TARGETS = {  # of nine actions of clean scenes, with impulses
    "t2e_mm": 1.0, "e2t_mm": 1.2, "touched_mm": 0.25, "third_mm": 0.1, "cpu_s": 6.0,
}  # fmt: skip
GROUP = ("case", "vertices", "stage", "actions", "start")
USUAL = 20  # vertices
TOLD = "contact", "normal", "finger_position"  # of what was true
TOUCHED, CLOSE, SIGMAS = 3, 1e-3, 5.0  # touches, [m], [-]
SLIPPERY, STICKY = 0.1, 1.0  # friction of ground and fingers of the hard case
MISSED = 4e-3  # [m] by which an action at random aims beside the centroid


def truth(file, last):
    """Return the true surface at a sample, and the true contact points on it."""
    with np.load(file) as known:
        truth = SimpleNamespace(**{k: known[f"truth_{k}"] for k in TOLD})
        for name in ("object_position", "object_quaternion"):
            setattr(truth, name, known[name][: last + 1])
        radius, vertices = known["finger_radius"], known["vertices"]
    felt = truth.contact[: last + 1]
    radius = np.broadcast_to(radius, felt.shape[1])
    turn = rotation_of(truth.object_quaternion[-1])
    mesh = convex_hull(turn.apply(vertices) + truth.object_position[-1])
    return mesh, carried_along(truth, felt, radius)


def carried_along(truth, felt, radius) -> np.ndarray:
    """Return the true contact points (n, 3) [m] where they lie at last, world frame.

    felt (T, F): the touches; radius (F,) [m] of the fingers.
    """
    t, f = np.nonzero(felt)
    point = truth.finger_position[t, f] - radius[f, None] * truth.normal[t, f]
    p, R = truth.object_position, rotation_of(truth.object_quaternion)
    return R[-1].apply(R[t].inv().apply(point - p[t])) + p[-1]


def measured(file, vertices, stage, actions, begun):
    """Return one row of the table."""
    data, scene = Measurements.load(file), Scene.load(file)
    names = np.unique(data.action)[:actions]
    told = {
        "shape": polytope(vertices), "formulation": STAGES[stage], "throw": False,
    }  # fmt: skip
    start = None
    if begun == INCREMENTAL:
        start = solve_estimate(data.select(names[:-1]), scene, **told)
    data = data.select(names)
    derived = -1.0
    while derived != default_cache().seconds:  # who derives kinds is run again
        derived, began = default_cache().seconds, process_time()
        estimate = solve_estimate(data, scene, start=start, **told)
        cpu = process_time() - began
    mesh, points = truth(file, data.samples - 1)
    d, planes = surface_distance(mesh, estimate.mesh()), estimate.supporting_planes()
    z = np.sort(estimate.mesh().vertices[:, 2])
    touched = closest_point_naive(estimate.mesh(), points)[1]
    return {
        "scene": Path(file).stem, "actions": len(names), "vertices": vertices,
        "stage": stage, "start": begun, "solved": bool(estimate.success),
        "t2e_mm": 1e3 * d.a_to_b, "e2t_mm": 1e3 * d.b_to_a,
        "touched_mm": 1e3 * touched.mean(), "third_mm": 1e3 * z[2],
        **sure(planes, planes.touches, mesh),
        "iterations": estimate.iterations, "cpu_s": cpu,
    }  # fmt: skip


def sure(planes, touches, mesh) -> dict:
    """Return how the errors of touched supporting planes compare with their sigma."""
    known = touches >= TOUCHED
    off = planes_off(planes, mesh)[known]
    sigma = np.maximum(planes.sigma[known], 1e-9)
    wrong = (off > CLOSE) & (off > SIGMAS * sigma)
    ratio = float(np.median(off / sigma)) if known.any() else np.nan
    return {"planes": int(known.sum()), "ratio": ratio, "wrong": int(wrong.sum())}


def touch_at_random(world, rng, actions: int) -> None:
    """Let two fingers act on a world's body, aiming beside its centroid."""
    space = Workspace()
    for _ in range(actions):
        target = world.pose[:3] + rng.normal(0, MISSED, 3)
        world.execute(space.random(rng).trajectory(target))


def hard(folder: Path, trial: int, actions: int) -> str:
    """Record a Platonic solid on slippery ground under sticky fingers, once."""
    path = folder / f"hard_{trial}.npz"
    if not path.exists():
        known = {"friction_ground": SLIPPERY, "friction_finger": STICKY}
        world = replace(world_of(trial, "polytope"), **known)
        touch_at_random(world, np.random.default_rng([SEED, trial, 2]), actions)
        world.save(path)
    return str(path)


def cells_of(chosen) -> list[tuple]:
    """Return what to run: file, vertices, stage, actions, start."""
    most = max(chosen.actions)
    slippery = [hard(chosen.folder, k, most) for k in range(chosen.hard)]
    cells = []
    for file in [*chosen.scenes, *slippery]:
        for n in chosen.vertices:
            whole = n == USUAL and file not in slippery
            for stage in STAGES if n == USUAL else ["impulses"]:
                actions = chosen.actions if whole else [most]
                cells += [(file, n, stage, a, SCRATCH) for a in actions]
            if n == USUAL and chosen.incremental:
                cells.append((file, n, "impulses", most, INCREMENTAL))
    return cells


def group_of(row) -> tuple:
    """Return what rows of one line of the summary have in common."""
    case = "hard" if row["scene"].startswith("hard_") else "given"
    return (case, *(row[k] for k in GROUP[1:]))


def summary(rows):
    """Print mean, median, p90 and worst of each group; the targets."""
    groups = []
    for group in sorted({group_of(r) for r in rows}):
        mine = [r for r in rows if group_of(r) == group]
        line = dict(zip(GROUP, group, strict=True)) | {"n": len(mine)}
        for name in TARGETS:
            values = [r[name] for r in mine]
            spread = np.mean(values), *np.quantile(values, (0.5, 0.9, 1.0))
            line[name] = " / ".join(f"{value:.2f}" for value in spread)
        line["ratio"] = float(np.nanmedian([r["ratio"] for r in mine]))
        counts = ("solved", "wrong", "planes")
        groups.append(line | {k: sum(r[k] for r in mine) for k in counts})
    print(table(groups))
    print(
        "mean / median / p90 / worst; targets of means, 9 actions, impulses:", TARGETS
    )


def picture(rows, path):
    """Draw error against actions, CPU seconds and number of vertices, by stage."""
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), sharey=True)
    most = max(r["actions"] for r in rows)
    rows = [r for r in rows if r["start"] == SCRATCH]
    for case, mark, line in (("given", "o", "-"), ("hard", "x", "--")):
        for stage, colour in zip(STAGES, ("#0072B2", "#D53C00"), strict=True):
            mine = [r for r in rows if group_of(r)[0] == case and r["stage"] == stage]
            usual = [r for r in mine if r["vertices"] == USUAL]
            last = [r for r in mine if r["actions"] == most]
            shown = {"actions": usual, "cpu_s": usual, "vertices": last}
            look = {"color": colour, "label": f"{stage}, {case}" if mine else None}
            for ax, (key, those) in zip(axes, shown.items(), strict=True):
                error = np.array([r["t2e_mm"] for r in those])
                where = np.array([r[key] for r in those])
                ax.plot(where, error, mark, alpha=0.4, **look)
                if key != "cpu_s":
                    at = np.unique(where)
                    mean = [error[where == a].mean() for a in at]
                    ax.plot(at, mean, line, color=colour)
    for ax, label in zip(
        axes, ("actions", "CPU time [s]", f"vertices, {most} actions"), strict=True
    ):
        ax.axhline(TARGETS["t2e_mm"], color="0.5", linestyle=":")
        ax.set_xlabel(label)
    for ax in axes[[0, 2]]:
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes[0].set_ylabel("truth to estimate [mm]")
    axes[0].set_ylim(bottom=0)
    axes[1].legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def main():
    parser = study_parser(__doc__, executor="none")
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--actions", type=int, nargs="+", default=[3, 6, 9])
    parser.add_argument("--vertices", type=int, nargs="+", default=[8, 20, 50])
    parser.add_argument("--hard", type=int, default=5, help="scenes to record")
    parser.add_argument("--incremental", action="store_true", help="one more action")
    chosen = parser.parse_args()
    chosen.folder.mkdir(parents=True, exist_ok=True)
    path = chosen.folder / "polytope"
    say = telling("t2e_mm", "cpu_s")
    rows = tabled_study(chosen, path, measured, cells_of(chosen), say=say)
    summary(rows)
    picture(rows, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
