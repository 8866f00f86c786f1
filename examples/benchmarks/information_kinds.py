"""Compare kinds of information: cost and conditioning against number of samples.

python examples/benchmarks/information_kinds.py ../shared/scenes/stress_long_cuboid.npz
    [--executor processes|dask|mpi|none], for the starts of each estimate

The propagation of past poses to the last one by inverse Jacobians of the dynamics (the
paper's first method) loses all digits within an action; the joint programme does not.
"""

from pathlib import Path
from time import process_time

import numpy as np
from matplotlib import pyplot as plt
from study import executor_of, study_parser, write_csv

from tactilenlp import Measurements, Scene, observed_information, solve_estimate
from tactilenlp.estimation.observed_information import INFORMATION_KINDS
from tactilenlp.estimation.programme import programme_at
from tactilenlp.information.comparisons import jacobians_by_last_pose
from tactilenlp.nlp.kkt import kkt_system_of

UNITS = np.r_[1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.05]  # [m, rad] make numbers comparable


def condition(matrix) -> float:
    """Return the condition number of an information in millimetres."""
    return float(np.linalg.cond(matrix * np.outer(UNITS, UNITS)))


def rows_of(file: Path, actions, executor) -> tuple[list[dict], object]:
    """Return a row for each number of actions, and the last estimate."""
    data, scene = Measurements.load(file), Scene.load(file)
    rows, estimate = [], None
    for na in actions:
        part = data.select(np.unique(data.action)[:na])
        estimate = solve_estimate(
            part, scene, start=estimate, executor=executor, throw=False
        )
        again = programme_at(estimate)
        row = {"actions": na, "samples": part.samples, "unknowns": again.problem.size}
        began = process_time()
        kkt = kkt_system_of(again.problem, again.solution)
        kkt.sensitivity(again.tangent.chosen)
        row["exact_ms"] = 1e3 * (process_time() - began)
        for kind in INFORMATION_KINDS:
            row[kind] = condition(observed_information(estimate, kind).matrix)
        print("  ".join(f"{k} {v:.3g}" for k, v in row.items()), flush=True)
        rows.append(row)
    return rows, estimate


def main() -> None:
    parser = study_parser(__doc__, folder=False, executor="none")
    parser.add_argument("file", type=Path)
    parser.add_argument("--actions", type=int, nargs="+", default=[2, 4, 6, 10, 15, 20])
    parser.add_argument("--folder", type=Path, default=Path("benchmark"))
    arguments = parser.parse_args()
    with executor_of(arguments) as executor:
        rows, estimate = rows_of(arguments.file, arguments.actions, executor)
    write_csv(arguments.folder / "information_kinds.csv", rows)
    again = programme_at(estimate)
    kkt = kkt_system_of(again.problem, again.solution)
    link, _ = jacobians_by_last_pose(kkt, again.window)
    figure, axes = plt.subplots(1, 3, figsize=(13, 4))
    back = np.arange(len(link))[::-1]
    axes[0].semilogy(back, [np.linalg.norm(chain, 2) for chain in link])
    axes[0].set(xlabel="poses before the last", ylabel="|dx_t / dx_T|, inverted")
    samples = [row["samples"] for row in rows]
    for kind in INFORMATION_KINDS:
        axes[1].semilogy(samples, [row[kind] for row in rows], "o-", label=kind)
    axes[1].set(xlabel="samples", ylabel="condition number of the information")
    axes[1].legend()
    axes[2].plot(samples, [row["exact_ms"] for row in rows], "o-")
    axes[2].set(xlabel="samples", ylabel="exact reduced Hessian [CPU ms]", ylim=0)
    figure.savefig(
        arguments.folder / "information_kinds.png", dpi=120, bbox_inches="tight"
    )


if __name__ == "__main__":
    main()
