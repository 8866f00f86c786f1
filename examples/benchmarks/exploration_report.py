"""Report an exploration study: table, tests, comparison with the paper, pictures.

    python examples/benchmarks/exploration_report.py folder

The script reads the trials of exploration_study.py.  It writes table.txt, bch.png (bCH
and exact surface distance after every action, mean with its 95 % band) and strip.png
(the estimates in order, centred on the truth).  Outliers are marked and never dropped
silently: every mean is given with and without them.  Policies are compared in pairs, on
the trials that both have; an estimate that failed is infinitely far (paired_tests.py).
"""

from argparse import ArgumentParser
from pathlib import Path

import matplotlib
import numpy as np
from paired_tests import PRIMARY, mean_and_band, paired_in_words
from scipy.spatial import ConvexHull
from study import grouped, results_of, table

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

FILE = "exploration.jsonl"  # of the study, in its folder
PAPER = {  # [mm] bCH, after 1 + 5 and 1 + 8 actions
    "cuboid": {"eig": 4.0, "random": 5.0}, "polytope": {"eig": 5.0},
}  # fmt: skip
LOW = 10.0  # [mm] bCH, below which the paper asks the whole band to be
FENCE = 3.0  # interquartile ranges above the third quartile: an outlier (Tukey)
COLOURS = {
    "eig": "#0072B2", "random": "#D55E00", "fisher": "#009E73", "farthest": "#CC79A7",
}  # fmt: skip
UNITS = {"p2s_mm": "exact surface distance [mm]", "bch_mm": "bCH [mm]"}
REST = {  # what else is told of every action, by its median
    "p2s_max_mm": "largest distance [mm]", "side_mm": "worst side [mm]",
    "position_mm": "position [mm]", "rotation_deg": "rotation [deg]",
    "sigma_side_mm": "largest sigma of a size [mm]", "logdet": "log det I [nats, SI]",
}  # fmt: skip


def trials_of(rows, policy: str, start: str) -> list[int]:
    """Return the numbers of the trials of a policy in order."""
    mine = [r for r in rows if (r["policy"], r["start"]) == (policy, start)]
    return sorted({r["trial"] for r in mine})


def table_of(rows, name: str, policy: str, start: str, trials=None) -> np.ndarray:
    """Return (trials, actions) of a column; what failed counts as infinite.

    trials: numbers in the order of the table's rows, by default all of the policy.
    """
    trials = trials_of(rows, policy, start) if trials is None else trials
    out = np.full((len(trials), max(r["action"] for r in rows) + 1), np.inf)
    for r in rows:
        if (r["policy"], r["start"]) == (policy, start) and r["trial"] in trials:
            out[trials.index(r["trial"]), r["action"]] = r.get(name, np.inf)
    return out


def outliers(values: np.ndarray) -> np.ndarray:
    """Return which values lie beyond Tukey's outer fence, or are infinite."""
    finite = values[np.isfinite(values)]
    low, high = np.quantile(finite, [0.25, 0.75]) if len(finite) else (0, 0)
    return ~(values <= high + FENCE * (high - low))


def summary_lines(rows, name: str) -> list[str]:
    """Return, for every policy and action, what was reached."""
    lines = []
    for policy, start in ways(rows):
        columns = table_of(rows, name, policy, start).T
        for action, values in enumerate(columns):
            far = outliers(values)
            (mean, half), clean = mean_and_band(values), mean_and_band(values[~far])
            q = np.quantile(values, [0.5, 0.9, 1.0], method="higher")
            rest = "{:.3f} ± {:.3f}".format(*clean)
            lines.append({
                "policy": policy, "start": start, "after": f"1 + {action}",
                "mean": mean, "± 95 %": half, "without outliers": rest,
                "outliers": int(far.sum()), "n": len(values),
                **dict(zip(("median", "p90", "worst"), q, strict=True)),
            })  # fmt: skip
    return [UNITS[name], table(lines)]


def rest_lines(rows) -> list[str]:
    """Return the medians of all other metrics after every action."""
    lines = []
    for name, label in REST.items():
        for policy, start in ways(rows):
            if not any(name in r for r in rows):  # of cuboids only
                continue
            columns = table_of(rows, name, policy, start).T
            middle = [float(np.quantile(v, 0.5, method="higher")) for v in columns]
            line = {"medians": f"{label}, {policy}, {start}"}
            lines.append(line | {f"1 + {k}": v for k, v in enumerate(middle)})
    return table(lines).splitlines()


def comparison_lines(rows, name: str) -> list[str]:
    """Return tests of every policy against random, corrected for all actions.

    Pairs are the trials that both policies have.
    """
    lines = [f"against random, {UNITS[name]}: two-tailed tests, p times all actions"]
    for policy, start in ways(rows):
        both = {*trials_of(rows, policy, start)} & {*trials_of(rows, "random", start)}
        if policy == "random" or not both:
            continue
        pair = [
            table_of(rows, name, p, start, sorted(both)) for p in (policy, "random")
        ]
        actions = pair[0].shape[1] - 1
        for action in range(1, actions + 1):
            words = paired_in_words(*[a[:, action] for a in pair], actions)
            lines.append(f"  {policy}, {start}, 1 + {action}: {words}")
    return lines


def paper_lines(rows) -> list[str]:
    """Return the paper's figures beside ours and the floor of its metric."""
    lines, theirs = [], PAPER[objects_of(rows)]
    for policy, start in ways(rows):
        bch = table_of(rows, "bch_mm", policy, start)
        floor = table_of(rows, "bch_floor_mm", policy, start)[:, -1]
        floor = floor[np.isfinite(floor)].mean()
        bands = [mean_and_band(values) for values in bch.T]
        below = [k for k, (m, h) in enumerate(bands) if m + h < LOW]
        first = f"1 + {below[0]}" if below else "never"
        paper = f"; the paper {theirs[policy]:.0f}" if policy in theirs else ""
        lines.append(
            f"{policy}, {start}: bCH after the last action {bands[-1][0]:.2f} mm"
            f"{paper}; a perfect estimate scores {floor:.2f}; band below {LOW:.0f} mm "
            f"after {first}"
        )
    return lines


def cost_lines(rows) -> list[str]:
    """Return where CPU time goes, and what failed."""
    lines = []
    for (policy, start), mine in grouped(rows, "policy", "start").items():
        later = [r for r in mine if r["action"] > 0 and "cpu_estimate" in r]
        choose, solve = (
            np.median([r[f"cpu_{k}"] for r in later]) for k in ("choose", "estimate")
        )
        bad = sum(not r["success"] for r in mine)
        missed = sum(r.get("contacts") == 0 for r in mine)
        broken = [r["error"] for r in mine if "error" in r]
        lines.append(
            f"{policy}, {start}: CPU s at median: choose {choose:.2f}, estimate "
            f"{solve:.2f}; {bad} of {len(mine)} estimates not converged, "
            f"{missed} actions without contact, {len(broken)} trials broken {broken}"
        )
    return lines


def ways(rows) -> list[tuple[str, str]]:
    return [*grouped(rows, "policy", "start")]


def objects_of(rows) -> str:
    return rows[0].get("objects", "cuboid")


def draw_bands(rows, path: Path) -> None:
    """Draw the paper's figure: mean and 95 % band after every action."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for axis, (name, label) in zip(axes, UNITS.items(), strict=True):
        for policy, start in ways(rows):
            table = table_of(rows, name, policy, start)
            at, colour = np.arange(table.shape[1]), COLOURS.get(policy, "#333333")
            kept = [values[~outliers(values)] for values in table.T]
            mean, half = np.array([mean_and_band(v) for v in kept]).T
            words = policy if start == "ours" else f"{policy}, start of the paper"
            style = "-" if start == "ours" else "--"
            axis.plot(
                at, mean, style, color=colour, label=f"{words} (n = {len(table)})"
            )
            with_all = [np.mean(values) for values in table.T]
            axis.plot(at, with_all, style, color=colour, lw=0.7, alpha=0.6)
            low = np.maximum(mean - half, 1e-3)
            axis.fill_between(at, low, mean + half, color=colour, alpha=0.15, lw=0)
            for k, values in enumerate(table.T):
                far = values[outliers(values) & np.isfinite(values)]
                axis.plot(np.full(len(far), k), far, "x", color=colour)
        if name == "bch_mm":
            floor = [r["bch_floor_mm"] for r in rows if "bch_floor_mm" in r]
            axis.axhline(
                np.mean(floor), color="#777777", ls=":", label="a perfect estimate"
            )
            for policy, value in PAPER[objects_of(rows)].items():
                star = {"marker": "*", "s": 80, "color": COLOURS[policy], "ec": "k"}
                axis.scatter(at[-1], value, label=f"the paper, {policy}", **star)
        axis.set(xlabel="actions after the first touch", ylabel=label, yscale="log")
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(frameon=False, fontsize=8)
    words = "Mean and its 95 % band without outliers (×); thin lines: means with them"
    figure.suptitle(words)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def draw_strip(rows, path: Path) -> None:
    """Draw how the first trial of every policy learns, recentred on the truth.

    Colours are information: of the whole, or of a polytope's vertices one by one.
    """
    shown = [w for w in ways(rows) if w[1] == "ours"] or ways(rows)
    last = max(r["action"] for r in rows) + 1
    figure = plt.figure(figsize=(1.9 * last, 2.2 * len(shown)), layout="constrained")
    known = np.concatenate([nats_of(r) for r in rows if "logdet" in r])
    norm = plt.Normalize(*np.quantile(known, [0.05, 0.95]))
    true = np.concatenate([r["true_vertices"] for r in rows if "vertices" in r])
    wide = np.tile([-1, 1], (3, 1)) * np.abs(true).max()
    for i, (policy, start) in enumerate(shown):
        mine = [r for r in rows if (r["policy"], r["start"]) == (policy, start)]
        mine = [r for r in mine if r["trial"] == mine[0]["trial"] and "vertices" in r]
        for r in mine:
            place = i * last + r["action"] + 1
            axis = figure.add_subplot(len(shown), last, place, projection="3d")
            solid(axis, r["vertices"], plt.cm.coolwarm(norm(nats_of(r))))
            solid(axis, r["true_vertices"])
            axis.set(**dict(zip(("xlim", "ylim", "zlim"), wide, strict=True)))
            axis.set_box_aspect((1, 1, 1), zoom=1.4)
            axis.set_axis_off()
            axis.set_title(f"{policy}, 1 + {r['action']}\n{r['p2s_mm']:.2f} mm", size=8)
    colours = plt.cm.ScalarMappable(norm, "coolwarm")
    bar = figure.colorbar(colours, ax=figure.axes, shrink=0.6, pad=0.01)
    each = "of each vertex " if "vertex_nats" in rows[0] else ""
    bar.set_label(f"log det I {each}[nats, SI]")
    figure.savefig(path, dpi=150)
    plt.close(figure)


def nats_of(row) -> np.ndarray:
    """Return log det I of each vertex (V,), or of the whole (1,)."""
    return np.atleast_1d(row.get("vertex_nats", row["logdet"]))


def solid(axis, vertices, colours=None) -> None:
    """Draw a convex body; its edges are where facets of different planes meet.

    colours: one, or one for each vertex, which a facet mixes; none: the edges only.
    """
    points = np.array(vertices)
    hull, line = ConvexHull(points), "k"
    if colours is not None:
        mixed = np.broadcast_to(colours, (len(points), 4))[hull.simplices].mean(axis=1)
        faces = Poly3DCollection(points[hull.simplices], facecolor=mixed, alpha=0.55)
        axis.add_collection3d(faces)
        line = colours.mean(axis=0)
    for i, (simplex, near) in enumerate(
        zip(hull.simplices, hull.neighbors, strict=True)
    ):
        for k, j in enumerate(near):
            if j > i and hull.equations[i, :3] @ hull.equations[j, :3] < 0.999:
                axis.plot(*points[np.delete(simplex, k)].T, color=line, lw=0.9)


def report(rows: list[dict], folder: Path) -> None:
    """Write and print the table, and draw the pictures."""
    parts = [[PRIMARY]] + [
        lines
        for name in UNITS
        for lines in (summary_lines(rows, name), comparison_lines(rows, name))
    ]
    parts += [rest_lines(rows), paper_lines(rows), cost_lines(rows)]
    text = "\n\n".join("\n".join(lines) for lines in parts)
    (folder / "table.txt").write_text(text + "\n")
    print(text)
    draw_bands(rows, folder / "bch.png")
    draw_strip(rows, folder / "strip.png")


def main() -> None:
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help=f"of the study, with {FILE}")
    folder = parser.parse_args().folder
    found = results_of(folder / FILE, "exploration")
    rows = sorted((row for trial in found for row in trial), key=lambda r: r["trial"])
    report(rows, folder)


if __name__ == "__main__":
    main()
