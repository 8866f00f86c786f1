"""Compare the formulations from the same starts: CPU time against error.

    python examples/benchmarks/compare_formulations.py ../shared/scenes/cuboid_*.npz
        [--out folder] [--executor processes|dask|mpi|none]

With --ablation, the page `paper` is solved with each of its physics terms omitted in
turn.  Called again with the same --out, the script runs what is missing (study.py).
(Under the name `formulations.py` it would hide the package `formulations`.)

Each row is one local solve of the page's continuation levels, without a search.  The
levels of shooting begin with soft weights, those of violation_implicit with the final
ones, since it follows a first stage; "loose first" is that page with levels that begin
soft, "shooting, sharp" is single shooting without its soft level.  Starts:
  near    the true trajectory moved by 1 mm and 2 degrees, sizes off by 5 %
  far     the true trajectory moved by 5 mm and 10 degrees, sizes off by 20 %
  paper   at rest where the paper starts: sizes 10 to 30 mm, within 20 mm of the true
          first pose, any yaw
A solve has two measures.  mm: exact mean distance of the surfaces at the last sample;
untouched sizes come from the prior, the same for all formulations.  best: it converged
to within 2 nats of the lowest objective that this problem found in this cell (file,
actions); a page with other levels states the same problem.  Objectives of different
problems are never compared.  CPU seconds exclude
the derivation of term functions.  Failed solves are counted, not omitted.

The truth is read here, for starts and errors, never by the package.
"""

import time
from importlib import import_module
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
from judging import planar_path, stated
from study import study_parser, table, tabled_study, telling
from trimesh.creation import box
from trimesh.transformations import rotation_matrix, translation_matrix

from formulations import paper, shooting, violation_implicit
from tactilenlp import Measurements, Scene, SolverOptions, extend, surface_distance
from tactilenlp.solvers.solve import solve_levels

PAGES = (
    *("quasi_static", "violation_implicit", "paper"),
    *("shooting", "multiple_shooting", "complementarity"),
)
PHYSICS = {  # of the page `paper`: what is left out in turn, and its terms
    "complementarity": ("finger complementarity", "ground complementarity"),
    "dissipation": ("finger dissipation", "ground dissipation"),
    "penetration": tuple(
        f"{who} penetration" for who in ("felt finger", "free finger", "ground", "rest")
    ),
    "inelasticity": ("finger inelasticity", "ground inelasticity"),
    "dynamics": ("dynamics",),
}
STARTS = {"near": (1e-3, 2, 0.05), "far": (5e-3, 10, 0.2)}  # m, degrees, of a size
LIMIT, WAIT = 20.0, 600.0  # [CPU s], [s] of a level
SAME = 2.0  # [nats] of the best objective


# Names of the table that are no formulations: pages with other levels or fewer terms.
VARIANTS = {
    "loose first": SimpleNamespace(  # by the levels for guessed poses: it begins soft
        build=violation_implicit.build, LEVELS=violation_implicit.ROUGH
    ),
    "shooting, sharp": SimpleNamespace(
        build=shooting.build, REDUCTIONS=shooting.REDUCTIONS,
        LEVELS=shooting.LEVELS[-1:],
    ),
}  # fmt: skip
FORMULATIONS = (*PAGES, *VARIANTS)
ABLATION = {"all": paper} | {
    f"no {word}": extend("paper", without=terms) for word, terms in PHYSICS.items()
}


def page_of(name: str):
    """Return the page of a name that the table has."""
    known = VARIANTS | ABLATION
    return known[name] if name in known else import_module(f"formulations.{name}")


def started(kind, truth, x, seed):
    """Return theta (3,) and poses (3, T) from which all formulations start."""
    rng = np.random.default_rng(seed)
    if kind == "paper":
        theta, way = rng.uniform(0.01, 0.03, 3), rng.uniform(-0.02, 0.02, 2)
        first = [*(x[:2, 0] + way), rng.uniform(-np.pi, np.pi)]
        return theta, np.repeat(np.reshape(first, (3, 1)), x.shape[1], axis=1)
    way, turn, size = STARTS[kind]
    theta = truth["side_lengths"] * (1 + size * rng.choice([-1, 1], 3))
    off = rng.normal(size=2)
    off = np.r_[way * off / np.linalg.norm(off), np.radians(turn) * rng.choice([-1, 1])]
    return theta, x + off[:, None]


def run(file, na, kind, seed, name) -> dict:
    """Return the row of one formulation, from one start, on the first `na` actions."""
    page = page_of(name)
    truth, data, scene = np.load(file), Measurements.load(file), Scene.load(file)
    data = data.select(np.unique(data.action)[:na])
    x = planar_path(truth["object_position"], truth["object_quaternion"])
    x = x[:, : data.samples]
    theta, start = started(kind, truth, x, seed)
    problem, window = stated(page, data, scene, theta, start)
    _ = problem.assembly.functions  # derived and compiled before the clock runs
    options = SolverOptions(time_limit=WAIT, ipopt={"max_cpu_time": LIMIT})
    began = time.process_time()
    given = {"theta": theta, "x": start[:, window.last]}
    s = solve_levels(problem, page.LEVELS, given, options)
    cpu = time.process_time() - began
    sizes, end = s.values["theta"][:, 0], s.values["x"][:, window.pose[-1]]
    bodies = [(sizes, end), (truth["side_lengths"], x[:, -1])]
    meshes = [
        box(
            t, translation_matrix([*p[:2], t[2] / 2]) @ rotation_matrix(p[2], [0, 0, 1])
        )
        for t, p in bodies
    ]
    return {
        "file": file, "scene": Path(file).stem, "actions": na, "start": kind,
        "seed": seed, "page": name, "converged": s.success, "nats": s.objective,
        "cpu_s": cpu,
        "mm": 1e3 * surface_distance(*meshes).mean, "iterations": s.iterations,
        "evaluations": s.evaluations, "status": s.status, "unknowns": problem.size,
        "gained_mJ": 1e3 * gained(problem, window, scene, s),
    }  # fmt: skip


def gained(problem, window, scene, s) -> float:
    """Return the energy [J] that the motion gained and no finger's impulse gave."""
    if "finger impulse" not in problem.reports or not len(window.step):
        return 0.0
    x, data = s.at(problem)
    step, push, J = window.step, window.push, s.values["theta"][:2, 0]
    poses = [s.values["x"][:, k] for k in (step.pose, step.before, step.before_2)]
    v, v_1 = ((poses[i] - poses[i + 1]) / step.dt for i in (0, 1))
    J = (J @ J) / 12
    kinetic = [
        scene.mass / 2 * (u[0] ** 2 + u[1] ** 2 + J * u[2] ** 2) for u in (v, v_1)
    ]
    given = np.zeros(len(step))
    impulse = problem.value("finger impulse", x, data)
    moved = (push.p_wf - push.p_wf_1) / step.dt[push.step][:, None]
    np.add.at(given, push.step, np.maximum(0, (impulse * moved).sum(axis=1)))
    return float(np.maximum(0, kinetic[0] - kinetic[1] - given).sum())


def judged(rows) -> list[dict]:
    """Say in each row whether it is the best that was found there of its problem.

    Pages that differ in their levels alone have one `build`.
    """
    cells = {}
    for r in rows:
        cell = r["scene"], r["actions"], page_of(r["page"]).build
        cells.setdefault(cell, []).append(r)
    for rivals in cells.values():
        lowest = min((r["nats"] for r in rivals if r["converged"]), default=-np.inf)
        for r in rivals:
            r["best"] = bool(r["converged"] and r["nats"] < lowest + SAME)
    return rows


def front(points) -> list[bool]:
    """Tell which (seconds, mm) no other one beats in both."""
    return [
        not any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in points)
        for p in points
    ]


def summary(rows, names) -> list[dict]:
    """Return medians and quartiles by start, actions, noise and page."""
    out = []
    for start, na, noisy in sorted({cell_of(r) for r in rows}):
        lines = []
        for name in names:
            some = [r for r in rows if r["page"] == name]
            some = [r for r in some if cell_of(r) == (start, na, noisy)]
            mm = np.quantile([r["mm"] for r in some], (0.5, 0.25, 0.75))
            line = {"cell": f"{start}, {na} actions{', noisy' * noisy}", "page": name}
            line |= {"n": len(some), "solved": sum(r["converged"] for r in some)}
            line |= {"best": sum(r["best"] for r in some) / len(some)}
            line |= dict(zip(("mm", "25 %", "75 %"), mm, strict=True))
            for key in ("cpu_s", "iterations", "evaluations", "gained_mJ"):
                line[key] = float(np.median([r[key] for r in some]))
            lines.append(line)
        edge = front([(line["cpu_s"], line["mm"]) for line in lines])
        out += [line | {"front": on} for line, on in zip(lines, edge, strict=True)]
    return out


def cell_of(row) -> tuple:
    return row["start"], row["actions"], "noisy" in row["scene"]


def draw(points, names, path) -> None:
    """Plot run time against error; size: share at the best optimum; ring: front."""
    cells = [*dict.fromkeys(p["cell"] for p in points)]
    shape = (-(-len(cells) // 4), min(4, len(cells)))
    size = (3.4 * shape[1], 0.9 + 3.0 * shape[0])
    figure, axes = plt.subplots(*shape, figsize=size, layout="constrained",
                                sharex=True, sharey=True, squeeze=False)  # fmt: skip
    for ax in axes.flat[len(cells) :]:
        ax.set_axis_off()
    for ax, cell in zip(axes.flat, cells, strict=False):
        for i, name in enumerate(names):
            (p,) = (p for p in points if (p["cell"], p["page"]) == (cell, name))
            edge = "black" if p["front"] else "none"
            ax.scatter(p["cpu_s"], p["mm"], 20 + 120 * p["best"], color=f"C{i}",
                       edgecolor=edge, linewidth=1.5, label=name)  # fmt: skip
        ax.set(xscale="log", yscale="log", title=cell)
        ax.grid(alpha=0.3, which="both")
    figure.supxlabel("CPU seconds (ring: no other is faster and closer)")
    figure.supylabel("median mm (large: best optimum found)")
    handles = axes.flat[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, frameon=False)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = study_parser(__doc__, folder=False, executor="none")
    parser.add_argument("files", nargs="+")
    parser.add_argument("--actions", type=int, nargs="+", default=[1, 3, 6])
    parser.add_argument("--starts", nargs="+", default=["near", "far", "paper"])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--ablation", action="store_true", help="leave physics out")
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    args = parser.parse_args()
    names = [*(ABLATION if args.ablation else FORMULATIONS)]
    stem = "ablation" if args.ablation else "formulations"
    asked = args.files, args.actions, args.starts, range(args.seeds), names
    path, say = args.out / stem, telling("mm", "cpu_s", "status")
    rows = tabled_study(args, path, run, product(*asked), say=say, table=judged)
    points = summary(rows, names)
    print(table(points))
    draw(points, names, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
