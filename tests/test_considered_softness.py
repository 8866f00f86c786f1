"""Fingertips that are taken as rigid and may be soft: what sigma says of it."""

from dataclasses import replace

import numpy as np
import pytest
from programmes import moved_by

from formulations.names import SOFT_FINGERTIPS
from tactilenlp import solve_estimate
from tactilenlp.information.consider_parameters import (
    SOFT_DEPTH,
    Prior,
    by_derivatives,
)
from tactilenlp.information.linearisation import Linearisation
from tactilenlp.nlp.kkt import kkt_system_of

STEP = 1e-5  # [m]


def test_the_error_by_a_depth_is_how_the_optimum_moves_with_thinner_fingers(programme):
    kkt = kkt_system_of(programme.problem, programme.solution)
    at = Linearisation(kkt, programme.job, programme.window)
    depth, chosen = at.consider_parameters[SOFT_FINGERTIPS], programme.tangent.chosen
    told = -kkt.sensitivity(chosen)[0].T @ depth.slope[:, 0]

    def deeper(step):
        touch = programme.window.touch
        thinner = replace(touch, radius=touch.radius - step)
        return replace(programme.window, touch=thinner)

    moved = moved_by(programme, deeper, STEP)
    assert told == pytest.approx(moved, abs=0.05 * np.abs(moved).max())


def test_sides_are_as_uncertain_as_fingertips_unless_these_are_told_to_be_rigid(
    estimate, recorded
):
    data, scene, _ = recorded
    mean, sigma, probability = estimate.information.considered[SOFT_FINGERTIPS]
    assert 0 <= mean < 2 * sigma
    assert sigma < SOFT_DEPTH  # touches tell some of it
    assert 0 < probability < 0.6
    part = estimate.information.error_budget("side_lengths")[SOFT_FINGERTIPS]
    assert (part < 2 * SOFT_DEPTH).all()
    assert part.max() > 0
    told = replace(scene, compliance=0.0)
    rigid = solve_estimate(data, told, start=estimate)
    assert SOFT_FINGERTIPS not in rigid.information.considered
    assert SOFT_FINGERTIPS not in rigid.information.error_budget("side_lengths")


def test_touches_tell_nothing_of_what_their_cost_does_not_bend_upwards_by(programme):
    kkt = kkt_system_of(programme.problem, programme.solution)
    slope, prior = np.zeros((programme.problem.size, 1)), Prior(0.02)
    by_touches = by_derivatives(
        kkt, slope, np.array([300.0]), np.array([[-5.0]]), prior
    )
    assert by_touches.gain == 0
    assert by_touches.considered.sigma == pytest.approx(0.02)
    told = by_derivatives(kkt, slope, np.array([300.0]), np.array([[5e4]]), prior)
    assert told.mean == pytest.approx(300 / (5e4 + 2500))
