"""Extend the default page by a term: the volume of the box, measured in water.

    python examples/07_add_a_term.py [picture.png]

A term is a function of unknowns and data; its derivatives are made of it.
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from tactilenlp import Measurements, Scene, example_recording, extend, solve_estimate

VOLUME, SIGMA = 36.3, 0.3  # [ml] of displaced water, standard deviation
ML_PER_M3 = 1e6


def volume(nlp, window, scene, shape):
    def cost(sides):
        off = ML_PER_M3 * sides[0] * sides[1] * sides[2] - VOLUME
        return (off / SIGMA) ** 2 / 2

    nlp.minimize("volume", cost, nlp.variables["theta"], role="likelihood")


picture = sys.argv[1] if sys.argv[1:] else "terms.png"
recording = example_recording()
data, scene = Measurements.load(recording).select([0, 1]), Scene.load(recording)
pages = {"default": "violation_implicit"}
pages["with the volume"] = extend(pages["default"], volume)
truth = np.load(recording)["side_lengths"]  # [m], which the estimator does not read
axes = (figure := Figure((6, 4), layout="constrained")).subplots()
for i, (name, page) in enumerate(pages.items()):
    print(f"{name} ...", flush=True)
    found = solve_estimate(data, scene, formulation=page)
    sides, sigma = found.side_lengths, found.information.sigma("side_lengths")
    print(f"  {np.round(1e3 * sides, 2)} ± {np.round(1e3 * sigma, 2)} mm")
    places = np.arange(3) + 0.2 * (i - 0.5)
    axes.errorbar(places, 1e3 * sides, 1e3 * sigma, fmt="o", label=name)
axes.plot(range(3), 1e3 * truth, "k_", markersize=30, label="true")
axes.set_xticks(range(3), ["side x", "side y", "side z"])
axes.set_ylabel("side length ± sigma [mm]")
axes.legend()
figure.savefig(picture)
print(f"The picture is in {picture}.")
off = 1e3 * np.abs(sides - truth).max()
if off > 1.0:  # [mm]
    sys.exit(f"With the volume a side is {off:.2f} mm off: more than 1 mm.")
print(f"The volume costs {found.costs['volume']:.2f} nats.")
print(f"With it, the sides are {off:.2f} mm off at most; no finger touched x.")
