"""Table and figure of the study on the simulated robot (explore_on_robot.py)."""

from itertools import product
from pathlib import Path

import numpy as np
import study
from matplotlib import pyplot as plt
from paired_tests import PRIMARY, mean_and_band, paired_in_words

plt.switch_backend("Agg")  # without a screen
OFFSETS = ("joints", "constant", "ignored")  # how the fingers' errors are estimated
KEYS = {"p2s_mm": "exact surface distance [mm]", "bch_mm": "bCH [mm]"}
COLOURS = {"eig": "#0072B2", "random": "#D55E00"}
NAMES = {"eig": "chosen", "random": "random"}
LINES = {"joints": "-", "constant": "--", "ignored": ":"}
COMPARED = {"p2s_mm": "surface", "centred_mm": "shape alone", "bch_mm": "bCH"}


def column(rows, key: str, policy: str, offset: str, step: int) -> np.ndarray:
    """Return a number of every trial."""
    return np.array([
        r[key] for r in rows
        if (r["policy"], r["offset"], r["step"]) == (policy, offset, step)
    ])  # fmt: skip


def draw(path: Path, rows: list[dict], policies: list[str], steps: range) -> None:
    """Save mean and 95 % interval of the mean of each policy after every step."""
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.4))
    for axes, (key, title) in zip(panels, KEYS.items(), strict=True):
        top = 0.0  # of the means: intervals of a few trials would press them flat
        for policy, offset in product(policies, offsets_of(rows)):
            groups = [column(rows, key, policy, offset, step) for step in steps]
            means, halves = np.array([mean_and_band(group) for group in groups]).T
            top = max(top, means.max())
            style = {"color": COLOURS.get(policy), "linestyle": LINES[offset]}
            name, alone = NAMES.get(policy, policy), len(offsets_of(rows)) == 1
            label = name if alone else f"{name}, {offset}"
            axes.plot(steps, means, label=label, **style)
            if offset == OFFSETS[0]:
                band = means - halves, means + halves
                axes.fill_between(steps, *band, color=style["color"], alpha=0.2)
        axes.set(xlabel="actions after the first touch", ylabel=title)
        axes.set_ylim(0, 1.3 * top)
    panels[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def offsets_of(rows: list[dict]) -> list[str]:
    """Return which of OFFSETS were estimated."""
    return [one for one in OFFSETS if any(row["offset"] == one for row in rows)]


def table(rows: list[dict], policies: list[str], steps: range) -> str:
    """Return medians and means after every action, NEES, and tests of the first policy.

    centred: of an estimate moved to the true centre, which the fingers cannot know.
    """
    lines = []
    for policy, offset, step in product(policies, offsets_of(rows), steps):
        p2s, centred, bch, nees = (
            column(rows, key, policy, offset, step)
            for key in ("p2s_mm", "centred_mm", "bch_mm", "nees")
        )
        line = {"policy": policy, "offset": offset, "step": step}
        line |= {"p2s median": np.median(p2s), "mean": p2s.mean(), "worst": p2s.max()}
        line |= {"centred median": np.median(centred), "mean of it": centred.mean()}
        line |= {"bCH mean": bch.mean(), "NEES median": np.median(nees)}
        lines.append(line)
    return "\n".join([study.table(lines), *comparisons(rows, policies, steps)])


def comparisons(rows: list[dict], policies: list[str], steps: range) -> list[str]:
    """Return tests of the first policy against the second, the same body in both."""
    lines, many = [PRIMARY], len(steps) - 1
    if len(policies) < 2:
        return []
    for (key, title), offset in product(COMPARED.items(), offsets_of(rows)):
        lines.append(f"{' against '.join(policies[:2])}, {offset}, {title}:")
        for step in steps[1:]:
            x, y = (column(rows, key, p, offset, step) for p in policies[:2])
            if len(x) > 2:
                lines.append(f"  1 + {step}: {paired_in_words(x, y, many)}")
    return lines
