"""Plot the losses of shooting and violation-implicit along one unknown each.

python examples/benchmarks/landscape.py [recording.npz]
    [--executor processes|dask|mpi|none]

Left, the paper's example: a step y = H(x - theta) fitted to points by squared error,
and by the distance of the points to its graph.  Right, a recording: the loss along one
side of the box and along its first position, all other unknowns at the truth.

  shooting             likelihood of the measurements on the trajectory that is
                       simulated from the first pose.  A later action begins where the
                       one before ended, moved by the true displacement.  At 30 and
                       300 Hz, smoothed by s.
  violation-implicit   the same likelihood on the true trajectory (moved as a whole
                       along the position) plus the violation, least over all impulses.

The script prints, and writes to landscape.csv, the slopes (5 % and 95 % quantiles and
the largest, in nats / mm) and the number of local minima on the grid that are 0.1 nats
deep on both sides.  Both losses are bounded: a sample costs at most 7 nats.
"""

from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from judging import planar_path
from sliding_path import path
from study import executor_of, mapped, study_parser, table, write_csv

from formulations import multiple_shooting, violation_implicit
from formulations.finger import SPHERE
from formulations.shape import CUBOID
from formulations.time_stepping import Sliding
from tactilenlp import Measurements, Problem, Scene, example_recording
from tactilenlp.data.sensor_noise import precision_of
from tactilenlp.geometry.transforms import planar_matrix
from tactilenlp.nlp.codegen import compiled
from tactilenlp.problem.reductions import (
    Reductions,
    required_reductions,
    window_of_samples,
)
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import Solvers, solve

SHOOTING = {  # name: times 30 Hz, still [m/s]
    "shooting 30 Hz, s = 100 mm/s": (1, 100e-3),
    "shooting 30 Hz, s = 20 mm/s": (1, 20e-3),
    "shooting 30 Hz, s = 2 mm/s": (1, 2e-3),
    "shooting 300 Hz, s = 2 mm/s": (10, 2e-3),
}
VIMP = "violation-implicit"
ALONG = ("size", "position")
WAY = 10e-3  # [m] to either side
FELT = ("touch", "free")  # what a simulation can be compared with
RISE = 0.1  # [nats] between two local minima


class Recording:
    """Data of some actions, the true path, and both losses."""

    def __init__(self, file, actions):
        truth, data = np.load(file), Measurements.load(file)
        self.data = data.select(actions)
        self.scene, self.theta = Scene.load(file), truth["side_lengths"]
        x = planar_path(truth["object_position"], truth["object_quaternion"])
        self.x = x[:, np.isin(data.action, actions)]
        self.body = Sliding(CUBOID, SPHERE, self.scene.mass, self.scene.gravity)
        self.precision = precision_of(self.data, self.scene)
        self.paths, self.lam = {}, {}
        self.rolled, _ = self.problem(multiple_shooting)
        self.vimp, self.window = self.problem(violation_implicit)
        self.solver = Solvers(self.vimp).solver_for(SolverOptions(tolerance=1e-5))

    def problem(self, page):
        made = required_reductions(page, Reductions(still=False, far=False))
        known = self.data, self.scene, CUBOID, self.precision, made
        window = window_of_samples(*known, guess=(self.theta, self.x))
        problem = Problem()
        page.build(problem, window, self.scene, CUBOID)
        return problem, window

    def shooting(self, theta, x_0, times, still) -> float:
        """Return the cost of what is felt along the simulated path."""
        x, end, x_1 = [], None, None
        for action in np.unique(self.data.action):
            rows = np.nonzero(self.data.action == action)[0]
            start = x_0 if end is None else end + self.x[:, rows[0]] - x_1
            x.append(self.simulated(theta, start, rows, times, still))
            end, x_1 = x[-1][:, -1], self.x[:, rows[-1]]
        problem = self.rolled
        z = problem.pack({"theta": theta, "x": np.hstack(x)})
        return sum(float(problem.value(n, z, problem.data()).sum()) for n in FELT)

    def simulated(self, theta, start, rows, times, still):
        T, scene = len(rows), self.scene
        fingers = self.data.finger_position[rows].reshape(T, -1)
        fine = np.linspace(0, T - 1, times * (T - 1) + 1)
        fingers = np.array([np.interp(fine, range(T), column) for column in fingers.T])
        if (T, times) not in self.paths:
            walk = path(self.body, self.data.fingers, len(fine))
            self.paths[T, times] = compiled([walk])[0]
        known = [self.data.dt / times, scene.friction_finger, scene.friction_ground]
        args = theta, [*known, still], fingers, self.data.finger_radius
        return np.asarray(self.paths[T, times](start, *args))[:, ::times]

    def implicit(self, theta, x) -> float:
        """Return what is felt, and the least violation of physics over all impulses."""
        given = {"theta": theta, "x": x} | self.lam
        s = solve(self.vimp, start=given, fixed=("theta", "x"), throw=False,
                  solver=self.solver)  # fmt: skip
        self.lam = {n: s.values[n] for n in ("finger", "ground")} if s.success else {}
        priors = ("between actions", "size prior", "depth prior")
        return s.objective - sum(s.costs.get(n, 0.0) for n in priors)


def slices(file, actions, axis, way, grid):
    """Return {loss: values on the grid} along side `axis`, or the first position."""
    recording, side = Recording(file, actions), np.eye(3)[axis]
    points = [(g * side, 0 * side) for g in grid]
    if way == "position":
        across = planar_matrix(recording.x[2, 0]) @ side
        points = [(0 * side, g * across) for g in grid]
    theta, x, shooting = recording.theta, recording.x, recording.shooting
    losses = {
        name: [shooting(theta + a, x[:, 0] + b, *how) for a, b in points]
        for name, how in SHOOTING.items()
    }
    losses[VIMP] = [recording.implicit(theta + a, x + b[:, None]) for a, b in points]
    return {name: np.array(values) for name, values in losses.items()}


def minima(values) -> int:
    """Count local minima that rise by RISE on both sides."""
    count, low, high, falling = 0, np.inf, -np.inf, True
    for v in values:
        if falling:
            low = min(low, v)
            if v > low + RISE:
                count, falling, high = count + 1, False, v
        else:
            high = max(high, v)
            if v < high - RISE:
                falling, low = True, v
    return count + falling


def described(losses, grid, **cell):
    rows = []
    for way, curves in losses.items():
        for name, values in curves.items():
            slope = np.abs(np.diff(values)) / (1e3 * np.diff(grid))
            low, high = np.quantile(slope, (0.05, 0.95))
            at = grid[np.argmin(values)]
            rows.append({
                **cell, "along": way, "loss": name, "minima": minima(values),
                "slope_05": low, "slope_95": high, "slope_most": slope.max(),
                "lowest_mm": 1e3 * at, "range_nats": np.ptp(values),
            })  # fmt: skip
    return rows


def heaviside(axes) -> None:
    """Draw the paper's example: a step, fitted by squared error or graph distance."""
    rng = np.random.default_rng(1)
    points = np.sort(rng.uniform(-2, 2, 12))
    seen = (points > 0).astype(float)
    theta = np.linspace(-2, 2, 801)
    squared = ((seen - (points > theta[:, None])) ** 2).sum(axis=1)
    # Nearest point of the graph: right below or above, or on the riser at theta.
    away = np.where(seen == (points > theta[:, None]), 0.0, points - theta[:, None])
    graph = np.minimum(away**2, 1).sum(axis=1)
    axes[0].plot([-2, 0, 0, 2], [0, 0, 1, 1], "k-", lw=1)
    axes[0].plot(points, seen, "o", color="C1")
    axes[0].set(title="the paper's example: a step", xlabel="x", ylabel="y")
    axes[1].plot(theta, squared / squared.max(), color="C3", label="squared error")
    axes[1].plot(theta, graph / graph.max(), color="C0", lw=2.5, label="graph distance")
    axes[1].set(xlabel="where the step is: theta", ylabel="loss (scaled)")
    axes[1].legend(frameon=False)


def draw(found, grid, file) -> None:
    figure, axes = plt.subplots(2, 3, figsize=(13, 7), layout="constrained")
    heaviside(axes[:, 0])
    colors = ["#f4b183", "#ed7d31", "#c00000", "#5b0f00"]
    for i, (na, losses) in enumerate(found.items()):
        for ax, (way, curves) in zip(axes[i, 1:], losses.items(), strict=True):
            for name, values in curves.items():
                scaled = (values - values.min()) / np.ptp(values)
                style = {"color": "C0", "lw": 3} if name == VIMP else {
                    "color": colors[list(SHOOTING).index(name)], "lw": 1.2}  # fmt: skip
                ax.plot(1e3 * grid, scaled, label=name, **style)
            ax.axvline(0, color="gray", lw=0.7, ls=":")
            what = "side" if way == "size" else "first position"
            ax.set(xlabel=f"{what} less truth [mm]", ylabel="loss (scaled)",
                   title=f"{what}, {na} action{'s' * (na > 1)}")  # fmt: skip
    figure.legend(*axes[0, 1].get_legend_handles_labels(), ncols=5, frameon=False,
                  loc="outside lower center")  # fmt: skip
    figure.savefig(file, dpi=72)


def main() -> None:
    parser = study_parser(__doc__, folder=False, executor="none")
    default = example_recording()
    parser.add_argument("file", nargs="?", type=Path, default=default)
    parser.add_argument("--one", type=int, default=1, help="the action looked at alone")
    parser.add_argument("--side", type=int, default=1, help="0, 1, 2: x, y, z")
    parser.add_argument("--points", type=int, default=121)
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    args = parser.parse_args()
    grid, rows = np.linspace(-WAY, WAY, args.points), []
    every = np.unique(Measurements.load(args.file).action).tolist()
    cases = list(product(([args.one], every), ALONG))
    asked = [(args.file, some, args.side, way, grid) for some, way in cases]
    found = {1: {}, len(every): {}}
    with executor_of(args) as executor:
        losses = mapped(executor, slices, asked)
        for (some, way), curves in zip(cases, losses, strict=True):
            found[len(some)][way] = curves
    for na, curves in found.items():
        rows += described(curves, grid, recording=args.file.stem, actions=na)
    print(table(rows))
    write_csv(args.out / "landscape.csv", rows)
    draw(found, grid, args.out / "landscape.png")


if __name__ == "__main__":
    main()
