"""The fit: expected costs are those of simulated noise; misfits are named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import programme

from formulations import sensing, violation_implicit
from tactilenlp import Options, solve_estimate
from tactilenlp.information.goodness_of_fit import (
    BETWEEN_ACTIONS,
    HALF_SQUARE,
    OF_MOTION,
    Fit,
    Misfit,
    TouchMisfit,
    _carried,
    _largest_motion,
    touch_moments,
)
from tactilenlp.problem.window import Steps

DRAWS = 200_000


@pytest.mark.parametrize(("gap", "normal"), [(1e-3, 0.087), (0.2e-3, 0.02), (0.0, 0.0)])
def test_expected_touch_costs_are_the_mean_of_drawn_noise(recorded, gap, normal):
    data, scene, _ = recorded
    problem, window = programme(violation_implicit, data.select([0]), scene)
    window = replace(window, sigma_position=gap, sigma_normal=normal)
    given = problem.data({
        "touch scale": np.hypot(violation_implicit.TOUCH, gap),
        "normal scale": np.hypot(violation_implicit.NORMAL, normal),
    })  # fmt: skip
    mean, variance = touch_moments(problem, given, window, 1.0)
    k = int(np.argmin(window.touch.latency))  # a finger that stays in contact
    scales = [given[problem.parameters[n].span][0]
              for n in ("touch scale", "normal scale")]  # fmt: skip
    rng = np.random.default_rng(0)
    phi = rng.normal(size=DRAWS) * np.hypot(gap, 0.045 * scales[0])
    off = rng.normal(size=(DRAWS, 2)) * np.hypot(normal, 0.045 * scales[1])
    cost = 4 * (np.sqrt(1 + (phi / (2 * scales[0])) ** 2) - 1)
    cost += (off**2).sum(axis=1) / (2 * scales[1] ** 2)
    bound = window.outlier_cost
    drawn = bound - np.logaddexp(0, bound - cost) + np.logaddexp(0, -bound)
    assert float(sensing.mixture(3.0, bound)) == pytest.approx(
        bound - np.logaddexp(0, bound - 3.0) + np.logaddexp(0, -bound)
    )
    error = 4 * drawn.std() / np.sqrt(DRAWS)  # of the mean of the draws
    assert mean[k] == pytest.approx(drawn.mean(), abs=error + 1e-6)
    assert variance[k] == pytest.approx(drawn.var(), rel=0.05, abs=1e-9)


def test_the_integrals_over_free_samples_are_right():
    s = np.linspace(0, 60, 600_001)
    cost = np.log1p(np.exp(-s))
    step = s[1]
    assert cost.sum() * step == pytest.approx(np.pi**2 / 12, abs=1e-4)
    assert (cost**2).sum() * step == pytest.approx(HALF_SQUARE, abs=1e-4)


def test_the_shipped_recording_fits_well_and_nothing_is_widened(estimate):
    fit = estimate.fit
    assert fit.verdict == "good"
    assert fit.widening == 1.0
    assert fit.actual == pytest.approx(
        sum(estimate.costs[name] for name in ("touch", "free"))
    )
    assert sum(t.misfit.actual for t in fit.touches) == pytest.approx(
        estimate.costs["touch"]
    )
    assert "The fit is good" in estimate.summary()


def test_a_contradiction_is_named_by_finger_and_action(recorded):
    data, scene, _ = recorded
    data = data.select([0, 1])
    told = data.finger_position.copy()
    rows = (data.action == 1)[:, None] & data.contact & data.valid
    finger = int(np.argmax(rows.sum(axis=0)))
    told[data.action == 1, finger] += [0.0, 0.0, 4e-3]  # its kinematics are wrong
    told[data.action == 1, finger] += 3e-3 * data.normal[rows[:, finger], finger][0]
    wrong = replace(data, finger_position=told)
    lean = Options(hypotheses=1, starts=1, rivals=False)
    right, off = (
        solve_estimate(d, scene, options=lean, throw=False) for d in (data, wrong)
    )
    assert right.fit.verdict == "good"
    assert off.fit.actual > right.fit.actual


def test_words_and_verdict_of_a_bad_fit():
    touch = Misfit(41.0, 9.0, 4.0)
    fit = Fit("bad", {"touch": touch}, (TouchMisfit(3, 1, touch),), 2.0)
    assert fit.actual == 41.0
    assert "touches of finger 1 in action 3 cost 41 nats where 9 ± 4" in fit.text
    assert "not to be trusted" in fit.text
    assert "multiplied by 2.0" in fit.text


def test_the_expected_cost_of_a_motion_is_that_of_its_density():
    u = np.linspace(0, np.pi / 2, 400_001)[1:-1]  # u = arctan of the way
    density = np.tan(u) ** 2 * np.cos(u) ** 2  # of (1 + way^2)^-2 in three dimensions
    density /= density.sum()
    cost = -4 * np.log(np.cos(u))
    mean = (density * cost).sum()
    spread = np.sqrt((density * (cost - mean) ** 2).sum())
    assert (mean, spread) == pytest.approx(OF_MOTION, rel=1e-3)


def moved(ways, speed=0.0):
    """Return poses that lie still but for ways [m] between actions, and the window."""
    x = np.zeros((3, 1 + 3 * len(ways)))
    ends = 3 * np.arange(1, len(ways) + 1)
    x[0] = np.concatenate(
        [[0.0], np.cumsum(np.repeat(ways, 3) * ([0, 0, 1] * len(ways)))]
    )
    x[0, ends - 2] -= speed / 30
    gap = Steps(ends, ends, ends - 1, ends - 2, np.full(len(ends), 1 / 30))
    return x, SimpleNamespace(gap=gap, braking=3.0)


def test_one_motion_that_is_far_larger_than_all_others_is_a_misfit():
    still = 1e-5 * np.array([1.0, 2.0, 0.5, 1.5])
    for ways in (still, 100 * still, np.r_[still, 1e-3]):
        misfit = _largest_motion(*moved(ways))
        assert misfit.excess < misfit.limit
    lost = _largest_motion(*moved(np.r_[still, 8e-3]))
    assert lost.excess > lost.limit
    free, window = moved(np.r_[still, 8e-3])
    whole = np.vstack([free[:2], np.zeros((3, free.shape[1])), free[2]])
    assert _largest_motion(whole, window).actual == pytest.approx(lost.actual)
    sliding = _largest_motion(*moved(np.r_[still, 8e-3], speed=0.2))
    assert sliding.excess < sliding.limit  # it slid on


def test_a_lost_path_is_named_and_no_part_of_the_total(estimate):
    fit = estimate.fit
    assert fit.terms[BETWEEN_ACTIONS].excess < fit.terms[BETWEEN_ACTIONS].limit
    lost = Misfit(40.0, *OF_MOTION)
    poor = replace(fit, verdict="poor", terms={**fit.terms, BETWEEN_ACTIONS: lost})
    assert poor.total == fit.total
    assert "the largest motion between actions costs 40 nats where 5 ± 4" in poor.text


def test_a_body_that_was_moved_farther_than_it_slides_on_was_carried():
    still = 1e-5 * np.array([1.0, 2.0, 0.5])
    assert not _carried(*moved(np.r_[still, 8e-3]))
    assert _carried(*moved(np.r_[still, 12e-3]))
    assert not _carried(*moved(np.r_[still, 12e-3], speed=0.2))  # 7 mm by its speed


def test_a_carried_body_is_said_and_no_touch_is_blamed(estimate):
    text = replace(estimate.fit, verdict="poor").text
    assert text.endswith("expected; between actions the body moved by over 10 mm.")
