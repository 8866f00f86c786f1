"""Local optima are weighed by their evidence, and what they leave open is said."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.stats import norm

from formulations import sensing
from formulations.names import NORMAL_SCALE, TOUCH_SCALE, TOUCH_TERM
from formulations.shape import CUBOID
from tactilenlp import Options, solve_estimate
from tactilenlp.information.mixture import (
    LocalOptimum,
    distinct_modes,
    laplace_mixture,
)
from tactilenlp.output.summary import optima_in_words
from tactilenlp.problem.fingertips import ANYWHERE, density_of_wrong_touches


def mode(sizes, yaw, objective=0.0, deviation=1e-4):
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    z = np.r_[sizes, 0.0, 0.0, yaw]
    C = np.diag(np.r_[np.full(5, deviation), deviation / 0.02]) ** 2
    return LocalOptimum(z, R, objective, C)


def test_two_bodies_that_are_equally_likely_are_half_their_distance_wide():
    found = [mode([0.05, 0.03, 0.04], 0.0), mode([0.05, 0.04, 0.04], 0.0)]
    modes = laplace_mixture(CUBOID, found)
    assert modes.weights == pytest.approx([0.5, 0.5])
    assert np.sqrt(modes.covariance[1, 1]) == pytest.approx(0.01 / np.sqrt(2), rel=1e-3)
    assert np.sqrt(modes.covariance[0, 0]) == pytest.approx(1e-4)


def test_a_mode_two_nats_worse_weighs_less_and_a_vaguer_one_more():
    worse = laplace_mixture(CUBOID, [mode([0.05, 0.03, 0.04], 0.0),
                                 mode([0.05, 0.04, 0.04], 0.0, 2.0)])  # fmt: skip
    assert worse.weights[1] / worse.weights[0] == pytest.approx(np.exp(-2))
    vague = laplace_mixture(CUBOID, [mode([0.05, 0.03, 0.04], 0.0),
                                 mode([0.05, 0.04, 0.04], 0.0, 0.0, 2e-4)])  # fmt: skip
    assert vague.weights[1] / vague.weights[0] == pytest.approx(2**6, rel=1e-4)


def test_a_pose_that_no_touch_tells_makes_a_mode_no_likelier():
    """Its position may be metres or kilometres off, by rounding: both are "open"."""
    found = [mode([0.05, 0.03, 0.04], 0.0), mode([0.05, 0.04, 0.04], 0.0)]
    for one, deviation in zip(found, (1.0, 1e3), strict=True):
        one.covariance[3, 3] = deviation**2
    assert laplace_mixture(CUBOID, found).weights == pytest.approx(0.5, rel=1e-2)


def test_a_quarter_turn_that_swaps_two_sides_is_the_same_body():
    found = [mode([0.05, 0.03, 0.04], 0.1), mode([0.03, 0.05, 0.04], 0.1 + np.pi / 2)]
    assert len(distinct_modes(CUBOID, found)) == 1


def test_a_mode_of_which_a_direction_is_certain_has_a_weight():
    """A covariance that is singular to the last digit has a volume all the same."""
    flat = np.diag([1e-8, 1e-8, 1e-8, 100.0, 100.0, 0.0])
    found = [LocalOptimum(np.full(6, 0.05), np.eye(3), 1.0, flat)]
    modes = laplace_mixture(CUBOID, found)
    assert modes.weights == pytest.approx([1.0])
    assert np.isfinite(modes.covariance).all()


def test_another_body_that_explains_the_data_is_spoken_of(estimate):
    found = [mode([0.05, 0.03, 0.04], 0.0), mode([0.05, 0.04, 0.04], 0.0, 1.0)]
    modes = laplace_mixture(CUBOID, found)
    information = replace(
        estimate.information, modes=modes, covariance_matrix=modes.covariance
    )
    reported, other = optima_in_words(information)
    assert reported == "What is reported has a probability of 73 %."
    assert other.startswith("With 27 %, side y is 10.0 mm larger")


def test_optima_are_compared_with_the_same_cost_of_wrong_touches(recorded):
    """The one that is reported has the density of its wrong touches, as all others."""
    data, scene, _ = recorded
    data, far = data.select([1]), [8, 9]  # a single sample would not be used
    contact, normal = data.contact.copy(), data.normal.copy()
    contact[far, 0], normal[far, 0] = True, [0.0, 0.6, 0.8]
    options = Options(check_mistakes=False)
    wrong = replace(data, contact=contact, normal=normal)
    estimate = solve_estimate(wrong, scene, options=options)
    density = estimate.information.modes.objectives[0] - estimate.objective
    assert estimate.costs[TOUCH_TERM] > 14.0
    assert density > 10.0


def test_a_wrong_touch_is_as_unlikely_as_its_density_says():
    """A page bounds what touches cost; the densities of right and wrong ones do not."""
    sigma, sigma_n, bound = 1e-3, 0.1, 7.0
    alone = np.array([[0.1], [5.5], [9.0], [14.0], [500.0]])  # without a bound
    costs = np.array(sensing.mixture(ca.DM(alone), bound))
    parameters = {TOUCH_SCALE: slice(0, 1), NORMAL_SCALE: slice(1, 2)}
    problem = SimpleNamespace(
        parameters={name: SimpleNamespace(span=s) for name, s in parameters.items()},
        costs={TOUCH_TERM: None}, value=lambda *_: costs,
    )  # fmt: skip
    solution = SimpleNamespace(at=lambda _: (None, np.array([sigma, sigma_n])))
    window = SimpleNamespace(outlier_cost=bound)
    right = norm(0, sigma).pdf(0) * norm(0, sigma_n).pdf(0) ** 2
    wrong = np.exp(-bound) / ANYWHERE / (4 * np.pi)
    density = right * np.exp(-alone) + wrong
    expected = -np.log(density / (right + wrong)) - costs
    found = density_of_wrong_touches(problem, solution, window)
    assert found == pytest.approx(expected.sum(), rel=1e-9)
    # One that a body explains as well as not costs what it did, a wrong one far more.
    assert expected[0, 0] < 1e-3 < expected[1, 0] < 0.3
    assert expected[-1, 0] == pytest.approx(np.log(right / wrong) - bound, abs=1e-3)
    for lacks in ({"parameters": {}}, {"costs": {}}):  # a page of another likelihood
        other = SimpleNamespace(**vars(problem) | lacks)
        assert density_of_wrong_touches(other, solution, window) == 0.0
