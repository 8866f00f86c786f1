"""Table and figure of the study on the simulated robot (explore_on_robot.py)."""

from itertools import product
from pathlib import Path

import numpy as np
import study
from exploration_report import mean_and_band
from matplotlib import pyplot as plt
from scipy import stats

plt.switch_backend("Agg")  # without a screen
OFFSETS = ("joints", "constant", "ignored")  # how the fingers' errors are estimated
KEYS = {"p2s_mm": "exact surface distance [mm]", "bch_mm": "bCH [mm]"}
COLOURS = {"eig": "#0072B2", "random": "#D55E00"}
LINES = {"joints": "-", "constant": "--", "ignored": ":"}
TESTS = {"p of bCH": stats.ttest_ind, "paired": stats.ttest_rel}


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
            axes.plot(steps, means, label=f"{policy}, {offset}", **style)
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
    """Return medians and means after every action, NEES, and the paper's test.

    centred: of an estimate moved to the true centre, which the fingers cannot know.
    """
    lines = []
    for policy, offset, step in product(policies, offsets_of(rows), steps):
        p2s, centred, bch, nees = (
            column(rows, key, policy, offset, step)
            for key in ("p2s_mm", "centred_mm", "bch_mm", "nees")
        )
        line = {"policy": policy, "offset": offset, "step": step}
        line |= {"p2s median": np.median(p2s), "worst": p2s.max()}
        line |= {"centred": np.median(centred), "bCH mean": bch.mean()}
        line |= {"NEES mean": nees.mean(), "NEES median": np.median(nees)}
        if policy == policies[0] and len(policies) > 1 and len(bch) > 1:
            other = column(rows, "bch_mm", policies[1], offset, step)
            for name, test in TESTS.items():
                p = test(bch, other).pvalue * (len(steps) - 1)
                line[name] = min(1.0, float(p))
        lines.append(line)
    return (
        f"{study.table(lines)}\n"
        "p: two-tailed t-test of independent samples (the paper's), times the\n"
        "actions; paired: of differences, the same body and errors in both"
    )
