"""Run the stress suite: a table of cells, each with a rule that it must pass.

    python examples/benchmarks/stability.py folder [--axes friction "time step"]
        [--ways cuboid polytope] [--core] [--executor processes|dask|mpi|none]

A cell is one value of one axis, solved with one formulation or shape.  It passes if the
error is below a millimetre or five sigma; if two solves that must agree do agree; or if
it ends with a typed error that its axis permits beforehand.  It fails with a number
that is not finite, a wrong result of small sigma, a crash, or no result in time.

Rows are saved in stability.jsonl (study.py) when a cell is done; called again, the
suite resumes.  The time of a cell is limited only with `processes`.  The script writes
stability.csv and stability.png.  The axes, with their rules and permitted errors, are
in stability_world.py, stability_sensors.py and stability_solver.py, the verdicts in
stability_judge.py.
"""

import os
import signal
import sys
import threading
import time
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context

import numpy as np
import stability_sensors
import stability_solver
import stability_world
from judging import refusal
from stability_judge import (
    COLOURS,
    CRASH,
    ERROR,
    GOOD,
    HANG,
    HONEST,
    RIGHT,
    refused,
    row,
)
from study import (
    executor_of,
    grouped,
    one_thread,
    results_of,
    run_study,
    study_parser,
    write_csv,
)

from tactilenlp.errors import TactileError

AXES = {
    axis.name: axis
    for axis in (*stability_solver.AXES, *stability_world.AXES, *stability_sensors.AXES)
}
LIMIT, WAIT = 120, 3600  # [CPU s], [s] that a cell may take; its process dies then
CORE = (  # few cells for the tests: every verdict and every kind of rule
    ("internal units", "mm", "quasi-static"),
    ("labels", "body turned 90 deg", "cuboid"),
    ("information prior", "1e-6", "cuboid"),
    ("information prior", "1e+6", "cuboid"),
    ("stuck sensor", "all, never", "cuboid"),
    ("samples twice", "same time", "cuboid"),
    ("start", "3x, 180 deg", "cuboid"),
    ("mass", "100 kg", "cuboid"),
    ("friction", "finger 0", "cuboid"),
    ("friction", "ground 0.05", "cuboid"),
    ("flips", "3 %", "cuboid"),
    ("noise of positions", "bias 5 mm", "cuboid"),
    ("contacts", "last sample", "cuboid"),
    ("dropped spans", "a finger in an action", "cuboid"),
    ("actions", "1", "cuboid"),
)
WIDE = 1.1  # [in] of a cell in the picture
KEYS = ("axis", "value", "way")
CHILD = threading.local()  # .pool: the process in which a thread runs its cells


def run(name, value, way) -> list[dict]:
    """Return the rows of a cell; whatever goes wrong is a row as well."""
    cell = name, value, way
    axis, began = AXES[name], time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rows = axis.check(value, way)
    except TactileError as error:
        rows = [refused(error)]
    except Exception as error:  # any other is a defect: it counts, by its name
        rows = [row("estimate", CRASH, words=refusal(error))]
    seconds = time.process_time() - began
    return [finished(cell, r, seconds / len(rows)) for r in rows]


def finished(cell, found: dict, seconds: float) -> dict:
    """Return the row with its cell, its cost, and whether it passes."""
    allowed = AXES[cell[0]].allows(*cell[1:])
    good = (*GOOD, ERROR) if allowed else GOOD
    plain = {k: float(v) if isinstance(v, np.floating) else v for k, v in found.items()}
    label = dict(zip(KEYS, cell, strict=True))
    passed = found["verdict"] in good
    return label | plain | {"passed": passed, "cpu_s": seconds, "may_refuse": allowed}


def timed(*cell) -> list[dict]:
    """Run a cell in a process that dies if it takes too long."""
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    signal.setitimer(signal.ITIMER_REAL, WAIT)
    rows = run(*cell)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    return rows


def limited(*cell, task=timed) -> list[dict]:
    """Run a cell in the child of this thread; one that kills it twice is a hang.

    A thread has one process of its own, cell after cell, until it dies or the thread
    ends.  (Processes that started children themselves would wait for them for ever.)
    """
    for _ in range(2):
        if not hasattr(CHILD, "pool"):
            CHILD.pool = ProcessPoolExecutor(1, get_context("spawn"))
        try:
            return CHILD.pool.submit(task, *cell).result()
        except BrokenProcessPool:
            del CHILD.pool
    return [finished(cell, row("estimate", HANG), float(LIMIT))]


@contextmanager
def watched(arguments):
    """Give where cells run, and how: beside a process each that may be killed."""
    one_thread()
    if arguments.executor == "processes":
        with ThreadPoolExecutor(arguments.workers or os.cpu_count()) as pool:
            yield pool, limited
    else:
        with executor_of(arguments) as executor:
            yield executor, run


def chosen(arguments) -> list[tuple]:
    """Return the cells that are asked for."""
    if arguments.core:
        return list(CORE)
    names = arguments.axes or [*AXES]
    cells = [cell for name in names for cell in AXES[name].cells()]
    return [c for c in cells if not arguments.ways or c[2] in arguments.ways]


def suite(arguments) -> list[dict]:
    """Run what is missing of the cells that are asked for; return all their rows."""
    kept, cells = arguments.folder / "stability.jsonl", chosen(arguments)
    if arguments.report:
        rows = [r for found in results_of(kept, "stability") for r in found]
        place = {cell: i for i, cell in enumerate(cells)}
        rows = [(tuple(r[k] for k in KEYS), r) for r in rows]
        rows = [(place[cell], r) for cell, r in rows if cell in place]
        return [r for _, r in sorted(rows, key=lambda pair: pair[0])]
    with watched(arguments) as (executor, task):
        found = run_study(
            kept, "stability", task, cells, executor,
            say=lambda _, rows: "\n".join(map(said, rows)),
        )  # fmt: skip
    return [r for rows in found for r in rows]


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
    cells = grouped(rows, *KEYS)
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
    parser = study_parser(__doc__)
    parser.add_argument("--axes", nargs="+", choices=[*AXES], metavar="AXIS")
    parser.add_argument("--ways", nargs="+", metavar="WAY")
    parser.add_argument("--core", action="store_true", help="the tests' cells")
    parser.add_argument("--report", action="store_true", help="of what is there")
    arguments = parser.parse_args()
    rows = suite(arguments)
    write_csv(arguments.folder / "stability.csv", rows)
    draw(rows, arguments.folder / "stability.png")
    print(summary(rows))
    if not all(r["passed"] for r in rows):
        sys.exit(1)


if __name__ == "__main__":
    main()
