"""Compare all formulations by run time and error: which page for which purpose.

    python examples/benchmarks/time_against_error.py folder [--count 20] [--first 500]
        [--actions 1 2 3 4 5 6] [--formulations violation_implicit shooting ...]
        [--worlds clean noisy soft] [--executor processes|dask|mpi|none]

Each cell is a formulation, a world and a number of actions; it is estimated as a user
does, by `solve_estimate` with default options, so that seconds are those of search,
solves, certificates and reading.  The recordings are boxes of foreign_bodies.py, which
two fingers push from the sides and from above in plain MuJoCo; `soft` has its default
contact, `noisy` 1 mm on positions, 5 degrees on normals and 1 % flipped booleans.

    surface   exact mean distance of the surfaces at the last sample [mm]
    path      the same at PLACES samples of the whole recording, the mean [mm]
    cpu       seconds of one core, with kinds of terms compiled before

Failed and refused estimates are counted, and infinitely far in the quantiles; their
seconds count as they are.  Rows are kept in time_against_error.jsonl as they end
(study.py): called again, the script runs what is missing, and writes
time_against_error.csv (a row an estimate), summary.csv (a row a cell) and
time_against_error.png.
"""

from functools import cache
from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from foreign_bodies import Box
from foreign_world import DEFAULT, ForeignWorld, recorded, told_of
from judging import placed, quantile, solved, spread_samples
from monte_carlo import NOISE
from study import grouped, study_parser, table, tabled_study, telling, write_csv
from trimesh.creation import box

from tactilenlp import Noise, Options, solve_estimate, surface_distance
from tactilenlp.data.noise_model import add_noise

FORMULATIONS = (
    *("violation_implicit", "quasi_static", "shooting", "multiple_shooting"),
    *("complementarity", "paper"),
)
FROM_ABOVE = {"above": 1.0, "heights": (0.25, 0.6)}  # [rad], shares of the height
WORLDS = {
    "clean": ForeignWorld(**FROM_ABOVE),
    "noisy": ForeignWorld(**FROM_ABOVE),
    "soft": ForeignWorld(**FROM_ABOVE, contact=DEFAULT),
}
PLACES = 12  # samples of a recording at which the surfaces are compared
OPTIONS = Options(time_limit=120.0)  # [s] of an estimate
QUANTILES = (0.1, 0.5, 0.9)
MEASURED = ("cpu_s", "surface_mm", "path_mm")
TOLD = ("refused", "surface_mm", "path_mm", "success", "cpu_s")
COLOURS = dict(zip(FORMULATIONS, plt.cm.tab10.colors, strict=False))


@cache
def measured(world: str, number: int, actions: int):
    """Return measurements, scene and true arrays of a recording; it is simulated."""
    true = recorded(Box(number), WORLDS[world], actions)
    data, scene = told_of(true)
    if world == "noisy":
        data = add_noise(data, Noise(seed=number, **NOISE))
    return data, scene, true


@cache
def warm(formulation: str) -> None:
    """Compile the terms of a page, once in each process."""
    data, scene, _ = measured("clean", 0, 2)
    solve_estimate(data, scene, formulation=formulation, options=OPTIONS, throw=False)


def estimated(
    formulation: str, world: str, actions: int, number: int, most: int
) -> dict:
    """Return the row of one estimate; most: actions of the recording."""
    warm(formulation)
    row = {"formulation": formulation, "world": world, "actions": actions}
    row |= {"box": number, "refused": "", "success": False}
    data, scene, true = measured(world, number, most)
    data = data.select(range(actions))
    how = {"formulation": formulation, "options": OPTIONS, "throw": False}
    estimate, told = solved(data, scene, **how)
    row |= told
    if estimate is None:
        return row
    row["success"] = bool(estimate.success)
    places = spread_samples(data, PLACES)
    apart = [surfaces_apart(estimate, true, k) for k in places]
    verdict = estimate.fit.verdict if estimate.fit else ""
    row |= {"surface_mm": apart[-1], "path_mm": float(np.mean(apart))}
    return row | {"nats": estimate.objective, "verdict": verdict}


def surfaces_apart(estimate, true, sample: int) -> float:
    """Return the mean distance [mm] of the true and estimated surfaces at a sample."""
    bodies = (
        (estimate.side_lengths, estimate.position, estimate.quaternion),
        (true["side_lengths"], true["object_position"], true["object_quaternion"]),
    )
    meshes = [placed(box(sides), p[sample], q[sample]) for sides, p, q in bodies]
    return 1e3 * surface_distance(*meshes).mean


def summary(rows) -> list[dict]:
    """Return a row a cell: quantiles of all estimates, and how many failed."""
    cells, names = [], ("world", "formulation", "actions")
    for key, mine in grouped(rows, *names).items():
        solved = [r for r in mine if r["success"]]
        cell = dict(zip(names, key, strict=True))
        cell |= {"n": len(mine), "refused": sum(bool(r["refused"]) for r in mine)}
        cell |= {"failed": len(mine) - len(solved) - cell["refused"]}
        for name, q in product(MEASURED, QUANTILES):
            cell[f"{name}_{round(100 * q)}"] = quantile(column(mine, name), q)
        cells.append(cell)
    return cells


def column(rows, name: str) -> list[float]:
    """Return a column: errors of what failed are infinite, seconds as they are."""
    return [r[name] if r["success"] or name == "cpu_s" else np.inf for r in rows]


def draw(cells, path: Path) -> None:
    """Plot median run time against median error, from few to many actions."""
    worlds = [w for w in WORLDS if any(c["world"] == w for c in cells)]
    names = {"surface_mm": "final surface [mm]", "path_mm": "along the path [mm]"}
    figure, axes = plt.subplots(
        2, len(worlds), figsize=(3.6 * len(worlds) + 1.6, 6.4), sharex=True,
        sharey=True, layout="constrained", squeeze=False,
    )  # fmt: skip
    for (row, (name, label)), (column, world) in product(
        enumerate(names.items()), enumerate(worlds)
    ):
        ax = axes[row, column]
        for formulation in FORMULATIONS:
            mine = [c for c in cells if c["world"] == world]
            mine = [c for c in mine if c["formulation"] == formulation]
            mine.sort(key=lambda c: c["actions"])
            seconds = [c["cpu_s_50"] for c in mine]
            middle, low, high = (
                np.array([c[f"{name}_{q}"] for c in mine]) for q in (50, 10, 90)
            )
            colour = COLOURS[formulation]
            ax.plot(seconds, middle, "o-", color=colour, ms=4, label=formulation)
            ax.vlines(seconds, low, high, color=colour, alpha=0.25, lw=3)
            for c, x, y in zip(mine, seconds, middle, strict=True):
                ax.annotate(c["actions"], (x, y), (3, 3), textcoords="offset points",
                            fontsize=7, color=colour)  # fmt: skip
        ax.set(xscale="log", yscale="log")
        ax.grid(alpha=0.3, which="both")
        if row == 0:
            ax.set_title(world)
        if column == 0:
            ax.set_ylabel(label)
    figure.supxlabel("CPU seconds of an estimate; numbers: actions; bars: 10 to 90 %")
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    parser = study_parser(__doc__, executor="none")
    parser.add_argument("--count", type=int, default=20, help="boxes")
    parser.add_argument("--first", type=int, default=500, help="number of a first box")
    parser.add_argument("--actions", type=int, nargs="+", default=[1, 2, 3, 4, 5, 6])
    parser.add_argument("--formulations", nargs="+", default=FORMULATIONS)
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=[*WORLDS])
    chosen = parser.parse_args()
    numbers = range(chosen.first, chosen.first + chosen.count)
    cases = [
        (formulation, world, actions, number, max(chosen.actions))
        for number, actions, world, formulation in product(
            numbers, chosen.actions, chosen.worlds, chosen.formulations
        )
    ]
    path = chosen.folder / "time_against_error"
    rows = tabled_study(chosen, path, estimated, cases, say=telling(*TOLD))
    cells = summary(rows)
    write_csv(chosen.folder / "summary.csv", cells)
    print(table(sorted(cells, key=lambda c: (c["world"], c["actions"]))))
    draw(cells, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
