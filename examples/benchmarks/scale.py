"""Measure cost against samples: many actions, fingers, samples a second, vertices.

    python examples/benchmarks/scale.py folder [--count 3] [--first 0]
        [--cells "box, 60 actions" ...] [--time-limit 600]
        [--executor processes|dask|mpi|none] [--address tcp://scheduler:8786]

The objects of the exploration study under random actions of all fingers, estimated once
with default options.  An estimate that is refused, or not done within the time limit
[s, on the wall], is infinitely far in the medians.  Each cell is kept when it is done;
called again, the study goes on.  It writes scale.jsonl, scale.csv, and scale.png: CPU
seconds over samples.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from exploration_objects import errors, world_of
from judging import quantile, solved
from study import grouped, study_parser, table, tabled_study, telling

from tactilenlp import Options, Scene, Workspace
from tactilenlp.shapes import polytope

BOX, SOLID = {"objects": "cuboid"}, {"objects": "polytope"}
CELLS = {
    "box, 6 actions": BOX | {"actions": 6},
    "box, 20 actions": BOX | {"actions": 20},
    "box, 60 actions": BOX | {"actions": 60},
    "box, 3 fingers": BOX | {"fingers": 3},
    "box, 5 fingers": BOX | {"fingers": 5},
    "box, 60 Hz": BOX | {"rate": 60},
    "box, 200 Hz": BOX | {"rate": 200},
    "polytope, 9 actions": SOLID | {"actions": 9},
    "polytope, 20 actions": SOLID | {"actions": 20},
    "polytope, 60 actions": SOLID | {"actions": 60},
    "polytope of 20 vertices": SOLID | {"actions": 9, "vertices": 20},
    "polytope of 50 vertices": SOLID | {"actions": 9, "vertices": 50},
}
RADIUS = 0.01  # [m] of fingertips


def run(cell: str, number: int, time_limit: float) -> dict:
    """Return cost and error of the estimate of a cell's recording of an object."""
    world, shape = recorded(number, **CELLS[cell])
    how = {"shape": shape, "options": Options(time_limit=time_limit), "throw": False}
    estimate, told = solved(world.measurements, Scene(), **how)
    samples, row = world.measurements.samples, {"cell": cell, "object": number}
    row |= {"samples": samples, **told, "success": False}
    row |= {"cpu_ms_a_sample": 1e3 * told["cpu_s"] / samples}
    if estimate is None:
        return row
    return row | {
        "iterations": int(estimate.iterations), "objective": estimate.objective,
        "verdict": estimate.fit.verdict, "success": bool(estimate.success),
        "status": estimate.status, "p2s_mm": float(errors(world, estimate)["p2s_mm"]),
    }  # fmt: skip


def recorded(number, objects, actions=6, fingers=2, rate=30, vertices=None):
    """Return a world under random actions of its fingers, and the shape to estimate."""
    given = {"finger_radius": (RADIUS,) * fingers, "rate": rate}
    world = replace(world_of(number, objects), **given)
    space, rng = Workspace(fingers), np.random.default_rng([number, actions])
    for _ in range(actions):
        target = world.pose[:3]
        world.execute(space.random(rng).trajectory(target))
    return world, polytope(vertices) if vertices else objects


def medians(rows) -> list[dict]:
    """Return a row a cell: medians of numbers, the worst distance, how many ended."""
    out = []
    for (cell,), mine in grouped(rows, "cell").items():
        row = {"cell": cell, "n": len(mine)}
        for name in ("samples", "cpu_s", "cpu_ms_a_sample", "iterations"):
            row[name] = quantile([r.get(name, np.nan) for r in mine])
        far = [r["p2s_mm"] if r["success"] else np.inf for r in mine]
        row |= {"p2s_mm": quantile(far), "worst_mm": max(far)}
        row["success"] = sum(r["success"] for r in mine)
        row["good"] = sum(r.get("verdict") == "good" for r in mine)
        out.append(row)
    return out


def picture(rows, path: Path) -> None:
    """Draw CPU seconds over samples, a colour for each class of bodies."""
    figure, axes = plt.subplots(figsize=(5.2, 4.0))
    for word in ("box", "polytope"):
        mine = [row for row in rows if row["cell"].startswith(word)]
        if mine:
            at = [[row[k] for row in mine] for k in ("samples", "cpu_s")]
            axes.loglog(*at, "o", ms=4, alpha=0.7, label=word)
    axes.set(xlabel="samples", ylabel="CPU time of an estimate [s]")
    axes.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    parser = study_parser(__doc__, executor="none")
    parser.add_argument("--count", type=int, default=3, help="objects a cell")
    parser.add_argument("--first", type=int, default=0, help="number of a first one")
    parser.add_argument("--cells", nargs="+", choices=CELLS, default=[*CELLS])
    limit = "[s] of an estimate"
    parser.add_argument("--time-limit", type=float, default=600.0, help=limit)
    chosen = parser.parse_args()
    numbers = range(chosen.first, chosen.first + chosen.count)
    cases = [*product(chosen.cells, numbers, [chosen.time_limit])]
    say = telling("refused", "status", "samples", "cpu_s", "p2s_mm")
    rows = tabled_study(chosen, chosen.folder / "scale", run, cases, say)
    picture(rows, chosen.folder / "scale.png")
    print(table(medians(rows)))


if __name__ == "__main__":
    main()
