"""Programmes that a page makes of data, what is true of them, and what it costs."""

from dataclasses import replace

import numpy as np
from conftest import RECORDINGS
from scipy.spatial.transform import Rotation
from trimesh.convex import convex_hull
from trimesh.transformations import quaternion_matrix, transform_points

from formulations.rigid_body import FREE
from formulations.shape import CUBOID
from tactilenlp.data.measurements import Measurements
from tactilenlp.data.scene import Scene
from tactilenlp.data.sensor_noise import Precision
from tactilenlp.geometry.simplification import more_vertices
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.reductions import (
    Reductions,
    required_reductions,
    window_of_samples,
)
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import solve

OCTAHEDRON = RECORDINGS / "polytope.npz"
SENSORS = Precision(position=0.0, normal=0.0)


def programme(page, data, scene, choice=None, finger=None):
    """Return the problem and the window that a page makes of data."""
    choice = required_reductions(page, choice or Reductions())
    window = window_of_samples(data, scene, CUBOID, SENSORS, choice)
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


def octahedron(actions):
    """Return the first actions of the octahedron, its scene, its surface at the end."""
    data = Measurements.load(OCTAHEDRON).select(range(actions))
    with np.load(OCTAHEDRON) as file:
        last = data.samples - 1
        pose = quaternion_matrix(file["object_quaternion"][last])
        pose[:3, 3] = file["object_position"][last]
        surface = convex_hull(transform_points(file["vertices"], pose))
    return data, Scene.load(OCTAHEDRON), surface


def slid_octahedron():
    """Return two actions of the octahedron, its vertices and planar poses as true.

    The body's axes are the world's at the last sample, its origin on the ground.
    """
    data, scene, _ = octahedron(2)
    with np.load(OCTAHEDRON) as file:
        last = data.samples - 1
        p, q = file["object_position"][: last + 1], file["object_quaternion"]
        R = Rotation.from_quat(np.roll(q[: last + 1], -1, axis=1))
        vertices = R[-1].apply(file["vertices"])
    vertices[:, 2] -= vertices[:, 2].min()
    yaw = (R * R[-1].inv()).as_rotvec()[:, 2]
    x = np.vstack([p[:, :2].T, yaw - yaw[-1]])
    return data, scene, more_vertices(vertices, 8), x


def moved_by(programme, changed, step):
    """Return how the optimum moves with a change, by differences, (chosen unknowns,).

    changed: function of the size of the change, which returns a window.
    """
    ends, options = [], SolverOptions(tolerance=1e-9, ipopt={"mu_init": 1e-9})
    for size in (step, -step):
        problem = programme.job.build(changed(size))
        found = solve(problem, options, start=programme.solution.values)
        assert found.success
        ends.append(problem.pack(found.values)[programme.tangent.chosen])
    return (ends[0] - ends[1]) / (2 * step)


def sums(problem, values):
    """Return the sum of each cost, and of the squares of each constraint's rows."""
    x, data = problem.pack(values), problem.data()
    power = {name: 1 if name in problem.costs else 2 for name in problem.terms}
    return {n: (problem.value(n, x, data) ** p).sum() for n, p in power.items()}
