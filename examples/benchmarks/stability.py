"""Stress the estimator: a table of cells, each with a rule that it must pass.

    python examples/benchmarks/stability.py folder [--axes friction "time step"]
        [--ways cuboid polytope] [--core] [--executor processes|dask|none]

A cell is one value of one axis, solved one way.  It passes if it is right to a
millimetre, or no error exceeds five of its own sigmas; if two solves that must agree
do; or if it ends with a typed error where the axis says beforehand that it may.
Never: a number that is not finite, a confident wrong answer, a crash, a hang.

Rows are kept in stability.jsonl as soon as a cell is done; called again, the suite goes
on from there.  Writes stability.csv and stability.png.  The axes, with their rules and
with what may be refused, are in stability_world.py, stability_sensors.py and
stability_solver.py, the judge in stability_judge.py.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread a process: before NumPy

import argparse
import signal
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import stability_sensors
import stability_solver
import stability_world
from resume import resumed, write_csv
from stability_judge import (
    COLOURS,
    CRASH,
    ERROR,
    GOOD,
    HANG,
    HONEST,
    RIGHT,
    UNTOLD,
    refused,
    row,
)

from tactilenlp.errors import TactileError

AXES = {
    axis.name: axis
    for axis in (*stability_solver.AXES, *stability_world.AXES, *stability_sensors.AXES)
}
LIMIT, WAIT = 120, 3600  # [CPU s], [s] that a cell may take; its process dies then
CORE = (  # a dozen cells for the tests: every verdict and every kind of rule
    ("internal units", "mm", "quasi-static"),
    ("labels", "body turned 90 deg", "cuboid"),
    ("information prior", "1e-6", "cuboid"),
    ("information prior", "1e+6", "cuboid"),
    ("stuck sensor", "all, never", "cuboid"),
    ("samples twice", "same time", "cuboid"),
    ("start", "3x, 180 deg", "cuboid"),
    ("mass", "100 kg", "cuboid"),
    ("friction", "finger 0", "cuboid"),
    ("flips", "3 %", "cuboid"),
    ("contacts", "last sample", "cuboid"),
    ("actions", "1", "cuboid"),
)
WIDE = 1.1  # [in] of a cell in the picture
KEYS = ("axis", "value", "way")


def run(cell) -> list[dict]:
    """Return the rows of a cell; whatever goes wrong is a row as well."""
    name, value, way = cell
    axis, began = AXES[name], time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rows = axis.check(value, way)
    except TactileError as error:
        rows = [refused(error)]
    except Exception as error:  # any other is a defect: it counts, by its name
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:160]}"
        rows = [row("estimate", CRASH, words=said)]
    seconds = time.process_time() - began
    return [finished(cell, r, seconds / len(rows)) for r in rows]


def finished(cell, found: dict, seconds: float) -> dict:
    """Return the row with its cell, its cost, and whether it passes."""
    allowed = AXES[cell[0]].allows(*cell[1:])
    allowed |= found["part"] == "gain" and cell[2] in UNTOLD
    good = (*GOOD, ERROR) if allowed else GOOD
    plain = {k: float(v) if isinstance(v, np.floating) else v for k, v in found.items()}
    label = dict(zip(KEYS, cell, strict=True))
    passed = found["verdict"] in good
    return label | plain | {"passed": passed, "cpu_s": seconds, "may_refuse": allowed}


def limited(cell) -> list[dict]:
    """Run a cell in a process of its own pool, which dies if it takes too long."""
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    signal.setitimer(signal.ITIMER_REAL, WAIT)
    rows = run(cell)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    return rows


def in_processes(cells, workers: int, task=limited):
    """Yield the rows of each cell; one that kills its process twice is a hang."""
    waiting, suspects = list(cells), []
    while waiting:
        lost = yield from in_pool(waiting, workers, task)
        suspects += lost[:workers]  # those that ran when the process died: each alone
        waiting = lost[workers:]
    for cell in suspects:
        if (yield from in_pool([cell], 1, task)):
            yield [finished(cell, row("estimate", HANG), float(LIMIT))]


def in_pool(cells, workers: int, task):
    """Yield the rows of each cell until a process dies; return what is left."""
    left = []
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        for cell, future in [(cell, pool.submit(task, cell)) for cell in cells]:
            try:
                yield future.result()
            except BrokenProcessPool:
                left.append(cell)
    return left


def in_dask(cells, address):
    from distributed import Client, as_completed  # an extra: tactilenlp[dask]

    with Client(address) as client:
        for future in as_completed(client.map(run, cells, pure=False)):
            yield future.result()


def chosen(arguments) -> list[tuple]:
    """Return the cells that are asked for."""
    if arguments.core:
        return list(CORE)
    names = arguments.axes or [*AXES]
    cells = [cell for name in names for cell in AXES[name].cells()]
    return [c for c in cells if not arguments.ways or c[2] in arguments.ways]


def suite(arguments) -> list[dict]:
    """Run what is missing of the cells that are asked for; return all their rows."""
    ways = {
        "none": lambda cells: map(run, cells),
        "processes": lambda cells: in_processes(cells, arguments.workers),
        "dask": lambda cells: in_dask(cells, arguments.address),
    }

    def run_all(cells):
        if arguments.report:
            return
        for rows in ways[arguments.executor](cells):
            for r in rows:
                print(said(r), flush=True)
            yield rows

    kept = arguments.folder / "stability.jsonl"
    return resumed(kept, KEYS, chosen(arguments), run_all)


def said(r) -> str:
    """Return a row in words."""
    mark = "  " if r["passed"] else "! "
    size = f"{r['error_mm']:.2f} mm, sigma {r['sigma_mm']:.2f}, "
    size = size if np.isfinite(r["error_mm"]) else ""
    return (f"{mark}{r['axis']} | {r['value']} | {r['way']}, {r['part']}: "
            f"{r['verdict']} ({size}{r['words']}) {r['cpu_s']:.1f} s")  # fmt: skip


def summary(rows) -> str:
    """Return how many cells pass, in all and of each axis; name those that do not.

    A cell passes if each of its parts does.
    """
    cells = {}
    for r in rows:
        cells.setdefault(tuple(r[k] for k in KEYS), []).append(r)
    passed = {cell: all(r["passed"] for r in some) for cell, some in cells.items()}
    lines = [f"{'axis':20}{'cells':>6}{'pass':>6}{'right':>6}{'CPU s':>7}  rule"]
    for name in dict.fromkeys(cell[0] for cell in cells):
        some = [cell for cell in cells if cell[0] == name]
        right = sum(cells[cell][0]["verdict"] == RIGHT for cell in some)
        seconds = sum(r["cpu_s"] for cell in some for r in cells[cell])
        good = sum(passed[cell] for cell in some)
        lines.append(f"{name:20}{len(some):>6}{good:>6}{right:>6}{seconds:7.0f}"
                     f"  {AXES[name].rule}")  # fmt: skip
    firm = [r for r in rows if not r["may_refuse"]]
    refusals = sum(r["verdict"] == ERROR for r in firm)
    lines += [said(r) for r in rows if not r["passed"]]
    good = sum(passed.values())
    lines.append(
        f"{good} of {len(cells)} cells pass ({good / len(cells):.1%}); of {len(firm)} "
        f"parts that must estimate {refusals} refused."
    )
    return "\n".join(lines)


def draw(rows, path) -> None:
    """Plot one row of squares for every axis and way, coloured by the worst verdict."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    worst = {verdict: i for i, verdict in enumerate(COLOURS)}
    lines = list(dict.fromkeys((r["axis"], r["way"]) for r in rows))
    width = max(len(AXES[name].values) for name, _ in lines)
    size = (2.5 + WIDE * width, 1.2 + 0.26 * len(lines))
    figure, ax = plt.subplots(figsize=size, layout="constrained")
    for y, (name, way) in enumerate(lines):
        for x, value in enumerate(AXES[name].values):
            cell = [r for r in rows if (r["axis"], r["way"], r["value"]) == (
                name, way, value)]  # fmt: skip
            if not cell:
                continue
            r = max(cell, key=lambda r: (not r["passed"], worst[r["verdict"]]))
            ax.add_patch(plt.Rectangle((x, y), 0.92, 0.86, color=COLOURS[r["verdict"]]))
            dark = r["verdict"] not in (HONEST, ERROR)
            ax.text(x + 0.46, y + 0.43, value + " x" * (not r["passed"]), fontsize=6,
                    color="white" if dark else "black", ha="center", va="center",
                    weight="normal" if r["passed"] else "bold")  # fmt: skip
    labels = [f"{name}: {way}" for name, way in lines]
    ax.set_yticks(np.arange(len(lines)) + 0.43, labels, fontsize=8)
    ax.set(xlim=(0, width), ylim=(len(lines), 0), xticks=[],
           xlabel="x, bold: the rule is not met")  # fmt: skip
    for side in ("top", "right", "bottom", "left"):
        ax.spines[side].set_visible(False)
    shown = [v for v in COLOURS if any(r["verdict"] == v for r in rows)]
    patches = [Patch(color=COLOURS[v], label=v) for v in shown]
    figure.legend(handles=patches, loc="outside upper center", ncols=4, frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--axes", nargs="+", choices=[*AXES], metavar="AXIS")
    parser.add_argument("--ways", nargs="+", metavar="WAY")
    parser.add_argument("--core", action="store_true", help="the tests' dozen cells")
    parser.add_argument("--report", action="store_true", help="of what is there")
    parser.add_argument("--executor", default="processes",
                        choices=["processes", "dask", "none"])  # fmt: skip
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--address", help="of a Dask scheduler")
    arguments = parser.parse_args()
    rows = suite(arguments)
    write_csv(arguments.folder / "stability.csv", rows)
    draw(rows, arguments.folder / "stability.png")
    print(summary(rows))
    if not all(r["passed"] for r in rows):
        sys.exit(1)


if __name__ == "__main__":
    main()
