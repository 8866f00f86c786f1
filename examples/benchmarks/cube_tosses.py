"""Identify a real cube from 1, 4, 16 and 64 tosses, with a CSV file and a picture.

python examples/benchmarks/cube_tosses.py ../shared/captures/cube_tosses.npz [folder]

Each deal shuffles the tosses and splits them into disjoint groups; every group is
solved separately.  Errors of the sharp vertices are relative to the cube's half width
(in the file), errors of inertia and friction to the values that the recording's authors
report.
"""

from itertools import product
from pathlib import Path
from time import process_time

import numpy as np
from judging import quantile, refusal
from study import grouped, study_parser, table, tabled_study, telling

from tactilenlp import Scene, Trajectories, identify_body
from tactilenlp.errors import TactileError

SIGNS = np.indices((2, 2, 2)).reshape(3, 8).T * 2 - 1  # of a cube's vertices
SIZES, GROUPS = (1, 4, 16, 64), 8  # tosses of a group; groups of a size, at most
MM = 1e3


def known_of(file) -> dict[str, float]:
    """Return the numbers that the file has of its cube."""
    with np.load(file, allow_pickle=False) as archive:
        return {k: float(archive[k]) for k in archive.files if not archive[k].ndim}


def run(recording, deal, size, group, shape) -> dict:
    """Return one row: errors [mm], sigma [mm], ratios, friction, inertia, seconds.

    A group that is refused, or not solved, is a row without errors.
    """
    data, file = Trajectories.load(recording), known_of(recording)
    shuffled = np.random.default_rng(deal).permutation(data.tosses)
    chosen = np.sort(shuffled[group * size : (group + 1) * size])
    row = {"shape": shape, "tosses": size, "deal": deal, "group": group}
    row, began = row | {"refused": ""}, process_time()
    try:
        body = identify_body(data.select(chosen), Scene(mass=file["mass"]), shape=shape)
    except TactileError as error:
        return row | {"refused": refusal(error), "cpu_s": process_time() - began}
    return row | measured(body, file)


def measured(body, file) -> dict:
    """Return what a row has of a body, beside the numbers that the file has."""
    true = file["half_width"] * SIGNS
    error = np.stack([v - true[np.argmin(((true - v) ** 2).sum(1))]
                      for v in body.vertices])  # fmt: skip
    off = np.linalg.norm(error, axis=1) * MM
    ratio = (error / body.sigma["vertices"])[np.setdiff1d(range(8), body.unobserved)]
    return {
        "vertex_mean_mm": off.mean(), "vertex_worst_mm": off.max(),
        "sigma_mm": np.median(body.sigma["vertices"]) * MM,
        "rms_error_over_sigma": np.sqrt(np.mean(ratio**2)),
        "unobserved": len(body.unobserved), "friction": body.friction,
        "friction_sigma": float(body.sigma["friction"]),
        "inertia_over_reported": body.inertia.mean() / file["inertia_reported"],
        "gauge": body.gauge, "radius_mm": body.radius * MM,
        "iterations": body.iterations, "cpu_s": body.seconds["total"],
    }  # fmt: skip


def summary(rows) -> list[dict]:
    """Return medians and worst of every size, by shape; failures are infinite."""
    out = []
    for (shape, size), mine in grouped(rows, "shape", "tosses").items():
        about = {"shape": shape, "tosses": size, "groups": len(mine)}
        about["refused"] = sum(bool(r["refused"]) for r in mine)
        off = [r.get("vertex_mean_mm", np.inf) for r in mine]
        known = "sigma_mm", "friction", "friction_sigma"
        medians = {n: quantile([r.get(n, np.nan) for r in mine]) for n in known}
        worst = {"worst_mm": max(off), "worst cpu_s": max(r["cpu_s"] for r in mine)}
        out.append(about | {"vertex_mean_mm": quantile(off)} | medians | worst)
    return out


def draw(rows, friction, file) -> None:
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(9.5, 3.1), layout="constrained")
    for shape, colour, shift in (
        ("cuboid", "#0072B2", 0.96),
        ("corners", "#D55E00", 1.04),
    ):
        mine = [r for r in rows if r["shape"] == shape and not r["refused"]]
        x = np.array([r["tosses"] for r in mine]) * shift
        for axis, name in zip(
            axes, ("vertex_mean_mm", "friction", "cpu_s"), strict=True
        ):
            style = {"mfc": "none", "color": colour, "label": shape}
            axis.plot(x, [r[name] for r in mine], "o", **style)
        groups = sorted(grouped(mine, "tosses").items())
        sizes = [size for (size,), _ in groups]
        sigma = [np.median([r["sigma_mm"] for r in some]) for _, some in groups]
        # The mean length of a vector of three such components is about 1.6 sigma.
        axes[0].plot(sizes, 1.6 * np.array(sigma), "--", color=colour,
                     label=f"{shape}, predicted")  # fmt: skip
    axes[0].axhline(2, color="grey", ls=":", label="target")
    axes[1].axhline(friction, color="grey", ls=":", label="reported")
    axes[2].axhline(10, color="grey", ls=":")
    for axis, label in zip(axes, ("mean error of the vertices [mm]", "friction [1]",
                                  "run time [CPU s]"), strict=True):  # fmt: skip
        axis.set(xscale="log", xlabel="tosses", ylabel=label)
        axis.set_xticks(SIZES, map(str, SIZES))
        axis.xaxis.set_minor_formatter("")
        axis.spines[["top", "right"]].set_visible(False)
    for axis in (axes[0], axes[2]):
        axis.set_yscale("log")
    for axis in axes[:2]:
        axis.legend(frameon=False, fontsize=7)
    figure.savefig(file, dpi=150)


def main() -> None:
    parser = study_parser(__doc__, folder=False, executor="none")
    parser.add_argument("file", type=Path)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("benchmark"))
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    words = "seeds that shuffle the tosses"
    parser.add_argument("--deals", type=int, nargs="+", default=[0], help=words)
    given = parser.parse_args()
    data = Trajectories.load(given.file)
    known = known_of(given.file)
    cases = [
        (str(given.file), deal, size, group, shape)
        for deal, size in product(given.deals, given.sizes)
        for group in range(min(GROUPS, len(data.tosses) // size))
        for shape in ("cuboid", "corners")
    ]
    path = given.folder / "cube_tosses"
    say = telling(
        "refused", "vertex_mean_mm", "sigma_mm", "friction", "unobserved", "cpu_s"
    )
    rows = tabled_study(given, path, run, cases, say=say)
    print(table(summary(rows)))
    draw(rows, known["friction_reported"], path.with_suffix(".png"))


if __name__ == "__main__":
    main()
