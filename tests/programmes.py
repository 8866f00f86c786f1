"""Programmes that a page makes of data, what is true of them, and what it costs."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from formulations.rigid_body import FREE
from formulations.shape import CUBOID
from tactilenlp.data.sensor_noise import Precision
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.reductions import Reductions, reduce, required_reductions

SENSORS = Precision(position=0.0, normal=0.0)


def programme(page, data, scene, choice=None, finger=None):
    """Return the problem and the window that a page makes of data."""
    choice = required_reductions(page, choice or Reductions())
    window = reduce(data, scene, CUBOID, SENSORS, choice)
    if finger is not None:
        window = replace(window, **finger(window))
    problem = Problem()
    page.build(problem, window, scene, CUBOID)
    return problem, window


def true_values(problem, window, truth, rng=None):
    """Return theta and poses as they were; impulses at random if `rng` is given."""
    position = truth["object_position"][window.last]
    R = Rotation.from_quat(np.roll(truth["object_quaternion"], -1, axis=1))[window.last]
    x = np.vstack([position.T[:2], R.as_euler("xyz").T[2:]])
    if window.motion is FREE:
        x = np.vstack([position.T, R.as_rotvec().T])
    values = {"theta": truth["side_lengths"], "x": x}
    for name in ("finger", "ground"):
        if rng is not None and name in problem.variables:
            v = problem.variables[name]
            force = v.scale[:, None] * np.abs(rng.normal(size=v.columns))
            # inside the cone: on its boundary the slope of dissipation grows beyond
            # what differences can tell
            share = 0.1 * rng.normal(size=(2, v.columns))
            values[name] = np.vstack([force[:1], share * force[:1]])
    return values


def sums(problem, values):
    """Return the sum of each cost, and of the squares of each constraint's rows."""
    x, data = problem.pack(values), problem.data()
    power = {name: 1 if name in problem.costs else 2 for name in problem.terms}
    return {n: (problem.value(n, x, data) ** p).sum() for n, p in power.items()}
