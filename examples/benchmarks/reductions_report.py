"""Print the savings of reductions: a table of each scene, and one of pairs.

A row is the result of `reductions.py` for one variant of a problem.
"""

import numpy as np
from study import table

BASE = "all reductions"
NONE = ("still", "far", "absent", "planar")
PAIRS = {  # what is left out: with it, without it
    **{name: (f"without {name}", BASE) for name in NONE},
    "frictionless": ("tangential impulses kept", "no friction"),
    "one finger": ("second finger never valid", "no second finger"),
    "no ground": ("ground out of reach", "no ground"),
    "still, far, absent": ("planar alone", BASE),
    "all": ("no reduction", BASE),
}
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
HEADS = ("variables", "constraints", "terms", "presolve", "joint", "ms/it", "CPU s")


def failed(error) -> dict:
    """Return the row of a problem that was not solved."""
    status = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return dict.fromkeys((*HEADS, "optimum"), np.nan) | {"status": status}


def print_table(rows) -> None:
    """Print what each way of writing the problem of a scene took."""
    optima = ("optimum", "put back")  # of which three digits are not enough
    rows = [row | {name: f"{row[name]:.6f}" for name in optima} for row in rows]
    columns = "way", *HEADS, *optima, "status"
    print(f"\n{rows[0]['scene']}\n{table(rows, *columns)}", flush=True)


def print_pairs(shape, rows) -> None:
    """Print what each reduction saves, medians over the scenes where both converge."""
    found, lines = {(row["scene"], row["way"]): row for row in rows}, []
    for name, (more, less) in PAIRS.items():
        both = [
            (found[scene, more], found[scene, less])
            for scene in {row["scene"]: None for row in rows}
            if (scene, more) in found and (scene, less) in found
        ]
        if not both:
            continue
        good = [pair for pair in both if all(r["status"] in SOLVED for r in pair)]
        line = {"left out": name, "scenes": f"{len(good)} of {len(both)}"}
        lines.append(line)
        if good:
            for key in ("variables", "terms", "ms/it", "CPU s"):
                sides = (np.median([p[k][key] for p in good]) for k in (0, 1))
                line[key] = "{:.4g} to {:.4g}".format(*sides)
            ratio = [a["CPU s"] / b["CPU s"] for a, b in good]
            line["times faster"] = f"{np.median(ratio):.2f}"
            line["least, most"] = f"{min(ratio):.2f}, {max(ratio):.2f}"
            apart = [abs(a["optimum"] - b["optimum"]) for a, b in good]
            line["optimum apart, most"] = f"{np.median(apart):.1e}, {max(apart):.1e}"
            back = [abs(a["put back"] - b["put back"]) for a, b in good]
            line["put back, most"] = (
                f"{np.nanmax(back):.1e}" if np.isfinite(back).any() else ""
            )
    names = dict.fromkeys(key for line in lines for key in line)
    print(f"\nLeft out of a {shape}:\n{table(lines, *names)}")
