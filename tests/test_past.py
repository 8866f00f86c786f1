"""What was known goes into the next action as a Gaussian, and comes out as one."""

from dataclasses import replace
from time import monotonic

import numpy as np
import pytest

from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import Estimate
from tactilenlp.extend import before, pasts_of
from tactilenlp.hypothesis import Hypothesis, Job
from tactilenlp.local import WIDE, continued, settled
from tactilenlp.nlp import Problem
from tactilenlp.past import summarise
from tactilenlp.precision import precision_of, smoothed
from tactilenlp.reduce import Reductions


@pytest.fixture(scope="module")
def job(recorded):
    """The four recorded actions, as the search sees them."""
    data, scene, _ = recorded
    data = data.select(range(4))
    precision = precision_of(data, scene)
    late = monotonic() + 600
    data = smoothed(data, precision)
    return Job(data, scene, CUBOID, precision, Reductions(), late)


def test_the_past_is_as_certain_as_the_exact_reduced_hessian_says(job, estimate):
    # curvature of the barrier here, active constraints there: equal to solver tolerance
    [(past, by_page)] = pasts_of(before(job), estimate.hypotheses[:1], page)
    assert by_page
    rows = np.r_[past.rows("theta"), past.rows("x")]
    mine = np.sqrt(np.diag(past.covariance)[rows])
    exact = np.sqrt(np.diag(np.linalg.inv(estimate.information.matrix)))
    assert np.allclose(mine, exact, rtol=0.1)
    assert np.allclose(past.mean[past.rows("theta")], estimate.theta)


def test_an_equality_between_poses_carries_their_uncertainty_on():
    problem = Problem()
    theta = problem.variable("theta", 1, guess=0.0, unit="m", scale=1e-3)
    x = problem.variable("x", 1, 2, guess=0.0, unit="m", scale=1e-3)
    sigma = 2e-3  # [m] of the size and of the first pose; the second is their sum

    def known(a):
        return (a / sigma) ** 2 / 2

    problem.minimize("size", known, theta, role="prior")
    problem.minimize("first pose", known, x[:, [0]], role="prior")
    problem.subject_to(
        "moves by its size", lambda t, a, b: b - a - t, theta, x[:, [0]], x[:, [1]],
        lower=0, upper=0,
    )  # fmt: skip
    at = Hypothesis(np.zeros(1), np.zeros((1, 2)), 0.0, ())
    at = replace(at, multipliers={"moves by its size": np.zeros((1, 1))})
    past = summarise(problem, np.arange(2), at, {}, problem.data())
    # what holds the equality gives by HELD: a part in 1e7 of these variances
    assert np.allclose(
        past.covariance, sigma**2 * np.array([[1, 1], [1, 2]]), rtol=1e-4
    )
    assert past.names == ("theta", "x")


def test_all_actions_together_confirm_what_the_last_one_found_alone(job, estimate):
    kept = [*estimate.hypotheses]
    pasts = [past for past, _ in pasts_of(before(job), kept, page)]
    found = continued(job, page, kept, pasts, width=4)
    first = settled(job, page, found[:1], width=4)[0]
    assert abs(first.objective - found[0].objective) < WIDE
    assert np.allclose(first.theta, found[0].theta, atol=2e-3)  # [m]
    assert first.x.shape == found[0].x.shape == (3, job.data.samples)


def test_an_estimate_from_a_file_starts_the_next_action_as_warm(
    job, estimate, tmp_path
):
    estimate.save(tmp_path / "estimate.npz")
    again = Estimate.load(tmp_path / "estimate.npz")
    pair = [pasts_of(before(job), e.hypotheses[:1], page)[0] for e in (estimate, again)]
    assert all(by_page for _, by_page in pair)
    assert np.array_equal(pair[0][0].covariance, pair[1][0].covariance)
