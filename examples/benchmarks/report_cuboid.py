"""Report runs of estimate_cuboid.py: tables, every target beside its figure, a picture.

python examples/benchmarks/report_cuboid.py benchmark/runs.csv [more.csv ...]

A failed run is infinitely wrong and infinitely surprised: it spoils each statistic that
it belongs to.  na is the number of actions, s a predicted standard deviation.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

FULL = 6  # actions of the recordings that the targets are about
REACHED = 0.5  # [nats] an objective this close to the truth-started one is the same
TURNED, MOVED = 5.0, 1.0  # [deg, mm] an optimum off by more: wrong yaw, wrong face
SIDES = ("side_x", "side_y", "side_z")
PARTS = {  # position z is half of side z, and counts once
    "sizes": SIDES,
    "positions": ("position_x", "position_y"),
    "rotations": ("rotation_x", "rotation_y", "rotation_z"),
}
WAY = ("formulation", "path", "start", "noisy", "of", "na")
HEAD = (
    "formulation path      start    data  na/of  runs bad   mean mm: med   p90   max"
    "  far max  bCH (floor) mm    <3s %  |e|/s  reach %   presolve     joint  ms/it"
    "   CPU s  in refs"
)


def read(files) -> list[dict]:
    """Return the rows, with numbers and booleans where the text says so."""
    rows = []
    for file in files:
        with open(file, newline="") as stream:
            rows += [
                {k: value(v) for k, v in r.items()} for r in csv.DictReader(stream)
            ]
    return rows


def value(text):
    if text in ("True", "False"):
        return text == "True"
    try:
        return float(text)
    except (TypeError, ValueError):
        return text or np.nan


def select(rows, **wanted) -> list[dict]:
    return [r for r in rows if all(r[k] == v for k, v in wanted.items())]


def grouped(rows, names) -> dict[tuple, list[dict]]:
    groups = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return dict(sorted(groups.items()))


def column(rows, name, failed=np.inf) -> np.ndarray:
    """Return a column; `failed` stands where a run failed (None: what it has)."""
    keep = [r["success"] or failed is None for r in rows]
    got = [
        r.get(name, np.nan) if k else failed for r, k in zip(rows, keep, strict=True)
    ]
    return np.array(got, float)


def quantile(values, q=0.5) -> float:
    """Return a quantile of what is not NaN; infinite where a failure weighs in."""
    values = values[~np.isnan(values)]
    with np.errstate(invalid="ignore"):
        found = np.quantile(values, q) if len(values) else np.nan
    return np.inf if np.isnan(found) and len(values) else float(found)


def share(flags) -> float:
    """Return per cent."""
    return 100 * float(np.mean(flags)) if len(flags) else np.nan


def ratios(rows, parts=PARTS) -> np.ndarray:
    """Return |error| / sigma of all that is estimated (a fixed unknown has no sigma)."""
    names = [name for part in parts for name in PARTS[part]]
    out = [column(rows, f"{n}_error") / column(rows, f"{n}_sigma", 1) for n in names]
    out = np.abs(np.concatenate(out))
    return out[~np.isnan(out)]


def reached(rows) -> np.ndarray:
    best = column(rows, "truth_objective", -np.inf)
    return column(rows, "objective") <= best + REACHED


def miss(row) -> str:
    """Name what a run that reached less than the truth-started solve got wrong."""
    if not row["success"]:
        return row["error"].split(":")[0]
    if row["off_deg"] > TURNED:
        return "yaw"
    return "wrong face" if row["off_mm"] > MOVED else "path"


def touched(rows, what) -> np.ndarray:
    """Return |error| or sigma [mm] of the sizes of which both faces were touched."""
    felt = np.array([[r.get(f"touched_{s[-1]}") is True for s in SIDES] for r in rows])
    found = np.abs([column(rows, f"{s}_{what}", np.nan) for s in SIDES]).T
    return found[felt.reshape(found.shape)]


def print_table(rows) -> None:
    """Print one line for each way of estimating and number of actions."""
    print(HEAD)
    for group, r in grouped(rows, WAY).items():
        mean, cpu = column(r, "mean_mm"), column(r, "cpu_s", None)
        inner, joint = (column(r, f"{n}_iterations") for n in ("presolve", "joint"))
        ms, z = 1e3 * column(r, "solve_s") / (inner + joint), ratios(r)
        failed = sum(not row["success"] for row in r)
        print(
            f"{group[0]:11} {group[1]:9} {group[2]:8} {'noisy' if group[3] else 'clean'}"
            f" {group[5]:2.0f}/{group[4]:<2.0f}  {len(r):4} {failed:3}         "
            f"{quantile(mean):5.2f} {quantile(mean, 0.9):5.2f} {quantile(mean, 1):5.2f}"
            f"  {quantile(column(r, 'max_mm'), 1):7.2f}"
            f"    {quantile(column(r, 'bch_code_mm')):5.2f} "
            f"({quantile(column(r, 'bch_code_floor_mm', np.nan)):5.2f})"
            f"     {share(z < 3):5.1f}  {quantile(z):5.2f}  {share(reached(r)):7.1f}"
            f"   {quantile(inner):4.0f} {quantile(inner, 1):4.0f}"
            f" {quantile(joint):4.0f} {quantile(joint, 1):4.0f}  {quantile(ms):5.1f}"
            f"  {quantile(cpu):6.2f}  {quantile(cpu / column(r, 'reference_s', None)):7.0f}"
        )


def print_accuracy(planar) -> None:
    """Print what the planar page must show of accuracy and honesty, beside the target."""
    scratch = select(planar, start="scratch")
    for noisy, goals in ((False, (0.3, 1.0, 1.7)), (True, (1.0, 2.5, 4.0))):
        word, r = ("clean", "noisy")[noisy], select(scratch, noisy=noisy, na=FULL)
        line(f"{word}: runs that fail", sum(not x["success"] for x in r), 0, "of all")
        for name, q, goal in zip(("median", "p90", "worst"), (0.5, 0.9, 1), goals):  # noqa: B905
            error = quantile(column(r, "mean_mm"), q)
            line(f"{word}: {name} surface distance [mm]", error, goal)
    r = select(scratch, noisy=False, na=FULL)
    line("clean: worst touched size [mm]", touched(r, "error").max(initial=0), 0.2)
    line(
        "clean: median sigma of touched sizes [mm]", quantile(touched(r, "sigma")), 0.3
    )
    r = [x for x in scratch if x["na"] >= 2]
    line("na 2..6: outside 3 sigma [%]", 100 - share(ratios(r) < 3), 3)
    for part, z in (("all", ratios(r)), *((p, ratios(r, [p])) for p in PARTS)):
        line(f"na 2..6: median |error| / sigma, {part}", quantile(z), 1.0, "from 0.4")
    r = select(scratch, na=FULL)
    line("na 6: objective not reached [%]", 100 - share(reached(r)), 5)
    more = column(r, "mean_mm") / column(r, "truth_mean_mm", 1)
    line("na 6: median error over truth-started error", quantile(more), 1.1)
    for row, good in zip(scratch, reached(scratch), strict=True):
        if not good:
            name = f"{row['scene']}{' noisy' * row['noisy']} na {row['na']:.0f}"
            found = ", ".join(
                f"{k} {row.get(k, np.nan):.2f}"
                for k in ("objective", "truth_objective", "mean_mm", "truth_mean_mm")
            )
            print(f"    miss: {name}: {miss(row)} ({found})")


def print_cost(planar, rows) -> None:
    """Print what the planar page must show of effort, beside the target."""
    scratch = select(planar, start="scratch")
    joint, inner = (column(scratch, f"{n}_iterations") for n in ("joint", "presolve"))
    line("median iterations after the presolve", quantile(joint), 30)
    line("median iterations of the presolve", quantile(inner))
    line("not converged [%]", 100 - share(column(scratch, "success", 0) > 0), 1)
    r = select(scratch, na=FULL)
    steps = column(r, "presolve_iterations") + column(r, "joint_iterations")
    ms = 1e3 * column(r, "solve_s") / steps
    line("na 6: median ms per iteration", quantile(ms), 6)
    line("na 6: worst build [s]", quantile(column(r, "build_s"), 1), 0.1)
    update = [x for x in select(planar, na=FULL, start="previous") if x["carried"] == 5]
    for name, found, goal in (("from scratch", r, 4), ("update", update, 1)):
        cpu, unit = column(found, "cpu_s", None), column(found, "reference_s", None)
        line(f"na 6: median CPU {name} [s]", quantile(cpu), goal)
        line(f"na 6: median CPU {name} [references]", quantile(cpu / unit))
    line(
        "reference solve, median [ms]",
        1e3 * quantile(column(rows, "reference_s", None)),
    )
    kinds = column(rows, "kinds_s", None)
    line("derivation of kinds where any, median [s]", quantile(kinds[kinds > 0]))


def print_paths(rows) -> None:
    """Print the unreduced path against the reduced one, same scene and actions."""
    full = [r for r in rows if r["start"] == "scratch" and r["na"] == r["of"]]
    names = ("formulation", "scene", "noisy", "knowledge", "of")
    pairs = [{r["path"]: r for r in g} for g in grouped(full, names).values()]
    pairs = [p for p in pairs if len(p) == 2]
    for way in dict.fromkeys(p["reduced"]["formulation"] for p in pairs):
        both = [p for p in pairs if p["reduced"]["formulation"] == way]
        fine = [p for p in both if all(r["success"] for r in p.values())]
        after, before = ([p[k] for p in fine] for k in ("reduced", "unreduced"))
        line(f"{way}: pairs of paths, both converged", f"{len(fine)} of {len(both)}")
        times = column(after, "cpu_s") / column(before, "cpu_s")
        line(f"{way}: reduced over unreduced CPU, median", quantile(times), 0.2)
        off = np.abs(column(after, "objective") - column(before, "objective"))
        line(f"{way}: objectives apart, median [nats]", quantile(off), REACHED)
        line(f"{way}: objectives apart, worst [nats]", quantile(off, 1))


def line(what, found, goal=None, note="") -> None:
    """Print a figure, and beside it the most that it may be."""
    text = f"{found:.3g}" if isinstance(found, (int, float)) else str(found)
    verdict = "" if goal is None else f"target {goal:g} {note:9} "
    verdict += "" if goal is None else "met" if found <= goal else "NOT MET"
    print(f"  {what:52} {text:>10}  {verdict}")


def print_fates(rows) -> None:
    """Print what happens to each scene, for each thing that is believed of it."""
    kinds = list(dict.fromkeys(r["knowledge"] for r in rows))
    print("\nWhat happens to each: mean mm, worst |error| / sigma; or the error")
    print(" " * 36 + "".join(f"{kind:>19}" for kind in kinds))
    last = [
        r for r in select(rows, start="scratch", path="reduced") if r["na"] == r["of"]
    ]
    for group, found in grouped(last, ("scene", "noisy", "formulation")).items():
        cells = {r["knowledge"]: fate(r) for r in found}
        name = f"{group[0]}{' noisy' * group[1]} {group[2]}"
        print(f"{name:36}" + "".join(f"{cells.get(k, '-'):>19}" for k in kinds))
    bad = [r for r in rows if not r["success"]]
    print(f"\n{len(bad)} of {len(rows)} runs failed:")
    for (error, *_), found in grouped(bad, ("error",)).items():
        where = {f"{r['scene']}{' noisy' * r['noisy']} na {r['na']:.0f}" for r in found}
        print(f"  {len(found)} x {error[:240]}\n      {', '.join(sorted(where)[:6])}")


def fate(row) -> str:
    """Say good within 3 sigma or 3 mm, or where the package itself says why not."""
    if not row["success"]:
        name = row["error"].split(":")[0]
        return name + (" good" if name in ("NoContactError", "MotionError") else " BAD")
    worst = ratios([row]).max(initial=0)
    good = "good" if worst < 3 or row["mean_mm"] < 3 else "BAD"
    return f"{row['mean_mm']:.2f} {worst:.1f}s {good}"


def draw(rows, file) -> None:
    """Draw run time against error; failures lie on the upper edge."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    rows = [r for r in rows if r["knowledge"] == "known" and "cpu_s" in r]
    figure, axes = plt.subplots(1, 2, figsize=(11, 5), sharex=True, sharey=True)
    top = 2 * max((r["mean_mm"] for r in rows if r["success"]), default=1.0)
    for axis, noisy in zip(axes, (False, True), strict=True):
        ways = grouped(select(rows, noisy=noisy), ("formulation", "path", "start"))
        for way, found in ways.items():
            error = np.minimum(column(found, "mean_mm"), top)
            style = {"scratch": "o", "previous": "^"}[way[2]]
            style = "s" if way[1] == "unreduced" else style
            label, cpu = ", ".join(way), column(found, "cpu_s", None)
            axis.loglog(cpu, error, style, alpha=0.6, markersize=5, label=label)
        axis.axhline(top, color="grey", linewidth=0.8, linestyle=":")
        axis.annotate("failed", (0.02, top), xycoords=("axes fraction", "data"))
        axis.set(title="noisy" if noisy else "clean", xlabel="run time [CPU s]")
        axis.grid(which="both", alpha=0.2)
    axes[0].set_ylabel("mean surface distance to the truth [mm]")
    axes[1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file, dpi=120)


def report(files, folder) -> None:
    rows = read(files)
    known = select(rows, knowledge="known")
    print_table(known)
    planar = select(known, formulation="planar", path="reduced", of=FULL)
    print(f"\nPlanar page, recordings of {FULL} actions:")
    print_accuracy(planar)
    print_cost(planar, known)
    print_paths(known)
    print_fates(rows)
    draw(rows, Path(folder) / "time_against_error.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", type=Path, nargs="+")
    files = parser.parse_args().files
    report(files, files[0].parent)
