"""Estimate one recording by shooting and by eq:vimp, and compare the two losses.

    python examples/06_shooting_or_violation_implicit.py [picture.png]

Shooting simulates each action from its first pose; eq:vimp has all poses as unknowns.
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from tactilenlp import (
    Measurements,
    Options,
    Scene,
    example_recording,
    problem_of,
    solve,
    solve_estimate,
)

LEAN = Options(hypotheses=1, starts=4)
picture = sys.argv[1] if sys.argv[1:] else "shooting.png"
recording = example_recording()
data, scene = Measurements.load(recording), Scene.load(recording)
truth = np.load(recording)["side_lengths"]  # [m], which the estimator does not read
offsets = np.linspace(-8e-3, 8e-3, 49)  # [m] of side y
axes = (figure := Figure((7, 4), layout="constrained")).subplots()
told = []
for name in ("shooting", "violation_implicit"):
    print(f"{name} ...", flush=True)
    estimate = solve_estimate(data, scene, formulation=name, options=LEAN)
    unseen = "; ".join(estimate.information.unobserved) or "nothing"
    print(f"  {np.round(1e3 * estimate.side_lengths, 2)} mm; not observed: {unseen}")
    # Build the same problem again; change side y, and keep the other unknowns.
    problem, known, losses = problem_of(data, scene, name), estimate.unknowns, []
    for offset in offsets:
        start = known | {"theta": known["theta"] + offset * np.eye(3)[:, [1]]}
        if name == "shooting":  # the poses are functions of the first ones
            losses.append(problem.objective(start))
        else:  # the impulses of least violation
            least = solve(problem, start=start, fixed=("theta", "x"), throw=False)
            losses.append(least.objective)
    loss = np.array(losses) - min(losses)
    low = np.flatnonzero((loss[1:-1] < loss[:-2]) & (loss[1:-1] < loss[2:])) + 1
    (line,) = axes.plot(1e3 * offsets, loss, label=f"{name}, minima: {len(low)}")
    axes.plot(1e3 * offsets[low], loss[low], "o", color=line.get_color())
    off = 1e3 * np.abs(truth - estimate.side_lengths[1]).min()
    told.append(f"{len(low)} by {name} ({off:.2f} mm off)")
    if off > 1.0:  # [mm]
        sys.exit(f"Side y is {off:.2f} mm off: more than 1 mm.")
axes.set(xlabel="change of side y [mm]", ylabel="loss above its minimum [nats]",
         title=f"six actions; not observed: {unseen}")  # fmt: skip
axes.legend()
figure.savefig(picture)
print(f"The picture is in {picture}.")
print(f"Local minima along side y: {' and '.join(told)}.")
