"""Run the paper's own algorithm: Adam on shape and poses, cone programmes inside.

python examples/benchmarks/paper_descent.py [recording.npz] [--actions 2] [--epochs 300]

L_v(theta, x) = min over lam in FC of eq:vimp as printed (the page `paper`).  The inner
programmes of all time steps are independent: they are solved together, theta and x held
fixed.  By the envelope theorem the gradient of L_v is that of the loss at these lam.

The script compares that gradient with finite differences of L_v, and the impulses with
those of the joint programme at its own optimum.  Then it prints the descent beside
IPOPT on the joint programme from the same start: loss L_v, surface error, CPU seconds.
"""

import argparse
import csv
import time
from pathlib import Path

import numpy as np
from compare_formulations import started
from trimesh.creation import box
from trimesh.transformations import rotation_matrix, translation_matrix

from formulations import paper
from formulations.shape import CUBOID
from tactilenlp import (
    Measurements,
    Problem,
    Scene,
    SolverOptions,
    example_recording,
    surface_distance,
)
from tactilenlp.data.sensor_noise import precision_of
from tactilenlp.geometry.transforms import rotation_of
from tactilenlp.nlp.ipopt import make_solver, solve, solve_levels
from tactilenlp.problem.reductions import Reductions, reduce

RATE = 0.2  # [scales of the unknowns] of Adam at first; it falls as 1 / sqrt(epoch)
MEMORY = (0.9, 0.999)  # of gradient and square, as usual


class Descent:
    """The loss L_v of theta and x, and its gradient, in scales of the unknowns."""

    def __init__(self, problem):
        self.problem, self.data = problem, problem.data()
        options = SolverOptions(tolerance=1e-8, barrier=1e-3, iterations=200)
        self.solver = make_solver(problem, options)
        self.outer = np.concatenate(
            [np.r_[problem.variables[n].span] for n in ("theta", "x")]
        )
        self.lam, self.inner = {}, 0

    def scaled(self, values):
        """Return theta and x of values by name as one vector, in scales."""
        return (self.problem.pack(values) / self.problem.scale)[self.outer]

    def look(self, z):
        """Return loss, gradient (n,) and all unknowns at z (n,)."""
        problem = self.problem
        x = problem.pack(self.lam)
        x[self.outer] = z * problem.scale[self.outer]
        x = np.clip(x, problem.bounds("lower"), problem.bounds("upper"))
        s = solve(problem, start=problem.unpack(x), fixed=("theta", "x"), throw=False,
                  solver=self.solver)  # fmt: skip
        self.inner += s.iterations
        self.lam = {n: s.values[n] for n in ("finger", "ground")}
        x = problem.pack(s.values)
        slopes = (problem.jacobian(n, x, self.data).sum(axis=0) for n in problem.costs)
        slope = np.asarray(sum(slopes)).ravel() * problem.scale
        return s.objective, slope[self.outer], x


def descend(descent, z, epochs):
    """Return the best point of Adam and what was found every epoch."""
    first, second, best, history = 0.0, 0.0, (np.inf, z), []
    for k in range(1, epochs + 1):
        loss, slope, _ = descent.look(z)
        best = min(best, (loss, z), key=lambda pair: pair[0])
        history.append(loss)
        first = MEMORY[0] * first + (1 - MEMORY[0]) * slope
        second = MEMORY[1] * second + (1 - MEMORY[1]) * slope**2
        way = first / (1 - MEMORY[0] ** k)
        size = np.sqrt(second / (1 - MEMORY[1] ** k)) + 1e-8
        z = z - RATE / np.sqrt(k) * way / size
    return best[1], history


def envelope(descent, z, rng, count=12) -> float:
    """Return the largest error of the gradient along random unknowns, relative."""
    slope, h = descent.look(z)[1], 1e-4
    errors = []
    for i in rng.choice(len(z), count, replace=False):
        e = h * np.eye(len(z))[i]
        by_hand = (descent.look(z + e)[0] - descent.look(z - e)[0]) / (2 * h)
        errors.append(abs(by_hand - slope[i]))
    return max(errors) / np.abs(slope).max()


def lying(sizes, x):
    """Return the box of these sizes at the planar pose x."""
    pose = translation_matrix([*x[:2], sizes[2] / 2]) @ rotation_matrix(x[2], [0, 0, 1])
    return box(sizes, pose)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = example_recording()
    parser.add_argument("file", nargs="?", type=Path, default=default)
    parser.add_argument("--actions", type=int, default=2)
    parser.add_argument("--epochs", type=int, default=300)
    parser.add_argument("--start", default="near", choices=["near", "far", "paper"])
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    args = parser.parse_args()
    truth, data = np.load(args.file), Measurements.load(args.file)
    scene, data = Scene.load(args.file), data.select(range(args.actions))
    turn = rotation_of(truth["object_quaternion"])
    yaw = np.unwrap(turn.as_euler("zyx")[:, 0])
    x = np.vstack([truth["object_position"][:, :2].T, yaw])[:, : data.samples]
    theta, start = started(args.start, truth, x, seed=0)
    known = data, scene, CUBOID, precision_of(data, scene)
    window, problem = reduce(*known, Reductions(), guess=(theta, start)), Problem()
    paper.build(problem, window, scene, CUBOID)
    given = {"theta": theta, "x": start[:, window.last]}

    began = time.process_time()
    joint = solve_levels(problem, paper.LEVELS, given)
    found = {"IPOPT, joint": (joint.values, time.process_time() - began)}
    descent = Descent(problem)
    z = descent.scaled(joint.values)
    inner = problem.unpack(descent.look(z)[2])
    size = problem.variables["finger"].scale[0]
    off = np.abs(inner["finger"] - joint.values["finger"]).max() / size
    print(f"finger impulses, inner and joint: {off:.2g} weights apart at most")
    # Four corners share what the ground carries in many ways: compare their sums.
    sums = [
        [np.bincount(window.corner.step, row) for row in values["ground"]]
        for values in (inner, joint.values)
    ]
    off = np.abs(np.subtract(*sums)).max() / size
    print(f"ground impulses, inner and joint: {off:.2g} weights apart at most")
    z = descent.scaled(given)
    error = envelope(descent, z, np.random.default_rng(0))
    print(f"gradient by the envelope theorem: {error:.1e} of its largest off")

    descent.inner, began = 0, time.process_time()
    z, _ = descend(descent, z, args.epochs)
    seconds, count = time.process_time() - began, descent.inner
    found[f"Adam, {args.epochs} epochs"] = (problem.unpack(descent.look(z)[2]), seconds)
    print(f"joint: {joint.iterations} iterations; inner programmes: {count} in all")
    out = []
    for name, (values, cpu) in found.items():
        nats = descent.look(descent.scaled(values))[0]
        sizes, end = values["theta"][:, 0], values["x"][:, window.pose[-1]]
        mm = (
            1e3
            * surface_distance(
                lying(sizes, end), lying(truth["side_lengths"], x[:, -1])
            ).mean
        )
        print(f"{name}: {nats:.2f} nats, {mm:.2f} mm, {cpu:.2f} CPU s")
        out.append({"method": name, "nats": nats, "mm": mm, "cpu_s": cpu})
    args.out.mkdir(parents=True, exist_ok=True)
    with open(args.out / "paper_descent.csv", "w", newline="") as stream:
        writer = csv.DictWriter(stream, out[0])
        writer.writeheader()
        writer.writerows(out)


if __name__ == "__main__":
    main()
