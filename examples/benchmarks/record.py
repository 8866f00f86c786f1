"""Save the results of a benchmark, and compare a new run with them.

    python examples/benchmarks/record.py keep stability benchmark/stability.csv
    python examples/benchmarks/record.py compare stability benchmark/stability.csv

A record is one small CSV file in results/.  It has a line for every group of rows and
quantity: the value, the tolerance within which a new value counts as equal, and the
direction that is worse.  Above the lines stand the date and the versions that made it.
A tolerance may be edited by hand.  `compare` ends with a non-zero exit code where a
value is worse by more than its tolerance, or missing.  CPU seconds can be compared on
the same machine only.
"""

import argparse
import csv
import io
import sys
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
from study import grouped, table

from tactilenlp.common.npz import versions
from tactilenlp.common.whole_file import write_whole

RESULTS = Path(__file__).parent / "results"
FIELDS = ("group", "quantity", "value", "tolerance", "worse", "rows")
STATISTICS = {"median": np.median, "worst": np.max, "share": np.mean}
WORDS = {"True": 1.0, "False": 0.0, "": np.nan, "None": np.nan}


@dataclass(frozen=True)
class Quantity:
    """A number of a group: the statistic of a column, and what counts as the same.

    worse: "up" or "down"; relative [-] and least [its unit]: the tolerance is the
    larger one of both.
    """

    column: str
    statistic: str
    worse: str
    relative: float = 0.0
    least: float = 0.0


RECIPES = {  # name -> columns that make a group of rows, and its quantities
    "stability": (
        ("axis", "way"),
        (Quantity("passed", "share", "down"), Quantity("cpu_s", "worst", "up", 1, 5)),
    ),
    "formulations": (
        ("start", "actions", "page"),
        (
            Quantity("mm", "median", "up", 0.25, 0.05),
            Quantity("converged", "share", "down", 0.0, 0.1),
            Quantity("best", "share", "down", 0.0, 0.1),
            Quantity("iterations", "median", "up", 0.25, 2),
            Quantity("cpu_s", "median", "up", 0.5, 0.1),
        ),
    ),
}


def number(word: str) -> float:
    """Return a cell of a CSV as a number; NaN where there is none."""
    return WORDS[word] if word in WORDS else float(word)


def read(path) -> list[dict]:
    """Return the rows of a CSV; lines that begin with # are remarks."""
    lines = Path(path).read_text().splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def condensed(name: str, rows) -> list[dict]:
    """Return the lines of a record: every quantity of every group."""
    (columns, quantities), lines = RECIPES[name], []
    for group, some in grouped(rows, *columns).items():
        for q in quantities:
            values = np.array([number(row[q.column]) for row in some])
            values = values[~np.isnan(values)]
            value = STATISTICS[q.statistic](values) if len(values) else np.nan
            tolerance = max(q.least, q.relative * abs(value))
            lines.append({
                "group": ", ".join(group), "quantity": f"{q.statistic} {q.column}",
                "value": f"{value:.6g}", "tolerance": f"{tolerance:.3g}",
                "worse": q.worse, "rows": len(some),
            })  # fmt: skip
    return lines


def keep(name: str, rows, folder=RESULTS) -> Path:
    """Write the record of a benchmark, with date and versions."""
    folder.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    made = ", ".join(f"{k} {v}" for k, v in versions().items())
    text.write(f"# {date.today()}\n# {made}\n")
    writer = csv.DictWriter(text, FIELDS)
    writer.writeheader()
    writer.writerows(condensed(name, rows))
    write_whole(folder / f"{name}.csv", text.getvalue())
    return folder / f"{name}.csv"


def compared(name: str, rows, folder=RESULTS) -> list[dict]:
    """Return for every line of the record how the new run differs from it."""
    new = {(r["group"], r["quantity"]): r for r in condensed(name, rows)}
    out = []
    for old in read(folder / f"{name}.csv"):
        line = new.get((old["group"], old["quantity"]))
        before, tolerance = float(old["value"]), float(old["tolerance"])
        now = float(line["value"]) if line else np.nan
        out.append({**old, "now": now, "verdict": judged(before, now, tolerance, old)})
    return out


def judged(before: float, now: float, tolerance: float, old) -> str:
    """Return in a word how a value moved."""
    if np.isnan(now):
        return "same" if np.isnan(before) else "missing"
    if np.isnan(before):
        return "better"
    rise = now - before if old["worse"] == "up" else before - now
    if abs(rise) <= tolerance + 1e-9 * abs(before):
        return "same"
    return "worse" if rise > 0 else "better"


def show(lines) -> None:
    """Print what changed, and how much did not."""
    if changed := [line for line in lines if line["verdict"] != "same"]:
        names = ("verdict", "value", "now", "tolerance", "quantity", "group")
        print(table(changed, *names))
    counts = {v: sum(line["verdict"] == v for line in lines)
              for v in ("same", "better", "worse", "missing")}  # fmt: skip
    print(", ".join(f"{n} {v}" for v, n in counts.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("verb", choices=["keep", "compare"])
    parser.add_argument("name", choices=[*RECIPES])
    parser.add_argument("csv", type=Path, help="what the benchmark wrote")
    parser.add_argument("--results", type=Path, default=RESULTS, help="of the records")
    arguments = parser.parse_args()
    rows = read(arguments.csv)
    if arguments.verb == "keep":
        print(keep(arguments.name, rows, arguments.results))
        return
    lines = compared(arguments.name, rows, arguments.results)
    show(lines)
    if any(line["verdict"] in ("worse", "missing") for line in lines):
        sys.exit(1)


if __name__ == "__main__":
    main()
