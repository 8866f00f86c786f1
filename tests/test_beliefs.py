"""What is believed before an action: hypotheses, as well known as sigma says."""

import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from believed import BOX, SPACE, VAGUELY, actions, informed, known

from tactilenlp import ExpectedInformation, Workspace, information_gain
from tactilenlp.exploration.beliefs import made_definite, widened_to_sigma
from tactilenlp.information.mixture import Modes


def test_hypotheses_are_averaged_by_their_objectives(estimate):
    best = estimate.hypotheses[0]
    twin = replace(best, x=best.x + np.array([[4e-3], [0], [0]]))
    rivals = [replace(best, objective=0.0), replace(twin, objective=1.0)]
    two = replace(estimate, objective=0.0, hypotheses=tuple(rivals))
    expected = ExpectedInformation(two, SPACE)
    weights = [b.weight for b in expected.beliefs]
    assert weights == pytest.approx(np.array([1, np.exp(-1)]) / (1 + np.exp(-1)))
    action = actions(1)[0]
    ahead = [expected.prospect(action, i) for i in range(len(weights))]
    each = [
        one.chance_to_slide * information_gain(b.information, one.information)
        for b, one in zip(expected.beliefs, ahead, strict=True)
    ]
    assert expected.gain(action) == pytest.approx(np.dot(weights, each))
    alone = ExpectedInformation(two, SPACE, hypotheses=1)
    assert [b.weight for b in alone.beliefs] == [1.0]


def test_a_pose_that_curves_down_a_little_is_anywhere_and_sizes_stay_as_known():
    matrix = BOX.information.matrix.copy()
    matrix[5, 5] = -0.01  # of the turn; a pose anywhere has 1 / 9
    information = informed(matrix, np.diag(np.array(VAGUELY) ** 2))
    expected = ExpectedInformation(known(**vars(BOX) | {"information": information}))
    C = np.linalg.inv(expected.beliefs[0].information)
    assert np.sqrt(np.diag(C))[:3] == pytest.approx(VAGUELY[:3], rel=1e-9)
    assert C[5, 5] == pytest.approx(1 / (1 / 9 - 0.01), rel=1e-2)


def test_a_size_is_believed_to_be_as_doubtful_as_its_sigma_says():
    """The right face was never touched; a kink makes it look sharp to a Hessian."""
    sharp = np.array([0.4e-3, 0.1e-3, 0.1e-3, 0.2e-3, 0.1e-3, 2e-3])
    way = np.array([1, 0, 0, 0.5, 0, 0])  # the left face stays where it is
    spread = np.diag(sharp**2) + 6e-3**2 * np.outer(way, way)
    matrix = np.diag(1 / sharp**2)

    def gains(information):
        body = known(**vars(BOX) | {"information": information})
        expected = ExpectedInformation(body, Workspace(fingers=1))
        right, left = (expected.workspace.action([a, 0.1]) for a in (0.3, 0.3 - np.pi))
        C = np.linalg.inv(expected.beliefs[0].information)
        return np.sqrt(np.diag(C)), expected.gain(right), expected.gain(left)

    (exact, *_), (honest, right, left) = map(
        gains, (informed(matrix), informed(matrix, spread))
    )
    assert honest[0] == pytest.approx(6e-3, rel=0.02)
    assert exact[0] < 0.5e-3
    # what sigma does not doubt is as before
    assert honest[[1, 2, 4, 5]] == pytest.approx(exact[[1, 2, 4, 5]], rel=1e-3)
    assert right > left + 1
    # a sigma below the Hessian's deviation makes nothing surer
    surer, *_ = gains(informed(matrix, np.diag(sharp**2) / 4))
    assert surer == pytest.approx(exact, rel=1e-6)


def test_other_optima_are_no_doubt_about_the_best_one_however_badly_it_fits():
    """They are hypotheses themselves; a bad fit widens each of them."""
    sharp = np.array([0.4e-3, 0.1e-3, 0.1e-3, 0.2e-3, 0.1e-3, 2e-3])
    information = informed(np.diag(1 / sharp**2))
    away = np.zeros((2, 6))
    away[1, 0] = 5e-3
    modes = Modes(np.array([0.5, 0.5]), away, np.array([np.diag(sharp**2)] * 2),
                  np.zeros(2))  # fmt: skip
    for widening in (1.0, 2.0):
        vars(information).update(
            modes=modes, covariance_matrix=widening**2 * modes.covariance
        )
        fit = SimpleNamespace(widening=widening)
        body = known(**vars(BOX) | {"information": information, "fit": fit})
        believed = widened_to_sigma(np.diag(1 / sharp**2), body)
        deviations = np.sqrt(np.diag(np.linalg.inv(believed)))
        np.testing.assert_allclose(deviations, widening * sharp, rtol=1e-6)


@pytest.mark.slow
def test_a_body_that_may_tilt_gains_the_same_whichever_way_its_turn_is_counted():
    """Half a turn relabels the body, and a rotation vector has another chart there."""
    sigma = np.array([5e-3, 4e-3, 3e-3, 2e-3, 2e-3, 1e-3, 0.05, 0.1, 0.1])
    sides = np.array([0.05, 0.04, 0.03])

    def gain(yaw, action):
        x = np.array([0.01, -0.02, sides[2] / 2, 0.0, 0.0, yaw])
        given = {"unknowns": {"x": x[:, None]}, "theta": sides}
        given |= {"information": informed(np.diag(1 / sigma**2))}
        return ExpectedInformation(known(**vars(BOX) | given), SPACE).gain(action)

    for action in actions(3):
        once = gain(0.3, action)
        for yaw in (0.3 + np.pi, 0.3 - np.pi):
            assert gain(yaw, action) == pytest.approx(once, abs=0.02)


def test_an_indefinite_information_is_said_and_replaced_by_the_samples(
    estimate, caplog
):
    matrix = estimate.information.matrix.copy()
    matrix[0, 0] *= -1
    information = replace(estimate.information, matrix=matrix)
    with caplog.at_level(logging.WARNING, "tactilenlp"):
        expected = ExpectedInformation(replace(estimate, information=information))
    assert "indefinite" in caplog.text
    assert np.linalg.eigvalsh(expected.beliefs[0].information).min() > 0
    # the same samples as the exact one, so of its size: sigma within a factor of 5
    exact = ExpectedInformation(estimate).beliefs[0].information
    ratio = np.sqrt(np.diag(expected.beliefs[0].information) / np.diag(exact))
    assert (ratio > 0.2).all()


def test_a_covariance_with_a_kink_is_made_definite_and_any_other_is_unchanged():
    """A stiff direction across several unknowns: its variance is below rounding."""
    turns, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 9)))
    variances = np.geomspace(1e-8, 1e-3, 9)
    definite = (turns * variances) @ turns.T
    assert made_definite(definite) is definite
    variances[0] = -1e-17
    C = (turns * variances) @ turns.T
    made = made_definite(C)
    np.linalg.cholesky(made)  # raises where it is not definite
    assert np.diag(made) == pytest.approx(np.diag(C), rel=1e-6)
