"""Estimate a body of unknown class as the convex hull of twenty vertices.

    python examples/05_estimate_a_polytope.py [recording.npz]

The default is the shipped recording "polytope": nine actions of two fingers.
"""

import sys
from pathlib import Path

import numpy as np
from trimesh.convex import convex_hull
from trimesh.transformations import quaternion_matrix, transform_points

from tactilenlp import (
    Measurements,
    Scene,
    example_recording,
    solve_estimate,
    surface_distance,
    vertex_information,
)

LIMIT = 1.5  # [mm] largest error accepted, clean recording

default = example_recording("polytope")
recording = Path(sys.argv[1]) if len(sys.argv) > 1 else default
data, scene = Measurements.load(recording), Scene.load(recording)

# Six actions, then three more.  formulations.polytope.polytope(30) has 30 vertices.
early = solve_estimate(data.select(range(6)), scene, shape="polytope")
estimate = solve_estimate(data, scene, shape="polytope", start=early)
print(estimate.summary())

# Sigma of every face's plane, touched or not, and the information of each vertex.
planes = estimate.supporting_planes()
touched, sigma = planes.touches > 0, 1e3 * planes.sigma
print(f"Touched faces are known to {np.median(sigma[touched]):.2f} mm (median),")
print(f"the others to {np.median(sigma[~touched]):.2f} mm.")
best = int(np.argmax(vertex_information(estimate)))
print(f"The best known vertex is at {np.round(1e3 * estimate.vertices[best], 1)} mm.")
push = np.linalg.norm(estimate.impulses["finger 0"], axis=1).max()
print(f"Finger 0 pushed with at most {1e3 * push:.1f} mN s in a sample.")

# The file also contains the truth, which the estimator does not read.
with np.load(recording) as file:
    pose = quaternion_matrix(file["object_quaternion"][-1])
    pose[:3, 3] = file["object_position"][-1]
    truth = convex_hull(transform_points(file["vertices"], pose))
distance = surface_distance(truth, estimate.mesh())
mean, largest = 1e3 * distance.a_to_b, 1e3 * distance.maximum
if mean > LIMIT:
    sys.exit(f"The true surface is {mean:.2f} mm off on average: more than {LIMIT} mm.")
print(f"The true surface is {mean:.2f} mm off on average and {largest:.2f} at most.")
