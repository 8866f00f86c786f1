"""Planes of touches: what turns under a finger, where a centre of mass is, updates."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from programmes import octahedron, slid_octahedron

from formulations import polytope_quasi_static
from formulations.polytope import polytope
from formulations.rigid_body import PLANAR
from formulations.touched_planes import OTHER_COST, Touched
from tactilenlp import Options
from tactilenlp.geometry.convex_hull import centre_of_shape
from tactilenlp.interface.request import make_job
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.reductions import Reductions
from tactilenlp.problem.window import Samples
from tactilenlp.search.plane_slam import (
    DOUBTFUL_PATHS,
    HYPOTHESES,
    TURN,
    Faces,
    as_measured,
    best_of,
    poses_of_new_action,
)
from tactilenlp.search.polytope_init import planes_on_body

RADIUS, SPIN = 0.01, 0.02  # [m] of a finger; [rad] a sample, of a body
SAMPLES = np.arange(12)
SIZE = (0.022, 0.008)  # [m]
CUBE = np.stack(np.meshgrid([-0.02, 0.02], [-0.02, 0.02], [0, 0.04]), -1).reshape(-1, 3)


def touches(point, normal):
    """Return a finger that touches at points (T, 3) [m] with normals (T, 3), world."""
    ones = np.ones(len(SAMPLES))
    return Samples(
        sample=SAMPLES, finger=np.zeros(len(SAMPLES), int), pose=SAMPLES,
        p_wf=point + RADIUS * normal, radius=RADIUS * ones, normal=normal,
        late_gap=0 * ones,
    )  # fmt: skip


def turning_path():
    """Return poses (3, T) of a body that turns about its origin."""
    return np.vstack([np.zeros((2, len(SAMPLES))), SPIN * SAMPLES])


def planes_of(turned):
    """Return the planes of a normal along x that turns by `turned` angles (T,)."""
    normal = np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=1)
    window = SimpleNamespace(sigma_normal=0.0)
    return as_measured(window, touches(0.02 * normal, normal), turning_path())


def test_touches_of_a_face_that_turns_are_on_one_plane():
    plane, n, b = planes_of(SPIN * SAMPLES)
    assert not plane.any()
    np.testing.assert_allclose(n, [[1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(b, 0.02, atol=1e-12)


def test_a_constant_normal_on_a_body_that_turns_is_of_as_many_planes_as_touches():
    plane, n, _ = planes_of(0.0 * SAMPLES)
    np.testing.assert_array_equal(plane, SAMPLES)
    np.testing.assert_allclose(np.arctan2(n[:, 1], n[:, 0]), -SPIN * SAMPLES)


@pytest.fixture(scope="module")
def link():
    """The cost of two touches of a body that turned: link(pose, normals, points)."""
    body = Touched(polytope(8), PLANAR, 5.0)
    x, n, c = ca.SX.sym("x", 3, 2), ca.SX.sym("n", 3, 2), ca.SX.sym("c", 3, 2)
    planes, places = [], []
    for k in range(2):
        p, R = PLANAR.pose(body.shape, None, x[:, k])
        planes.append(ca.vertcat(n[:, k], ca.dot(n[:, k], c[:, k])))
        places.append(p + R @ (c[:, k] + RADIUS * n[:, k]))
    a, b = planes
    cost = body.link(x[:, 0], x[:, 1], a, b, places[0], RADIUS, places[1])
    function = ca.Function("link", [x, n, c], [cost])
    return lambda *arguments: float(function(*map(ca.DM, arguments)))


@pytest.mark.parametrize(
    ("turn", "way", "cost"),
    [
        (0.0, 5e-3, 0.0),  # it slides along a face
        (0.3, 0.0, 0.0),  # the body turns about an edge
        (0.0, 0.0, 0.0),
        (0.3, 5e-3, OTHER_COST + np.log1p(np.exp(-OTHER_COST))),
    ],
)
def test_successive_touches_are_of_a_face_or_of_a_point(link, turn, way, cost):
    poses = [[0.01, 0.02], [0.03, 0.03], [0.1, 0.4]]
    normals = [[1, np.cos(turn)], [0, np.sin(turn)], [0, 0]]
    points = [[0.02, 0.02], [0, way], [0.01, 0.01]]
    assert link(poses, normals, points) == pytest.approx(cost, abs=1e-6)


def test_the_centroid_of_a_closed_body_is_certain_and_an_open_side_is_not():
    sides = np.vstack([np.eye(3), -np.eye(3)])
    b = np.r_[0.02, 0.02, 0.04, 0.02, 0.02, 0.0]
    planes = np.c_[sides, b]
    mean, P = centre_of_shape(planes, CUBE, SIZE, ground=True)
    np.testing.assert_allclose(mean, 0.0, atol=1e-9)
    np.testing.assert_allclose(P, 0.0, atol=1e-12)
    seen = CUBE[CUBE[:, 0] < 0]  # its side towards +x was not touched
    mean, P = centre_of_shape(planes[1:], seen, SIZE, ground=True)
    assert P[0, 0] > 2 * P[1, 1]
    assert mean[1] == pytest.approx(0.0, abs=1e-3)
    assert -0.02 < mean[0] < SIZE[0]


@pytest.mark.slow
def test_a_new_action_leaves_the_poses_of_the_past_as_they_are():
    _, _, vertices, x = slid_octahedron()
    data, scene, _ = octahedron(2)
    job = make_job(data, scene, polytope(8), Options(), 0.0, polytope_quasi_static)
    job = replace(job, reductions=Reductions())
    past = int((data.action == data.action[0]).sum())
    known = Hypothesis(vertices.ravel(), x[:, :past], 0.0, ())
    found = poses_of_new_action(job, planes_on_body(job, known))
    np.testing.assert_allclose(found[:, :past], x[:, :past], atol=1e-12)
    off = found[:, past:] - x[:, past:]
    assert np.abs(off[:2]).max() < 3e-3


def test_a_doubtful_trajectory_keeps_more_paths_that_turn_by_less():
    """Of paths of about equal cost, each turned by 0.6 of TURN from the one before."""
    turns, none = 0.6 * TURN * np.arange(8), np.zeros((0, 3))
    fits = [
        Faces(none[:, 0], none, none[:, 0], np.array([[0, 0], [0, 0], [turn, 0]]), turn)
        for turn in turns
    ]

    def kept(drawn):
        job = SimpleNamespace(search=SimpleNamespace(drawn=drawn))
        return [f.x[2, 0] for f in best_of(job, fits)]

    np.testing.assert_allclose(kept(1), turns[::2][:HYPOTHESES])
    np.testing.assert_allclose(kept(DOUBTFUL_PATHS), turns[: 2 * HYPOTHESES])
