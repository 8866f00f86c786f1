"""Run the cells of a benchmark that are missing; keep every row as soon as it is there.

A benchmark that was interrupted, or that is asked for more, goes on from its .jsonl.
"""

import csv
import json
from pathlib import Path


def resumed(path: Path, keys, cells, run_all) -> list[dict]:
    """Return the rows of all cells, in their order.

    keys: columns that name a cell; run_all(missing) yields the rows of one cell after
    another, each a list of dicts that have these columns.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = read(path)
    done = {tuple(r[k] for k in keys) for r in rows}
    for new in run_all([cell for cell in cells if tuple(cell) not in done]):
        rows += new
        with open(path, "a") as stream:
            stream.writelines(json.dumps(row, default=plain) + "\n" for row in new)
    order = {tuple(cell): i for i, cell in enumerate(cells)}
    rows = [r for r in rows if tuple(r[k] for k in keys) in order]
    return sorted(rows, key=lambda r: order[tuple(r[k] for k in keys)])


def plain(value):
    """Return a NumPy number or boolean as Python's."""
    return value.item()


def read(path: Path) -> list[dict]:
    """Return the rows kept so far; a line cut short by an interrupt is run again."""
    if not path.exists():
        return []
    rows = []
    for line in path.read_text().splitlines():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def write_csv(path: Path, rows: list[dict]) -> None:
    """Write all rows as one table."""
    with open(path, "w", newline="") as stream:
        names = list(dict.fromkeys(key for row in rows for key in row))
        writer = csv.DictWriter(stream, names)
        writer.writeheader()
        writer.writerows(rows)
