"""A place that nothing saw is uncertain, but no farther than a body can be."""

from dataclasses import replace

import numpy as np
import pytest

from tactilenlp import solve_estimate
from tactilenlp.information.error_budget_terms import (
    ANY_ROTATION,
    REACHED,
    bounded_pose,
    positive_semidefinite,
)


def test_a_pose_that_nothing_saw_is_no_farther_than_a_body_can_be():
    lost = np.diag([4e-4, 4e-4, 1e-9, 60.0, 4.0, 1e5])
    lost[3, 4] = lost[4, 3] = 16.0  # rounding: no positive matrix
    C = bounded_pose(lost, 3)
    assert np.linalg.eigvalsh(C).min() > 0
    np.testing.assert_allclose(np.sqrt(np.diag(C)[3:5]), REACHED, rtol=0.03)
    assert np.sqrt(C[5, 5]) == pytest.approx(ANY_ROTATION, rel=1e-3)
    known = np.diag([1e-8, 1e-8, 1e-9, 1e-7, 1e-7, 1e-4])
    np.testing.assert_allclose(bounded_pose(known, 3), known, rtol=1e-4, atol=1e-16)


def test_a_pose_of_any_covariance_is_bounded():
    lost = np.diag([4e-4, 4e-4, 1e-9, 0.0, 0.0, 0.0])
    way = np.array([1.0, 2.0, 3.0])
    lost[3:, 3:] = 1e40 * np.outer(way, way)  # adding the prior to it changes no digit
    C = bounded_pose(lost, 3)
    assert np.isfinite(C).all()
    most = [REACHED, REACHED, ANY_ROTATION]
    assert (np.sqrt(np.diag(C)[3:]) <= np.array(most) * (1 + 1e-9)).all()


def test_what_curves_down_is_held_by_nothing():
    np.testing.assert_allclose(
        positive_semidefinite(-np.diag([2.0, -3.0])), np.diag([0.0, 3.0])
    )


@pytest.mark.slow
def test_after_a_touch_from_above_the_ground_place_is_unobserved_but_bounded(recorded):
    data, scene, _ = recorded
    rigid = replace(scene, compliance=0.0)
    found = solve_estimate(data.select([0]), rigid).information
    assert any("position" in words for words in found.unobserved)
    assert (found.sigma("position")[:2] > 0.05).all()  # beyond half of any side
    assert (found.sigma("position")[:2] < 1.05 * REACHED).all()
    assert found.sigma("position")[2] < 1e-4
    untold = solve_estimate(data.select([0]), scene).information
    # One push does not tell how deep fingertips sit: a third of a millimetre or so.
    assert 1e-4 < untold.sigma("position")[2] < 1e-3
