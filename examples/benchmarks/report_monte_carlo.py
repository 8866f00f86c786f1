"""Report runs of monte_carlo.py: table, CSV and picture of predicted over scatter.

python examples/benchmarks/report_monte_carlo.py benchmark/monte_carlo

A parameter counts as observed where sensor noise makes up more than half of the
variance of `information.sigma`; parameters that physics or priors determine do not
scatter.  The scatter of few runs is itself uncertain.  Beside "within 15 %", therefore,
stands how many parameters lie in the interval that would contain 95 % of them if every
sigma were exact.
"""

from argparse import ArgumentParser
from pathlib import Path

import numpy as np
from scipy.stats import chi2
from study import grouped, results_of, table, write_csv

FILE = "monte_carlo.jsonl"  # of the study, in its folder
KINDS = ("user", "exact", "sandwich", "gauss_newton", "paper")
WITHIN = 0.15  # of the scatter a predicted sigma shall be
KNOWN = 1e-4  # [-] of the others: a direction this sharp is known exactly


def rows_of(folder: Path) -> dict[str, list[dict]]:
    """Return the successful rows by scene, and say how many failed."""
    found = {}
    rows = results_of(folder / FILE, "monte carlo")
    for (scene,), some in sorted(grouped(rows, "scene").items()):
        good = [row for row in some if row["success"]]
        if len(good) < len(some):
            print(f"{scene}: {len(some) - len(good)} of {len(some)} failed")
        if len(good) > 2:
            found[scene] = good
    return found


def compare(scene: str, rows: list[dict]) -> list[dict]:
    """Return a line a parameter: scatter, and predicted over seen by kind."""
    names = rows[0]["names"]
    error = np.array([row["error"] for row in rows])
    scatter, sigma = error.std(axis=0, ddof=1), {}
    for kind in KINDS:
        variance = [np.diag(row[kind]) for row in rows]
        sigma[kind] = np.sqrt(np.median(variance, axis=0))
    lines = []
    for i, name in enumerate(names):
        unit = 180 / np.pi if name.startswith("rotation") else 1e3
        share = (sigma["sandwich"][i] / sigma["user"][i]) ** 2
        line = {"scene": scene, "parameter": name, "runs": len(rows)}
        line |= {"bias": error[:, i].mean() * unit, "scatter": scatter[i] * unit}
        line["observed"] = bool(share > 0.5)
        line |= {kind: sigma[kind][i] / scatter[i] for kind in KINDS}
        lines.append(line)
    return lines


def told_by(runs: int) -> np.ndarray:
    """Return between what a true sigma over the scatter of so many runs lies, 95 %."""
    return np.sqrt((runs - 1) / chi2.ppf([0.975, 0.025], runs - 1))


def nees(rows: list[dict], kind: str, centre) -> np.ndarray:
    """Return the squared error in units of the covariance, its rank, (runs, 2)."""
    out = []
    for row in rows:
        C, e = np.array(row[kind]), np.array(row["error"]) - centre
        d = np.sqrt(np.abs(np.diag(C)))
        d[d == 0] = 1.0
        values, vectors = np.linalg.eigh(C / np.outer(d, d))
        used = values > KNOWN * values.max()
        out.append(
            (((vectors.T @ (e / d))[used] ** 2 / values[used]).sum(), used.sum())
        )
    return np.array(out)


def pooled(found: dict, kind: str, truth: bool) -> tuple[float, float, float]:
    """Return the mean NEES per dimension over all scenes, and its 95 % band."""
    total, freedom = 0.0, 0.0
    for rows in found.values():
        mean = np.mean([row["error"] for row in rows], axis=0)
        squares = nees(rows, kind, 0 * mean if truth else mean)
        total += squares[:, 0].sum()
        freedom += squares[:, 1].sum() * (1 if truth else 1 - 1 / len(rows))
    low, high = chi2.ppf([0.025, 0.975], freedom) / freedom
    return total / freedom, low, high


def report(folder: Path) -> None:
    found = rows_of(folder)
    lines = [line for scene, rows in found.items() for line in compare(scene, rows)]
    if not lines:
        print("no runs yet")
        return
    write_csv(folder / "monte_carlo.csv", lines)
    print(f"[mm, deg]; predicted / scatter by kind\n{table(lines)}")
    seen = [line for line in lines if line["observed"]]
    for kind in KINDS:
        about = "{:.2f} (95 % band {:.2f} to {:.2f})".format(
            *pooled(found, kind, False)
        )
        true = f"{pooled(found, kind, True)[0]:.2f}"
        print(f"{kind:13} {of_observed(seen, kind)}")
        print(f"{'':13} NEES about the mean {about}, about the truth {true}")
    draw(lines, folder / "monte_carlo.png")


def of_observed(seen: list[dict], kind: str) -> str:
    """Return how many of the observed parameters have a true sigma, in words."""
    if not seen:
        return "none observed"
    good = np.mean([abs(line[kind] - 1) <= WITHIN for line in seen])
    bands = [told_by(line["runs"]) for line in seen]
    fits = np.mean([
        low < line[kind] < high for line, (low, high) in zip(seen, bands, strict=True)
    ])  # fmt: skip
    middle = np.median([line[kind] for line in seen])
    within = f"{good:4.0%} of {len(seen)} observed within 15 %"
    within += f", {fits:4.0%} as far as the runs can tell"
    return f"{within}, median ratio {middle:.2f}"


def draw(lines, file) -> None:
    """Draw predicted over seen scatter of every parameter, by kind."""
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(10, 5))
    axis.axhspan(1 - WITHIN, 1 + WITHIN, color="0.9")
    axis.axhline(1, color="0.5", linewidth=1)
    for i, kind in enumerate(KINDS):
        for observed, marker in ((True, "o"), (False, "x")):
            y = [line[kind] for line in lines if line["observed"] == observed]
            x = i + np.linspace(-0.3, 0.3, len(y) + 2)[1:-1]
            axis.scatter(x, y, 25, color=f"C{i}", marker=marker)
    axis.set(yscale="log", ylabel="predicted sigma / scatter of the estimates")
    axis.set_xticks(range(len(KINDS)), KINDS)
    axis.set_title("dots: observed by touch; crosses: held by physics or priors")
    figure.savefig(file, dpi=120, bbox_inches="tight")
    plt.close(figure)


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help=f"of the study, with {FILE}")
    report(parser.parse_args().folder)
