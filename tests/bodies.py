"""Bodies whose distances can be worked out by hand."""

import numpy as np
from scipy.spatial.transform import Rotation
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix, translation_matrix

SIDES = np.array([0.03, 0.045, 0.06])
POSITION = np.array([0.1, -0.2, 0.03])
QUATERNION = np.array([0.5, -0.5, 0.1, np.sqrt(0.49)])  # of unit length, wxyz
# 2000 evenly spread points integrate the distance between two boxes to about 0.2 %
# (one sigma over seeds, measured); five of these for a fixed seed.
SAMPLING = 0.01
ROUNDING = 1e-12  # metres and radians, on bodies of centimetres


def cuboid(side_lengths, position=(0, 0, 0), quaternion=(1, 0, 0, 0)):
    return box(
        side_lengths, translation_matrix(position) @ quaternion_matrix(quaternion)
    )


def matrix(quaternion):
    return quaternion_matrix(quaternion)[:3, :3]


def wxyz(rotation):
    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)
