"""Judge estimates of hulls in worlds that the estimator was not developed with.

    python examples/benchmarks/foreign_hulls.py folder [--count 6] [--first 0]
        [--actions 6] [--departures contact "dropped at random"]
        [--executor processes|dask|mpi|none] [--workers 2]

As foreign.py, for hulls in place of boxes: the five Platonic solids in turn, then
an irregular hull.  A hull has no sizes and no pose of its own.  Judged are the
supporting planes at the last sample that TOUCHES or more touches support: by how much
the true body is off each, and its standard deviation.  `surface_mm`: mean exact
distance between the surfaces.  A refusal counts as one plane that is infinitely far off
and outside three sigma.  The script writes foreign_hulls.csv (one row an
estimate) and foreign_hulls_summary.csv (one row a departure and strength).
"""

import numpy as np
from foreign import arguments, cells, measured, warm
from foreign_bodies import Hull
from foreign_departures import DEPARTURES
from foreign_report import BEYOND, COLOURS, WITHIN, summary
from judging import planes_off, quantile, solved
from regress import true_mesh
from study import table, tabled_study, telling, write_csv

from tactilenlp import surface_distance

TOUCHES = 3  # that support a plane that is judged
TOLD = ("refused", "surface_mm", "off_mm", "verdict", "nats", "cpu_s")
OF_HULLS = tuple(name for name in DEPARTURES if name != "edges")  # theirs are sharp


def judged(departure: str, strength: str, number: int, actions: int) -> dict:
    """Return one row of the table [mm]."""
    warm(Hull, "polytope")
    data, scene, true = measured(departure, strength, number, actions, body=Hull)
    row = {"departure": departure, "strength": strength, "hull": number}
    mesh = true_mesh(true)
    estimate, told = solved(data, scene, shape="polytope")
    row |= told
    if estimate is None:
        return row
    planes = estimate.supporting_planes()
    known = planes.touches >= TOUCHES
    off = planes_off(planes, mesh)[known]
    return row | {
        "verdict": estimate.fit.verdict, "nats": estimate.objective,
        "surface_mm": 1e3 * surface_distance(estimate.mesh(), mesh).mean,
        "off_mm": (1e3 * off).round(4).tolist(),
        "sigma_mm": (1e3 * planes.sigma[known]).round(4).tolist(),
    }  # fmt: skip


def summed(departure: str, strength: str, rows: list[dict]) -> dict:
    """Return the row of the summary that some estimates make."""
    kept = [row for row in rows if not row["refused"]]
    failed = [np.inf] * (len(rows) - len(kept))
    off = [e for row in kept for e in row["off_mm"]]
    ratio = [np.divide(row["off_mm"], row["sigma_mm"]) for row in kept]
    good = [r for r, row in zip(ratio, kept, strict=True) if row["verdict"] == "good"]
    every = np.concatenate([*ratio, failed])
    return {
        "departure": departure, "strength": strength, "n": len(rows),
        "refused": len(failed), "planes": len(off),
        "within_3_sigma": float((every <= WITHIN).mean()) if len(every) else np.nan,
        "beyond_5_sigma_good": sum(int((r > BEYOND).sum()) for r in good),
        "plane_mm": quantile(off + failed), "plane_sigmas": quantile(every),
        "surface_mm": quantile([row["surface_mm"] for row in kept] + failed),
        **{v: sum(row["verdict"] == v for row in kept) for v in COLOURS},
        "cpu_s": quantile([row["cpu_s"] for row in rows]),
    }  # fmt: skip


def main() -> None:
    parser = arguments(__doc__, "hulls", 6, 6, OF_HULLS)
    chosen = parser.parse_args()
    path = chosen.folder / "foreign_hulls"
    rows = tabled_study(chosen, path, judged, cells(chosen), say=telling(*TOLD))
    kinds = summary(rows, summed)
    write_csv(chosen.folder / "foreign_hulls_summary.csv", kinds)
    print(table(kinds))


if __name__ == "__main__":
    main()
