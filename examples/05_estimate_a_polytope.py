"""Estimate a body of unknown class as the convex hull of vertices.

    python examples/05_estimate_a_polytope.py [recording.npz [picture.png]]

The defaults are the shipped "polytope", nine actions of two fingers, and polytope.png.
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
from trimesh.convex import convex_hull
from trimesh.transformations import quaternion_matrix, transform_points

from tactilenlp import (
    Measurements,
    Scene,
    example_recording,
    plot_estimate,
    solve_estimate,
    surface_distance,
    vertex_information,
)

LIMIT = 1.5  # [mm] largest error accepted, clean recording
matplotlib.use("Agg")  # write to a file, without a screen
recording = Path(sys.argv[1] if sys.argv[1:] else example_recording("polytope"))
picture = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("polytope.png")
data, scene = Measurements.load(recording), Scene.load(recording)
print(f"{recording.name}: {data}", flush=True)

# Six actions, then three more.
early = solve_estimate(data.select(range(6)), scene, shape="polytope")
estimate = solve_estimate(data, scene, shape="polytope", start=early)
print(estimate.summary())

# Sigma of every face's plane, touched or not, and the best known vertex.
planes = estimate.supporting_planes()
touched, sigma = planes.touches > 0, 1e3 * planes.sigma
known, others = np.median(sigma[touched]), np.median(sigma[~touched])
print(f"Touched faces are known to {known:.2f} mm, the others to {others:.2f} mm.")
best = int(np.argmax(vertex_information(estimate)))
print(f"The best known vertex is at {np.round(1e3 * estimate.vertices[best], 1)} mm.")

# The file also contains the truth, which the estimator does not read.
with np.load(recording) as file:
    truth = {key: file[f"object_{key}"] for key in ("position", "quaternion")}
    truth["vertices"] = file["vertices"]  # (V, 3) [m], body frame
plot_estimate(estimate, truth).savefig(picture, dpi=110)
print(f"The picture is in {picture}.")

pose = quaternion_matrix(truth["quaternion"][-1])
pose[:3, 3] = truth["position"][-1]
true = convex_hull(transform_points(truth["vertices"], pose))
distance = surface_distance(true, estimate.mesh())
mean, largest = 1e3 * distance.a_to_b, 1e3 * distance.maximum
if mean > LIMIT:
    sys.exit(f"The true surface is {mean:.2f} mm off on average: more than {LIMIT} mm.")
print(f"The true surface is {mean:.2f} mm off on average and {largest:.2f} mm at most.")
