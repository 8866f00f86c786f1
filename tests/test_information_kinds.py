"""Kinds of information, to compare: each is what its definition says."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from formulations.level import Level
from formulations.names import FINGER_OFFSET
from formulations.shape import CUBOID
from tactilenlp import (
    Noise,
    assumption_sensitivity,
    extend,
    information_gain,
    observed_information,
    solve_estimate,
)
from tactilenlp.data.noise_model import add_noise
from tactilenlp.errors import OptionError
from tactilenlp.estimation.observed_information import INFORMATION_KINDS, programme_at
from tactilenlp.information.comparisons import paper, quaternion_jacobian
from tactilenlp.interface.result import solution_of
from tactilenlp.output.summary import optima_in_words

UNITS = np.r_[1e3, 1e3, 1e3, 1e3, 1e3, 50.0]  # to mm, a radian as 50 mm
STEP = 1e-6  # [m, rad] of central differences


@pytest.mark.parametrize("kind", INFORMATION_KINDS[:-1])
def test_every_kind_of_information_is_positive_and_has_the_same_names(estimate, kind):
    information = observed_information(estimate, kind)
    assert information.names == estimate.information.names
    assert np.linalg.eigvalsh(information.covariance()).min() > 0
    assert np.abs(np.diag(information.correlation()) - 1).max() < 1e-12


@pytest.mark.parametrize("kind", INFORMATION_KINDS[1:4])
def test_sigma_of_another_kind_is_that_of_its_matrix_alone(estimate, kind):
    information = observed_information(estimate, kind)
    covariance = np.linalg.inv(information.matrix)
    for name, jacobian in information.maps.items():
        sigma = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
        np.testing.assert_allclose(information.sigma(name), sigma, rtol=1e-6)
    assert not optima_in_words(information)
    with pytest.raises(OptionError, match="no such term"):
        information.part("prior")


def test_inverted_dynamics_lose_all_digits_where_the_joint_programme_does_not(estimate):
    inverted = observed_information(estimate, "inverse_dynamics").matrix
    numbers = [
        np.linalg.cond(M / np.outer(UNITS, UNITS))
        for M in (inverted, estimate.information.matrix)
    ]
    assert numbers[0] > 1e12
    assert numbers[1] < 1e8


def test_sensor_noise_alone_scatters_less_than_users_are_told(estimate):
    noise = observed_information(estimate, "sandwich").covariance()
    told = estimate.information.covariance_matrix
    assert np.linalg.eigvalsh((told - noise) * np.outer(UNITS, UNITS)).min() > -1e-9


def test_the_papers_link_of_a_pose_with_itself_is_the_identity(programme):
    x = programme.solution.values["x"][:, -1]
    half = quaternion_jacobian(programme.window.motion, x)
    assert np.linalg.pinv(half) @ half == pytest.approx(np.eye(len(half)))


def test_the_papers_information_is_eq_obsinfo_summed_by_hand(programme):
    """Slopes by differences; a past turn counts by half angles: cos over cos."""
    problem, window, shape = programme.problem, programme.window, programme.job.shape
    theta, x = (programme.solution.values[name] for name in ("theta", "x"))
    alpha, sigma = (
        float(problem.parameters[name].value[0]) for name in ("alpha", "normal scale")
    )
    z, p, rho = (
        ca.SX.sym("z", 6),
        ca.SX.sym("p", window.touch.p_wf.shape[1]),
        ca.SX.sym("r"),
    )
    at = shape, z[:3], window.motion.pose(shape, z[:3], z[3:]), p, rho
    out = ca.vertcat(window.finger.gap(*at), window.finger.normal(*at))
    felt = ca.Function("felt", [z, p, rho], [out])
    M = np.zeros((6, 6))
    for samples, touched in ((window.touch, True), (window.free, False)):
        rows = zip(samples.pose, samples.p_wf, samples.radius, strict=True)
        for index, p_wf, radius in rows:
            here = np.r_[theta[:, 0], x[:, index]]
            ends = [
                felt(here[:, None] + side * STEP * np.eye(6), p_wf, radius).full()
                for side in (1, -1)
            ]
            J = (ends[0] - ends[1]) / (2 * STEP)
            J[:, 5] *= np.cos(x[2, -1] / 2) / np.cos(x[2, index] / 2)
            chance = 1 / (1 + np.exp(alpha * float(felt(here, p_wf, radius)[0])))
            M += alpha**2 * chance * (1 - chance) * np.outer(J[0], J[0])
            M += touched * J[1:].T @ J[1:] / sigma**2
    found = paper(problem, programme.solution, window)
    # differences of the smoothed corners are good to a hundredth of a per cent
    assert (
        np.abs((found - M) / np.outer(UNITS, UNITS)).max()
        < 1e-4 * np.abs(M / np.outer(UNITS, UNITS)).max()
    )


def test_a_solution_has_the_parameters_of_the_last_level_of_its_page(estimate):
    page = SimpleNamespace(LEVELS=(Level("only", {"motion weight": 100.0}),))
    assert solution_of(estimate, page).parameters == {"motion weight": 100.0}


@pytest.mark.slow
def test_classes_and_pages_of_ones_own_are_given_again(recorded):
    data, scene, _ = recorded
    mine = replace(CUBOID, name="mine")
    page = extend("quasi_static", without="size prior")
    given = {"shape": mine, "formulation": page}
    found = solve_estimate(data.select([0, 1]), scene, **given)
    told = observed_information(found, "sandwich", **given)
    assert told.names == found.information.names
    assert (told.sigma("side_lengths") > 0).all()
    assert (
        assumption_sensitivity(found, **given)
        .of("side_lengths", "sigma_position")
        .any()
    )
    with pytest.raises(OptionError, match="not that of the estimate"):
        observed_information(found, "sandwich", shape="cuboid", formulation=page)


def test_no_more_unknowns_count_than_there_are():
    known, told = np.eye(2), np.eye(2)
    assert information_gain(known, told, 2) == information_gain(known, told)
    with pytest.raises(OptionError, match="of the 2 unknowns"):
        information_gain(known, told, 3)


@pytest.mark.slow
def test_the_papers_information_is_of_fingers_where_they_are_estimated(recorded):
    """Fingers told 4 mm off: as exact ones without offsets, but for their prior."""
    data, scene, _ = recorded
    data = data.select([0, 1, 2, 3])
    off = np.array([[[4e-3, -2e-3, 0.0], [-3e-3, 3e-3, 1e-3]]])
    told = replace(data, finger_position=data.finger_position + off)
    estimate = solve_estimate(told, replace(scene, sigma_offset=3e-3), throw=False)
    at = programme_at(estimate)
    e_f = at.solution.values[FINGER_OFFSET].T

    def displaced(rows, p_wf):
        return p_wf + e_f[rows.finger]

    found = paper(at.problem, at.solution, at.window)
    none = {k: v for k, v in at.solution.values.items() if k != FINGER_OFFSET}
    moved = replace(at.solution, values=none), at.window.with_fingers(displaced)
    assert found == pytest.approx(paper(at.problem, *moved), rel=1e-9)
    assert found != pytest.approx(paper(at.problem, moved[0], at.window), rel=0.05)


@pytest.mark.slow
def test_sigma_does_not_depend_on_where_the_origin_of_the_world_is(recorded):
    data, scene, _ = recorded
    data = add_noise(data.select([0, 1]), Noise(position=5e-4, normal=0.03, seed=1))
    told = replace(scene, sigma_position=None, sigma_normal=None)
    near, far = (
        solve_estimate(data.transformed(np.eye(3), np.array(t)), told, throw=False)
        for t in ([0.0, 0, 0], [9000.0, 9000.0, 0])
    )
    assert far.objective == pytest.approx(near.objective, abs=1e-3)
    sigmas = np.array([e.information.sigma("side_lengths") for e in (near, far)])
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.02)
    paths = np.array([e.sigma_position for e in (near, far)])
    assert paths[1] == pytest.approx(paths[0], rel=0.02)
