"""Describe fingertips: geometry, poses, equivalent spheres, what wrong samples cost."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from formulations import sensing
from formulations.finger import SPHERE, Finger, capsule
from formulations.names import NORMAL_SCALE, TOUCH_SCALE, TOUCH_TERM

from ..geometry.transforms import rotation_of

END_COSINE = 0.1  # [-] cosine between capsule and normal from which on its end touches
OUTLIER_COST = 7.0  # [nats] one sample in a thousand is wrong, unless a scene tells
UNEXPLAINED = 0.8  # [outlier costs] a touched sample that costs more
ANYWHERE = 0.1  # [m] within which a wrong touch may be: the way of a finger
LEAST_FLIP_RATE = 1e-6  # [-] of a sensor that is said never to be wrong


def finger_of(scene) -> Finger:
    """Return the geometry of the fingertips of a scene."""
    return capsule(scene.finger_length / 2) if scene.finger_length > 0 else SPHERE


def yields(scene, reductions) -> bool:
    """Tell whether fingertips are soft: known to be, or not taken as rigid."""
    if scene.compliance is None:
        return not reductions.rigid
    return scene.compliance > 0


def finger_poses(data, scene) -> np.ndarray:
    """Return where the fingers are as their geometry takes it, (T, F, numbers)."""
    if scene.finger_length == 0:
        return data.finger_position
    return np.concatenate([data.finger_position, data.finger_orientation], axis=2)


def moved(p_wf, way) -> np.ndarray:
    """Return places p_wf (n, numbers) of fingers, moved by ways (n, 3) or (3,) [m]."""
    return np.c_[p_wf[:, :3] + way, p_wf[:, 3:]]


def as_spheres(data, scene):
    """Return the data as spherical fingertips would measure them, for initial guesses.

    Where a capsule touches, the sphere is at that end of it which points against the
    normal, or in its middle where it lies along the surface; else in its middle.
    """
    if scene.finger_length == 0:
        return data
    turn = rotation_of(data.finger_orientation.reshape(-1, 4))
    axis = turn.apply([0, 0, 1.0]).reshape(data.normal.shape)
    along = (axis * data.normal).sum(axis=2, keepdims=True)
    u = -np.clip(along / END_COSINE, -1, 1)
    p = data.finger_position + u * scene.finger_length / 2 * axis
    return replace(data, finger_position=p, finger_orientation=None)


def outlier_cost(scene) -> float:
    """Return what it costs [nats] that a sample is wrong beyond any noise."""
    if scene.flip_rate is None:
        return OUTLIER_COST
    return -float(np.log(max(scene.flip_rate, LEAST_FLIP_RATE)))


def unexplained(problem, window, x, data) -> np.ndarray:
    """Tell which touched samples (touches,) unknowns x do not explain.

    By the cost of each on the page, in units of its bound: this is the one definition.
    """
    cost = problem.value(TOUCH_TERM, x, data)[:, 0]
    return cost > UNEXPLAINED * window.outlier_cost


def touch_scales(problem, data) -> tuple[float, float] | None:
    """Return the deviations of a touch on a page: gap [m], normal [rad]; None: no such.

    data: the values of its parameters.
    """
    names = TOUCH_SCALE, NORMAL_SCALE
    if not all(name in problem.parameters for name in names):
        return None
    return tuple(float(data[problem.parameters[name].span][0]) for name in names)


def density_of_wrong_touches(problem, solution, window) -> float:
    """Return how much less probable [nats] wrong touches are than the objective says.

    Their cost is bounded by the odds of a wrong sample (formulations/sensing.py).  To
    compare optima its density counts as well: any gap within ANYWHERE, any normal.  So
    the bound is higher, and what a touch costs without one follows from its cost.
    """
    x, data = solution.at(problem)
    scales = touch_scales(problem, data)
    if scales is None or TOUCH_TERM not in problem.costs:
        return 0.0
    bound, (sigma, sigma_n) = window.outlier_cost, scales
    cost = ca.DM(problem.value(TOUCH_TERM, x, data))
    right = np.sqrt(2 * np.pi) * sigma / ANYWHERE * sigma_n**2 / 2
    alone = sensing.without_bound(cost, bound)
    return float(ca.sum1(sensing.mixture(alone, bound - np.log(right)) - cost))
