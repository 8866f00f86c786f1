"""Fingers that push a box in the simulated world, and its geometry."""

from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

SIZES = np.array([0.05, 0.032, 0.04])  # [m]
AWAY = np.array([-0.2, 0.0, 0.1])  # [m] where the second finger waits
OPPOSITE = np.array([0.2, 0.0, 0.1])


def line(*ends, duration=1.0):
    """A minimum-jerk line from ends[f][0] to ends[f][1] for every finger f."""
    time = np.linspace(0, duration, 101)
    s = (time / duration)[:, None]
    s = s**3 * (10 - 15 * s + 6 * s**2)
    columns = [np.add(a, s * np.subtract(b, a)) for a, b in ends]
    return SimpleNamespace(time=time, finger_position=np.stack(columns, axis=1))


def push(y=0.006, reach=0.0, **options):
    """A push from +X to the side of the box, while the second finger waits."""
    return line(([0.1, y, 0.02], [reach, y, 0.02]), (AWAY, AWAY), **options)


def squeeze():
    """Two fingers that would meet inside the box: both reach their 8 N."""
    return line(
        ([0.1, 0.003, 0.02], [0.0, 0.003, 0.02]),
        ([-0.1, -0.002, 0.03], [0.0, -0.002, 0.03]),
    )


def gap_and_normal(sizes, truth):
    """Distance (T, F) and outward normal (T, F, 3) of finger centres, by geometry."""
    R_wo = Rotation.from_quat(np.roll(truth.object_quaternion, -1, axis=1)).as_matrix()
    p_wf = truth.finger_position - truth.object_position[:, None]
    p_of = np.einsum("tji,tfj->tfi", R_wo, p_wf)
    outward = p_of - np.clip(p_of, -sizes / 2, sizes / 2)
    distance = np.linalg.norm(outward, axis=-1, keepdims=True)
    outward = outward / np.maximum(distance, 1e-9)
    return distance[..., 0], np.einsum("tij,tfj->tfi", R_wo, outward)
