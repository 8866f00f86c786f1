"""What is known of a polytope before an action: planes stay planes, place may slip."""

import numpy as np
import pytest

from formulations.between_actions import GAP
from formulations.polytope_quasi_static import LEG
from tactilenlp.exploration.polytope_beliefs import (
    FLATNESS_SIGMA,
    LIFT,
    after_retraction,
    ball_prior,
    flatness_information,
    unseen_corners,
)

ANGLES = np.linspace(0, 2 * np.pi, 6, endpoint=False)
TOP = np.c_[np.cos(ANGLES), np.sin(ANGLES), np.ones(6)] * 0.02  # [m] a hexagon
BODY = np.vstack([TOP, TOP * (1, 1, -1)])
TOP_TOUCHED = np.array([[0.0, 0.0, 0.02]]), np.array([[0.0, 0.0, 1.0]])
UNTOUCHED = np.zeros((0, 3)), np.zeros((0, 3))
HIGH = 1.0  # [m] of the centroid: no vertex is on the ground


def lifted(heights, rows=slice(6)):
    """Return displacements (36,) [m] that lift some vertices."""
    d = np.zeros((12, 3))
    d[rows, 2] = heights
    return d.ravel()


def cost(information, d):
    """Return the cost [nats] of displacements of the vertices."""
    return float(d @ information @ d) / 2


def test_a_touched_face_may_move_and_turn_but_not_bend():
    known = flatness_information(BODY, HIGH, TOP_TOUCHED)
    for rigid in (lifted(1e-3), lifted(0.1 * TOP[:, 0]), np.tile([1e-3, 0, 0], 12)):
        assert cost(known, rigid) == pytest.approx(0.0, abs=1e-6)
    bent = lifted(FLATNESS_SIGMA * (-1.0) ** np.arange(6))
    assert cost(known, bent) == pytest.approx(6 / 2)  # one deviation at each vertex


def test_vertices_that_stand_on_the_ground_stay_on_it():
    known = flatness_information(BODY, 0.02, UNTOUCHED)
    assert cost(known, lifted(LEG, slice(6, 12))) == pytest.approx(6 / 2)
    assert cost(known, lifted(LEG)) == 0.0


def test_a_retraction_loses_information_about_place_and_yaw_alone():
    known = ball_prior(BODY, (0.03, 0.01)) + 1e8 * np.eye(36)
    lost = np.linalg.inv(after_retraction(known, BODY)) - np.linalg.inv(known)
    assert np.linalg.matrix_rank(lost, tol=1e-12) == 3
    for axis, variance in ((0, GAP**2), (1, GAP**2), (2, 0.0)):
        mean = np.tile(np.eye(3)[axis], 12) / 12
        assert mean @ lost @ mean == pytest.approx(variance, rel=1e-6, abs=1e-15)


def test_a_corner_may_be_behind_a_face_that_nothing_felt():
    """A cube without one corner: every side was felt, the face that cuts it was not."""
    cube = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * 0.04
    cut, sides = cube[1:], np.vstack([np.eye(3), -np.eye(3)[:2]])
    felt = 0.02 * sides + 0.002 * np.roll(np.abs(sides), 1, axis=1), sides
    (corner,) = unseen_corners(cut, felt, (10, 8, 6))
    outward = -np.ones(3) / np.sqrt(3)
    np.testing.assert_allclose(
        corner, cube[[1, 2, 4]].mean(axis=0) + LIFT * outward, atol=1e-12
    )
    assert not len(unseen_corners(cube, felt, (10, 8, 6)))  # the ground needs no touch
    assert not len(unseen_corners(cut, felt, ()))  # its number of vertices is told
    assert len(unseen_corners(cut, UNTOUCHED, (12, 6))) == 5  # the largest faces first
