"""Report runs of estimate_cuboid.py: tables, targets beside figures, a picture.

python examples/benchmarks/report_cuboid.py benchmark/runs.json [more.json ...]

The error of a failed run is infinite.  na: actions; s: predicted sigma.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import study
from judging import quantile

FULL = 6  # actions of the recordings that the targets are about
REACHED = 0.5  # [nats] an objective this close to the truth-started one is the same
TURNED, MOVED = 5.0, 1.0  # [deg, mm] an optimum off by more: wrong yaw, wrong face
SIDES, TURNS = (
    ("side_x", "side_y", "side_z"),
    ("rotation_x", "rotation_y", "rotation_z"),
)
PLACES = ("position_x", "position_y")  # z is half of side z, and counts once
MEASURED = ("cpu_s", "cpu_in_references", "kinds_s")
WAY = ("formulation", "path", "start", "noisy", "of", "na")


def select(rows, **wanted) -> list[dict]:
    return [r for r in rows if all(r.get(k) == v for k, v in wanted.items())]


def grouped(rows, *names) -> dict[tuple, list[dict]]:
    return dict(sorted(study.grouped(rows, *names).items()))


def column(rows, name) -> np.ndarray:
    """Return a column, infinite where a run failed; its seconds count as they are."""
    bad = np.nan if name in MEASURED else np.inf
    return np.array([r.get(name, np.nan if r["success"] else bad) for r in rows], float)


def surprise(rows, names=(*SIDES, *PLACES, *TURNS)) -> np.ndarray:
    """Return |error| / sigma of what is estimated (what is fixed has no sigma)."""
    found = np.concatenate([column(rows, f"{name}_ratio") for name in names])
    return found[~np.isnan(found)]


def touched(rows, what) -> np.ndarray:
    """Return |error| or sigma [mm] of the sizes of which both faces were touched."""
    both = [select(rows, **{f"touched_{side[-1]}": True}) for side in SIDES]
    found = [column(r, f"{s}_{what}") for s, r in zip(SIDES, both, strict=True)]
    return np.abs(np.concatenate(found))


def failed(rows) -> float:  # per cent
    return 100 * np.mean([not row["success"] for row in rows])


def missed(rows) -> float:  # per cent
    return 100 * np.mean([miss(row) is not None for row in rows])


def figure(rows, what, *q) -> float:
    """Return a quantile of a column, or what a function makes of the runs, if any."""
    return (quantile(column(rows, what), *q) if q else what(rows)) if rows else np.nan


TABLE = {  # heading: column and quantile, or function of runs
    "runs": (len,),
    "failed": (lambda r: len(r) - len(select(r, success=True)),),
    "mean med": ("mean_mm", 0.5),
    "p90": ("mean_mm", 0.9),
    "worst": ("mean_mm", 1),
    "max": ("max_mm", 1),
    "bCH": ("bch_code_mm", 0.5),
    "floor": ("bch_code_floor_mm", 0.5),
    "<3s %": (lambda r: 100 * np.mean(surprise(r) < 3),),
    "|e|/s": (lambda r: quantile(surprise(r)),),
    "s touched": (lambda r: quantile(touched(r, "sigma")),),
    "reach %": (lambda r: 100 - missed(r),),
    "presolve": ("presolve_iterations", 0.5),
    "most": ("presolve_iterations", 1),
    "joint": ("joint_iterations", 0.5),
    "most joint": ("joint_iterations", 1),
    "ms/it": ("ms_per_iteration", 0.5),
    "CPU s": ("cpu_s", 0.5),
    "solves": ("cpu_in_references", 0.5),
}
TARGETS = (  # runs, what it is, the most (or range) that it may be; how, as above
    ("clean", "failed [%]", 0, failed),
    ("clean", "median surface distance [mm]", 0.3, "mean_mm", 0.5),
    ("clean", "90th percentile of it [mm]", 1.0, "mean_mm", 0.9),
    ("clean", "worst of it [mm]", 1.7, "mean_mm", 1),
    ("noisy", "failed [%]", 0, failed),
    ("noisy", "median surface distance [mm]", 1.0, "mean_mm", 0.5),
    ("noisy", "90th percentile of it [mm]", 2.5, "mean_mm", 0.9),
    ("noisy", "worst of it [mm]", 4.0, "mean_mm", 1),
    (
        "clean",
        "worst touched size [mm]",
        0.2,
        lambda r: quantile(touched(r, "error"), 1),
    ),
    ("clean", "median s of touched [mm]", 0.3, lambda r: quantile(touched(r, "sigma"))),
    ("na 2..6", "beyond 3 s [%]", 3, lambda r: 100 * np.mean(surprise(r) >= 3)),
    ("na 2..6", "median |e|/s", (0.4, 1), lambda r: quantile(surprise(r))),
    ("na 2..6", "  of sizes", (0.4, 1), lambda r: quantile(surprise(r, SIDES))),
    ("na 2..6", "  of positions", (0.4, 1), lambda r: quantile(surprise(r, PLACES))),
    ("na 2..6", "  of rotations", (0.4, 1), lambda r: quantile(surprise(r, TURNS))),
    ("na 6", "missed the objective of the truth [%]", 5, missed),
    ("na 6", "median error / truth-started error", 1.1, "mean_over_truth", 0.5),
    ("na 1..6", "median iterations of the presolve", None, "presolve_iterations", 0.5),
    ("na 1..6", "median iterations after it", 30, "joint_iterations", 0.5),
    ("na 1..6", "failed or not converged [%]", 1, failed),
    ("na 6", "median ms per iteration", 6, "ms_per_iteration", 0.5),
    ("na 6", "worst build [s]", 0.1, "build_s", 1),
    ("na 6", "median CPU from scratch [s]", 4, "cpu_s", 0.5),
    ("na 6", "median CPU in reference solves", None, "cpu_in_references", 0.5),
    ("update", "median CPU of the sixth action [s]", 1, "cpu_s", 0.5),
    ("update", "median CPU in reference solves", None, "cpu_in_references", 0.5),
    ("na 1..6", "most seconds of deriving kinds, apart", None, "kinds_s", 1),
)


def print_table(rows) -> None:
    """Print one line for each way of estimating and number of actions [mm]."""
    print(study.table([
        dict(zip(WAY, way, strict=True)) | {k: figure(r, *q) for k, q in TABLE.items()}
        for way, r in grouped(rows, *WAY).items()
    ]))  # fmt: skip


def print_targets(planar) -> None:
    """Print every figure that the planar page must show beside its target."""
    print(f"\nPlanar page, reduced, recordings cuboid_* of {FULL} actions:")
    runs = {"na 1..6": select(planar, start="scratch")}
    runs["na 2..6"] = [row for row in runs["na 1..6"] if row["na"] >= 2]
    runs["na 6"] = select(runs["na 1..6"], na=FULL)
    runs["clean"] = select(runs["na 6"], noisy=False)
    runs["noisy"] = select(runs["na 6"], noisy=True)
    runs["update"] = select(planar, start="previous", na=FULL, carried=FULL - 1)
    for name, what, goal, *how in TARGETS:
        print_target(f"{name:8} {what}", figure(runs[name], *how), goal)


def print_target(what, found, goal) -> None:
    low, high = goal if isinstance(goal, tuple) else (-np.inf, goal)
    verdict = "met" if goal is None or low <= found <= high else "NOT MET"
    verdict = "no run" if np.isnan(found) else verdict * (goal is not None)
    print(f"  {what:54} {found:8.3g}  {'' if goal is None else goal!s:10} {verdict}")


def print_paths(rows) -> None:
    """Print the reduced path against the unreduced one of the same scene and na.

    Of each formulation, and of all that is skipped: planar motion is a reduction, too.
    A programme is solved from the true motion, the same start for both; the search is
    the same for both as well.
    """
    last = [r for r in select(rows, start="scratch") if r["na"] == r["of"]]
    ways = [(page, page) for (page,) in grouped(last, "formulation")]
    for page, freest in [*ways, ("planar", "six_dof")]:
        after = select(last, formulation=page, path="reduced")
        before = select(last, formulation=freest, path="unreduced")
        pairs = grouped([*after, *before], "scene", "noisy").values()
        pairs = [pair for pair in pairs if len(pair) == 2]
        good = [pair for pair in pairs if not failed(pair)]
        name = page if page == freest else f"{page} against {freest}"
        print(f"{name}: {len(good)} of {len(pairs)} solved both ways")
        after, before = zip(*good, strict=True) if good else ((), ())
        apart = np.abs(column(after, "objective") - column(before, "objective"))
        for what, of in (("programme", "truth_solve_s"), ("search and all", "cpu_s")):
            ratio = column(after, of) / column(before, of)
            print_target(f"  CPU ratio, {what}", quantile(ratio), 0.2)
        print_target("  objectives apart, worst", quantile(apart, 1), REACHED)


def print_fates(rows) -> None:
    """Print what happens to each scene, for each thing that is believed of it."""
    print("\nWhat happens to each: mean mm, worst |error| / sigma; or the error")
    kinds = list(dict.fromkeys(r["knowledge"] for r in rows))
    print(" " * 36 + "".join(f"{kind:>21}" for kind in kinds))
    found = [r for r in select(rows, start="scratch") if r["na"] == r["of"]]
    found = grouped(select(found, path="reduced"), "scene", "noisy", "formulation")
    for (scene, noisy, page), r in found.items():
        cells = {row["knowledge"]: fate(row) for row in r}
        cells = "".join(f"{cells.get(kind, '-'):>21}" for kind in kinds)
        print(f"{scene + ' noisy' * noisy + ' ' + page:36}{cells}")
    print(
        f"\n{missed(rows):.1f} % of {len(rows)} runs failed or missed, by scene, way:"
    )
    for row in (row for row in rows if miss(row)):
        print("  ", *(row[k] for k in ("scene", *WAY, "knowledge")), miss(row)[:300])


def miss(row) -> str | None:
    """Name what a run got wrong that reached less than the truth-started solve."""
    if not row["success"]:
        return row["error"]
    found, best = row["objective"], row["truth_objective"]
    name = "wrong face" if row["off_mm"] > MOVED else "path"
    name = "yaw" if row["off_deg"] > TURNED else name
    reached = found <= best + REACHED
    return None if reached else f"{name}: {found:.2f}, truth-started {best:.2f}"


def fate(row) -> str:
    """Say good within 3 sigma or 3 mm, or where the package itself says why not."""
    if not row["success"]:
        name = row["error"].split(":")[0]
        return name + (" good" if name in ("NoContactError", "MotionError") else " BAD")
    mean, worst = row["mean_mm"], surprise([row]).max(initial=0)
    return f"{mean:.2f} {worst:.1f}s {'good' if worst < 3 or mean < 3 else 'BAD'}"


def draw(rows, file) -> None:
    """Draw run time against error; failures lie on the upper edge."""
    from matplotlib import pyplot as plt

    picture, axes = plt.subplots(1, 2, sharex=True, sharey=True, figsize=(11, 5))
    top = 2 * max((r["mean_mm"] for r in select(rows, success=True)), default=1.0)
    for i, way in enumerate(grouped(rows, *WAY[:3])):
        for axis, noisy in zip(axes, (False, True), strict=True):
            r = select(rows, noisy=noisy, **dict(zip(WAY, way, strict=False)))
            cpu, error = [row["cpu_s"] for row in r], column(r, "mean_mm")
            style = {"marker": "os^vDX*P<"[i], "alpha": 0.5, "label": ", ".join(way)}
            axis.scatter(cpu, np.minimum(error, top), 20, **style)
            axis.set(xlabel="run time [CPU s]", xscale="log", yscale="log")
            axis.set_title(f"{('clean', 'noisy')[noisy]} (failed: on the dotted line)")
            axis.axhline(top, color="grey", linestyle=":")
            axis.xaxis.set_minor_formatter("")
    axes[0].set_ylabel("mean surface distance to the truth [mm]")
    axes[1].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
    picture.savefig(file, dpi=120, bbox_inches="tight")


def report(files) -> None:
    rows = [row for file in files for row in json.loads(file.read_text())]
    known = select(rows, knowledge="known")
    print_table(known)
    planar = select(known, formulation="planar", path="reduced", of=FULL)
    print_targets([row for row in planar if row["scene"].startswith("cuboid_")])
    print_paths(known)
    print_fates(rows)
    draw([r for r in known if "cpu_s" in r], files[0].parent / "time_against_error.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", type=Path, nargs="+")
    report(parser.parse_args().files)
