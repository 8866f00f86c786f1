"""What is known of a polytope: its axes, sigma, parts of the information, planes."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import octahedron
from scipy.spatial.transform import Rotation

from tactilenlp import face_sigma, solve_estimate, vertex_information
from tactilenlp.information.information import LEAST_DEVIATION
from tactilenlp.information.laplace_approximation import of_other_hulls
from tactilenlp.information.tangent_space import slope_of_centroid


@pytest.fixture(scope="module")
def slid():
    return octahedron(4)


@pytest.fixture(scope="module")
def hull(slid):
    data, scene, _ = slid
    return solve_estimate(data, scene, shape="polytope")


def test_the_axes_are_those_of_the_world_at_the_last_sample(hull):
    information = hull.information
    assert hull.quaternion[-1] == pytest.approx([1, 0, 0, 0], abs=1e-9)
    sigma = information.sigma("position")
    assert information.path[-1, :3] == pytest.approx(sigma, rel=0.05)


@pytest.mark.parametrize("angles", [(0, 90), (50, 200)])
def test_sigma_turns_with_the_recording(slid, angles):
    """Rounding decides between two optima, 0.1 nats apart, at angles of either pair."""
    data, scene, _ = slid
    turns = [Rotation.from_euler("z", a, degrees=True).as_matrix() for a in angles]
    both = []
    for turn in turns:
        turned = data.transformed(turn, np.zeros(3))
        information = solve_estimate(turned, scene, shape="polytope").information
        J = information.maps["position"]
        both.append(J @ information.covariance_matrix @ J.T)
    turn = turns[1] @ turns[0].T
    assert both[1] == pytest.approx(turn @ both[0] @ turn.T, rel=0.05, abs=1e-9)


def test_other_hulls_add_what_their_evidence_makes_probable():
    """Of a cube, and one that is 2 mm lower, e times less probable; by hand."""
    cube = np.array([*product((-0.02, 0.02), (-0.02, 0.02), (0.0, 0.04))])
    J = slope_of_centroid(cube)

    def solved(vertices, cost):
        values = {"theta": vertices.T, "x": np.zeros((3, 1))}
        return SimpleNamespace(
            solution=SimpleNamespace(values=values), cost=cost, occam=3.0,
            linearised=SimpleNamespace(R_wg=np.eye(3)),
            tangent=SimpleNamespace(maps={"position": J}),
        )  # fmt: skip

    best, lower = solved(cube, 5.0), solved(cube * [1, 1, 0.95], 6.0)
    top = np.repeat(cube[:, 2] > 0, 3)
    C = np.diag(np.where(top, 1e-6, 1e-12))  # the bottom is known
    assert not of_other_hulls(best, (), C).any()
    assert not of_other_hulls(best, [solved(cube, 5.5)], C).any()  # the same body
    added = of_other_hulls(best, [lower, lower], C)
    share = np.exp(-1) / (1 + np.exp(-1))
    expected = np.diag([0.0, 0.0, share * 0.001**2])
    assert J @ added @ J.T == pytest.approx(expected, abs=1e-12)
    assert added[top].any()
    assert np.abs(added[~top]).max() < 1e-4 * np.abs(added).max()


def test_parts_of_the_information_add_up_where_no_bound_holds_a_vertex(hull):
    """No part has what a bound holds: it is known far better than by all parts."""
    information = hull.information
    total, C = sum(information.parts.values()), np.linalg.inv(information.matrix)
    sigma = np.sqrt(np.diag(C))
    gap = (C @ (information.matrix - total) @ C) / np.outer(sigma, sigma)
    held = sigma < 2 * LEAST_DEVIATION
    assert held.any()
    assert not held.all()
    assert np.abs(gap[~held][:, ~held]).max() < 1e-2
    assert (np.diag(total)[held] < np.diag(information.matrix)[held] / 2).all()


def test_touched_faces_are_better_known_than_others(hull):
    sigma, touched = face_sigma(hull), hull.faces > 0
    assert touched.any()
    assert np.median(sigma[touched]) < np.median(sigma[~touched])
    assert vertex_information(hull).shape == (len(hull.vertices),)
    assert np.isfinite(vertex_information(hull)).all()
    assert "faces touched" in hull.summary()


def test_the_body_lies_behind_its_supporting_planes(slid, hull):
    planes, truth = hull.supporting_planes(), slid[2].vertices
    here = hull.mesh().vertices
    assert (here @ planes.normal.T - planes.offset).max() < 1e-6
    assert (planes.sigma >= face_sigma(hull) - 1e-9).all()  # a corner and the middle
    off = np.abs((truth @ planes.normal.T).max(axis=0) - planes.offset)
    assert np.mean(off < 3 * planes.sigma + 1e-4) > 0.9
