"""Fingertips that are taken as rigid and may be soft: what sigma says of it."""

from dataclasses import replace

import numpy as np
import pytest
from programmes import moved_by

from formulations.indentation import COMPLIANCE_SIGMA, PUSH, told
from formulations.names import NORMAL_SCALE, PRESSES, SOFT_FINGERTIPS
from tactilenlp import solve_estimate
from tactilenlp.information.consider_parameters import Prior, by_derivatives
from tactilenlp.information.linearisation import Linearisation
from tactilenlp.nlp.kkt import kkt_system_of

STEP = 1e-5  # [m] under one weight


def test_the_error_by_compliance_is_how_the_optimum_moves_with_deeper_touches(
    programme,
):
    kkt = kkt_system_of(programme.problem, programme.solution)
    at = Linearisation(kkt, programme.job, programme.window)
    soft, chosen = at.consider_parameters[SOFT_FINGERTIPS], programme.tangent.chosen
    told = -kkt.sensitivity(chosen)[0].T @ soft.slope[:, 0]
    assert (at.presses >= programme.job.scene.friction_ground).all()
    touch = programme.window.touch
    assert (at.presses >= PUSH * touch.normal[:, 2]).all()

    def deeper(step):
        touch = programme.window.touch
        thinner = replace(touch, radius=touch.radius - step * at.presses)
        return replace(programme.window, touch=thinner)

    moved = moved_by(programme, deeper, STEP)
    assert told == pytest.approx(moved, abs=0.05 * np.abs(moved).max())


def test_deeper_touches_leave_the_noise_of_normals_as_it_is(programme):
    job, window, touch = programme.job, programme.window, programme.window.touch
    window = replace(window, sigma_edge=0.05)
    thinner = replace(window, touch=replace(touch, radius=touch.radius / 2))
    here, there = (job.build(w).parameters[NORMAL_SCALE] for w in (window, thinner))
    assert there.value == here.value > 0.05


def test_no_motion_tells_how_hard_two_fingers_squeeze_a_body(programme):
    kkt = kkt_system_of(programme.problem, programme.solution)
    touch = programme.window.touch
    second = np.flatnonzero(touch.sample[1:] == touch.sample[:-1]) + 1
    assert len(second)
    normal = touch.normal.copy()
    normal[second] = -normal[second - 1]  # the fingers face each other
    facing = replace(programme.window, touch=replace(touch, normal=normal))
    presses = Linearisation(kkt, programme.job, facing).presses
    assert (presses[[*second, *(second - 1)]] >= 0.999 * PUSH).all()


def test_sides_are_as_uncertain_as_fingertips_unless_these_are_told_to_be_rigid(
    estimate, recorded
):
    data, scene, _ = recorded
    mean, sigma, probability = estimate.information.considered[SOFT_FINGERTIPS]
    assert 0 <= mean < 2 * sigma
    assert sigma < 0.1 * COMPLIANCE_SIGMA  # pushes of different strength tell it
    assert 0 < probability < 0.6
    part = estimate.information.error_budget("side_lengths")[SOFT_FINGERTIPS]
    assert (part < 0.1 * COMPLIANCE_SIGMA).all()
    assert part.max() > 0
    told = replace(scene, compliance=0.0)
    rigid = solve_estimate(data, told, start=estimate)
    assert SOFT_FINGERTIPS not in rigid.information.considered
    assert SOFT_FINGERTIPS not in rigid.information.error_budget("side_lengths")


def test_no_motion_tells_how_hard_soft_fingertips_press_on_a_top(recorded):
    data, scene, _ = recorded
    data = data.select([0])  # a touch of the top
    assert (data.normal[data.contact][:, 2] > 0.9).any()
    soft = replace(scene, compliance=1e-4)  # [m/N]
    information = solve_estimate(data, soft).information
    mean, sigma, probability = information.considered[PRESSES]
    assert probability == 1
    assert abs(mean) < 0.1 * sigma
    assert sigma == pytest.approx(PUSH, rel=0.01)  # it is as open as its prior
    assert SOFT_FINGERTIPS not in information.considered
    *sides, height = information.error_budget("side_lengths")[PRESSES]
    assert height == pytest.approx(told(soft) * PUSH, rel=0.05)
    assert (np.array(sides) < 0.1 * height).all()


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
