"""Measure the time to build a page's problem against the number of samples.

    python examples/benchmarks/build_time.py ../shared/scenes/cuboid_00.npz
        ../shared/scenes/platonic_*_0.npz [--actions 3 6 9] [--denser 2 3]
        [--executor processes|dask|mpi|none]

A recording is cut after some actions, or resampled: fingers and poses are interpolated
linearly between its samples.  The problem is that of the hypothesis that a search of
the whole recording found.  Columns: window, the reduction of the data; page, the terms,
whose term functions are already derived; derivatives, the functions of their sum;
solver, the construction of IPOPT.

Times are CPU milliseconds, medians of passes that build all cases in turn, after one
uncounted pass.  growth is the ratio of the total to that of the first case; the target
is at most 1.2.
"""

from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from reductions import recorded, searched
from study import executor_of, mapped, study_parser, table, write_csv

from tactilenlp import Measurements, Problem, SolverOptions
from tactilenlp.solvers.solve import Solvers

PARTS = ("window", "page", "derivatives", "solver")


def denser(data, x, times: int) -> tuple[Measurements, np.ndarray]:
    """Return data and poses x (3, T) with `times` samples in each sample interval.

    What a finger feels on the way to a sample is what it feels there.
    """
    later = np.r_[0, np.repeat(np.arange(1, data.samples), times)]
    part = np.r_[1.0, np.tile(np.arange(1, times + 1) / times, data.samples - 1)]
    inside = data.action[later] == data.action[later - 1]
    later, part = (a[inside | (part == 1)] for a in (later, part))

    def on_the_way(values):
        share = part.reshape(-1, *[1] * (values.ndim - 1))
        return share * values[later] + (1 - share) * values[later - 1]

    felt = {
        k: getattr(data, k)[later] for k in ("contact", "normal", "action", "valid")
    }
    moved = {k: on_the_way(getattr(data, k)) for k in ("time", "finger_position")}
    made = Measurements(**felt, **moved, finger_radius=data.finger_radius)
    return made, on_the_way(x.T).T


def cases_of(way, h, actions, times) -> dict:
    """Return (way, hypothesis) of a recording cut after actions, and made denser."""
    cases = {}
    names = np.unique(way.data.action)
    for count in sorted({min(count, len(names)) for count in actions}):
        data = way.data.select(names[:count])
        cases[f"{count} actions"] = replace(way, data=data), h.at(data.samples)
    for k in times:
        data, x = denser(way.data, h.x, k)
        cases[f"{k} times as dense"] = replace(way, data=data), replace(h, x=x)
    return cases


def built(way, h) -> tuple[Problem, list[float]]:
    """Return the problem of a hypothesis and the CPU seconds of each of PARTS."""
    job, problem, times = way.job(), Problem(), [process_time()]
    window = job.window((h.theta, h.x))
    times.append(process_time())
    way.page.build(problem, window, way.scene, window.shape)
    times.append(process_time())
    _ = problem.assembly.functions
    times.append(process_time())
    Solvers(problem).solver_for(SolverOptions())
    return problem, np.diff([*times, process_time()]).tolist()


def measured(file, actions, times, passes) -> list[dict]:
    """Return a row for every number of samples of one recording."""
    way = recorded(file)
    cases = cases_of(way, searched(way), actions, times)
    _, *runs = [{k: built(*c) for k, c in cases.items()} for _ in range(passes + 1)]
    rows = []
    for name, (case, _) in cases.items():
        problem, _ = runs[0][name]
        parts = 1e3 * np.median([run[name][1] for run in runs], axis=0)
        whole = 1e3 * np.median([sum(run[name][1]) for run in runs])
        rows.append({
            "scene": Path(file).stem, "class": way.shape.name, "case": name,
            "samples": case.data.samples, "variables": problem.size,
            "terms": sum(term.instances for term in problem.terms.values()),
            **dict(zip(PARTS, parts.tolist(), strict=True)), "build": float(whole),
        })  # fmt: skip
    return rows


def main() -> None:
    parser = study_parser(__doc__, folder=False, executor="none")
    parser.add_argument("files", nargs="+")
    parser.add_argument("--actions", type=int, nargs="+", default=[3, 6, 9])
    parser.add_argument("--denser", type=int, nargs="*", default=[2, 3])
    parser.add_argument("--passes", type=int, default=7)
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    chosen = parser.parse_args()
    cases = [(f, chosen.actions, chosen.denser, chosen.passes) for f in chosen.files]
    rows = []
    with executor_of(chosen) as executor:
        for found in mapped(executor, measured, cases):
            rows += found
            grown = [r | {"growth": r["build"] / found[0]["build"]} for r in found]
            print(table(grown), flush=True)
    write_csv(chosen.out / "build_time.csv", rows)


if __name__ == "__main__":
    main()
