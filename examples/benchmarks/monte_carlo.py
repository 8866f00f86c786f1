"""Compare predicted sigma with the scatter of repeated measurements.

python examples/benchmarks/monte_carlo.py ../shared/scenes/cuboid_02.npz ... --count 60

Each recording is measured again `count` times with new noise and solved from its true
motion, so that one local optimum is studied; one that tumbles is searched anew.  Errors
and covariances are modulo the symmetries of a box: sizes are on the true axes.  Every
result is saved in one file in the folder (study.py), and a run that was stopped
resumes.  `measure` is a plain function of plain arguments, so any concurrent.futures
executor can distribute it.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from estimate_cuboid import Truth, apart
from judging import solved
from report_monte_carlo import FILE, KINDS, report
from study import executor_of, run_study, study_parser

from tactilenlp import Measurements, Noise, Options, Scene, observed_information
from tactilenlp import solve_estimate as solve
from tactilenlp.data.noise_model import add_noise
from tactilenlp.geometry.transforms import rotation_of

TILTED = np.radians(20)  # an object whose axes turn this much out of the flat tumbles
NOISE = {"position": 1e-3, "normal": np.radians(5), "flips": 0.01}  # [m], [rad], [1]
FREE = [f"{q} {w}" for q in ("side", "position", "rotation") for w in "xyz"]


@cache
def known(file: str, actions: int):
    """Return data, scene, truth, options and a start at the true motion."""
    data, truth = Measurements.load(file), Truth(file)
    data = data.select(np.unique(data.action)[:actions])
    up = rotation_of(truth.quaternion).as_matrix()[:, 2]
    turned = np.arccos(np.clip(up @ up[0], -1, 1)).max() > TILTED
    options = Options(without=["planar"] if turned else (), profile_likelihood=False)
    first = data.select(np.unique(data.action)[:1])
    begun = solve(first, Scene.load(file), options=options, throw=False)
    return data, Scene.load(file), truth, options, begun


def measure(file: str, actions: int, number: int, noise: dict) -> dict:
    """Return the row of one re-measurement: errors and covariances by kind, SI."""
    data, scene, truth, options, begun = known(file, actions)
    noisy = add_noise(data, Noise(seed=number, **noise))
    begun = replace(begun, measurements=noisy, success=False)  # it is of one action
    # A start is continued by a search in the plane, which a tumble leaves.
    start = None if "planar" in options.without else truth.start(begun)
    how = {"start": start, "options": options, "throw": False}
    estimate, told = solved(noisy, scene, **how)
    last, row = noisy.samples - 1, {"scene": Path(file).stem, "number": number}
    row |= told | {"success": bool(estimate and estimate.success)}
    if not row["success"]:
        return row
    error, names = apart(estimate, truth, last), estimate.information.names
    free = np.r_[error.side_lengths, error.position, error.rotation_vector]
    free = dict(zip(FREE, free, strict=True))
    row |= {"names": names, "error": [free[name] for name in names]}
    order = on_true_axes(names, error.permutation)
    return row | {kind: told_by(estimate, kind)[order].tolist() for kind in KINDS}


def told_by(estimate, kind: str):
    """Return the covariance (N, N) of an estimate, user: that of `information`."""
    if kind == "user":
        return estimate.information.covariance()
    if kind == "exact":
        return estimate.information.of_hessian().covariance()
    return observed_information(estimate, kind).covariance()


def on_true_axes(names, permutation):
    """Return the index of a covariance (N, N) that puts sizes on the true axes.

    permutation (3,): of CuboidError; what is no size stays in its place.
    """
    sides = dict(zip(FREE[:3], np.array(FREE[:3])[permutation], strict=True))
    order = [names.index(sides.get(name, name)) for name in names]
    return np.ix_(order, order)


def main() -> None:
    parser = study_parser(__doc__, folder=False)
    parser.add_argument("files", nargs="+", help="recordings that hold their truth")
    parser.add_argument("--count", type=int, default=400, help="re-measurements each")
    parser.add_argument("--actions", type=int, default=6)
    parser.add_argument("--folder", type=Path, default=Path("benchmark/monte_carlo"))
    arguments = parser.parse_args()
    cases = [
        (file, arguments.actions, number, NOISE)
        for number in range(arguments.count)
        for file in arguments.files
    ]
    about = {"actions": arguments.actions, "noise": NOISE}
    with executor_of(arguments) as executor:
        run_study(
            arguments.folder / FILE, "monte carlo", measure, cases, executor, about
        )
    report(arguments.folder)


if __name__ == "__main__":
    main()
