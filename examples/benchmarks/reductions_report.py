"""Print the savings of reductions: a table of each scene, and one of pairs.

A row is the result of `reductions.py` for one variant of a problem.
"""

import numpy as np

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
    print(f"\n{rows[0]['scene']:28}" + "".join(f"{head:>12}" for head in HEADS)
          + "       optimum      put back")  # fmt: skip
    for row in rows:
        sizes = "".join(f"{row[head]:12.0f}" for head in HEADS[:5])
        back = "" if np.isnan(row["put back"]) else f"{row['put back']:.6f}"
        print(
            f"{row['way']:28}{sizes}{row['ms/it']:12.2f}{row['CPU s']:12.2f}"
            f"{row['optimum']:14.4f}{back:>14}"
            f"  {'' if row['status'] == 'Solve_Succeeded' else row['status'][:200]}",
            flush=True,
        )


def print_pairs(shape, rows) -> None:
    """Print what each reduction saves, medians over the scenes where both converge."""
    print(f"\nLeft out of a {shape:12}scenes    variables          terms"
          "          ms/it          CPU s   times faster (least, most)"
          "   optimum apart (median, most)   put back (most)")  # fmt: skip
    found = {(row["scene"], row["way"]): row for row in rows}
    for name, (more, less) in PAIRS.items():
        both = [
            (found[scene, more], found[scene, less])
            for scene in {row["scene"]: None for row in rows}
            if (scene, more) in found and (scene, less) in found
        ]
        if not both:
            continue
        good = [pair for pair in both if all(r["status"] in SOLVED for r in pair)]
        text = f"{name:22}{len(good):4} of {len(both):2}"
        if good:
            for key, digits in (
                ("variables", 0),
                ("terms", 0),
                ("ms/it", 2),
                ("CPU s", 2),
            ):
                before, after = (np.median([p[k][key] for p in good]) for k in (0, 1))
                text += f"{before:9.{digits}f}{after:7.{digits}f}"
            ratio = [a["CPU s"] / b["CPU s"] for a, b in good]
            apart = [abs(a["optimum"] - b["optimum"]) for a, b in good]
            text += f"{np.median(ratio):10.2f} ({min(ratio):.2f}, {max(ratio):.2f})"
            text += f"{np.median(apart):20.1e} {max(apart):.1e}"
            back = [abs(a["put back"] - b["put back"]) for a, b in good]
            text += "" if np.isnan(back).all() else f"{np.nanmax(back):18.1e}"
        print(text)
