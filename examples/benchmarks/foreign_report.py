"""Summarise and draw what foreign.py has judged."""

import matplotlib.pyplot as plt
import numpy as np
from judging import quantile
from study import grouped

CELL = ("departure", "strength")
SIZES = tuple(f"side_{a}" for a in "xyz")
NUMBERS = (*SIZES, *(f"{p}_{a}" for p in ("position", "rotation") for a in "xyz"))
WITHIN, BEYOND = 3.0, 5.0  # [sigma]
HELD = 0.1  # [mm] deviation granted to what a reduction holds, as a flat body's tilt
COLOURS = {"good": "tab:blue", "poor": "tab:orange", "bad": "tab:red"}


def ratios(row: dict, names=NUMBERS) -> np.ndarray:
    """Return |error| / sigma of some numbers of an estimate; none for a refusal."""
    if row["refused"]:
        return np.full(len(names), np.inf)
    error = np.abs([row[f"{name}_error"] for name in names])
    sigma = np.array([row[f"{name}_sigma"] for name in names])
    return error / np.where(np.isnan(sigma), HELD, np.maximum(sigma, 1e-9))


def touched(row: dict) -> list[str]:
    """Return the names of the sizes that are touched on both faces."""
    return [f"side_{a}" for a in "xyz" if not row["refused"] and row[f"touched_{a}"]]


def summed(departure: str, strength: str, rows: list[dict]) -> dict:
    """Return the row of the summary that some estimates make.

    A refusal is outside 3 sigma, and counts as one touched size, infinitely far off.
    """
    kept = [row for row in rows if not row["refused"]]
    failed = [np.inf] * (len(rows) - len(kept))
    every = np.concatenate([ratios(row) for row in rows])
    sizes = [(row, touched(row)) for row in kept]
    errors = [abs(row[f"{name}_error"]) for row, names in sizes for name in names]
    of_touched = np.concatenate([*[ratios(r, n) for r, n in sizes], failed])
    wrong = [(ratios(row) > BEYOND).sum() for row in kept if row["verdict"] == "good"]
    inside = [row for row in kept if (ratios(row) <= WITHIN).all()]
    return {
        "departure": departure, "strength": strength, "n": len(rows),
        "refused": len(failed),
        "within_3_sigma": float((every <= WITHIN).mean()),
        "beyond_5_sigma_good": int(sum(wrong)),
        "touched_mm": quantile(errors + failed),
        "touched_sigmas": quantile(of_touched),
        **{v: sum(row["verdict"] == v for row in kept) for v in COLOURS},
        "inside_not_good": sum(row["verdict"] != "good" for row in inside),
        "cpu_s": quantile([row["cpu_s"] for row in rows]),
    }  # fmt: skip


def summary(rows, summed=summed) -> list[dict]:
    """Return one row for every departure and strength, and one for all."""
    cells = grouped(rows, *CELL) | {("all", ""): rows}
    return [summed(*cell, mine) for cell, mine in cells.items()]


def picture(rows, path) -> None:
    """Draw errors of touched sizes, and all errors in sigma, by departure."""
    cells = grouped(rows, *CELL)
    size = max(7.0, 2 + 0.32 * len(cells)), 7.5
    figure, (accuracy, calibration) = plt.subplots(2, 1, figsize=size, sharex=True)
    for k, mine in enumerate(cells.values()):
        kept = [row for row in mine if not row["refused"]]
        for row in kept:
            errors = [abs(row[f"{name}_error"]) for name in touched(row)]
            dots(accuracy, k, errors, 1e-3, row["verdict"])
            dots(calibration, k, ratios(row), 1e-2, row["verdict"])
        errors = [abs(r[f"{n}_error"]) for r in kept for n in touched(r)]
        middle = [quantile(errors), quantile([x for r in kept for x in ratios(r)])]
        for ax, y in zip((accuracy, calibration), middle, strict=True):
            ax.plot([k - 0.35, k + 0.35], [y, y], color="black", linewidth=1.5)
        if len(kept) < len(mine):
            calibration.annotate(f"{len(mine) - len(kept)} refused", (k, 1e-2),
                                 rotation=90, fontsize="x-small")  # fmt: skip
    for limit in (WITHIN, BEYOND):
        calibration.axhline(limit, color="0.5", linestyle=":")
    for verdict, colour in COLOURS.items():
        accuracy.plot([], [], ".", color=colour, label=f"fit {verdict}")
    accuracy.set(yscale="log", ylabel="|error| of touched sizes [mm]")
    calibration.set(yscale="log", ylabel="|error| / sigma, sizes and final pose")
    names = [" ".join(cell).strip() for cell in cells]
    calibration.set_xticks(range(len(cells)), names, rotation=90)
    accuracy.legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(path, dpi=150)
    plt.close(figure)


def dots(ax, k: int, values, least: float, verdict: str) -> None:
    """Draw numbers of one estimate in column k, none below `least`."""
    spread = np.linspace(-0.25, 0.25, max(2, len(values)))[: len(values)]
    y = np.maximum(values, least)
    ax.plot(k + spread, y, ".", color=COLOURS[verdict], markersize=4)
