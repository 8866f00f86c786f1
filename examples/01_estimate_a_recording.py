"""Estimate the shape and motion of a box from a recording of two fingers.

    python examples/01_estimate_a_recording.py [recording.npz [picture.png]]

The defaults are the shipped recording, and estimate.png in the current folder.  A
recording of your own contains no truth: omit everything below `summary`, and call
plot_estimate(estimate).
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp import (
    Measurements,
    Scene,
    example_recording,
    plot_estimate,
    solve_estimate,
    surface_distance,
)

LIMIT = 1.0  # [mm] largest error accepted, clean recording

matplotlib.use("Agg")  # write to a file, without a screen
default = example_recording()
recording = Path(sys.argv[1]) if len(sys.argv) > 1 else default
picture = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("estimate.png")

# The measurements, sample by sample, and what is known: mass and frictions.
data = Measurements.load(recording)
scene = Scene.load(recording)
print(f"{recording.name}: {data}", flush=True)

# Shape, poses and contact impulses that explain the measurements best.
estimate = solve_estimate(data, scene)
print(estimate.summary())

# The file also contains the truth, which the estimator does not read.
with np.load(recording) as file:
    truth = {
        "position": file["object_position"],  # (T, 3) [m]
        "quaternion": file["object_quaternion"],  # (T, 4) wxyz
        "side_lengths": file["side_lengths"],  # (3,) [m]
    }
plot_estimate(estimate, truth).savefig(picture, dpi=110)
print(f"The picture is in {picture}.")

# Distance between the two surfaces at the last sample, in mm.
place = translation_matrix(truth["position"][-1])
turn = quaternion_matrix(truth["quaternion"][-1])
distance = surface_distance(estimate.mesh(), box(truth["side_lengths"], place @ turn))
mean, largest = 1e3 * distance.mean, 1e3 * distance.maximum
if mean > LIMIT:
    sys.exit(f"The surface is {mean:.2f} mm off on average: more than {LIMIT} mm.")
print(f"The surface is {mean:.2f} mm off on average and {largest:.2f} mm at most.")
