"""The fit: expected costs are those of simulated noise; misfits are named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import programme
from scipy.spatial.transform import Rotation

from formulations import sensing, violation_implicit
from formulations.names import BETWEEN_ACTIONS
from tactilenlp import Measurements, Noise, Options, solve_estimate
from tactilenlp.data.contact_segments import gaps_near_touches
from tactilenlp.data.noise_model import add_noise
from tactilenlp.data.sensor_noise import precision_of
from tactilenlp.information.goodness_of_fit import (
    LOST,
    OF_MOTION,
    PHYSICS_ROW,
    Fit,
    Misfit,
    TouchMisfit,
    _largest_motion,
    fit_of,
    free_moments,
    touch_moments,
)
from tactilenlp.information.trajectory import moved_farther
from tactilenlp.interface.readout import with_doubts
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
    k = int(np.argmin(window.touch.late_gap))  # a finger that stays in contact
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


def straight(p, felt, valid=None):
    """Return the measurements of a finger at x = p [m], in one action."""
    position = np.stack([p, 0 * p, 0 * p + 0.02], axis=1)[:, None]
    felt = np.asarray(felt, bool)[:, None]
    return Measurements(
        time=np.arange(len(p)) / 30, finger_position=position, finger_radius=0.01,
        contact=felt, normal=np.where(felt[..., None], [1.0, 0.0, 0.0], 0.0),
        action=np.zeros(len(p), int),
        valid=np.ones_like(felt) if valid is None else np.asarray(valid, bool)[:, None],
    )  # fmt: skip


def test_free_samples_that_approach_cost_what_drawn_gaps_cost():
    way, rng = np.array([[0.0, 0.8], [0.8, 1.6], [1.6, 2.4], [40.0, 41.0]]), np.random
    drawn = rng.default_rng(0).uniform(*way[:3].T, size=(DRAWS, 3))
    cost = np.log1p(np.exp(-drawn))
    mean, variance = free_moments(way)
    error = 4 * cost.std(axis=0) / np.sqrt(DRAWS)
    assert np.all(np.abs(mean - cost.mean(axis=0)) < error)
    assert variance == pytest.approx(cost.var(axis=0), rel=0.05)
    steady = np.stack([np.arange(0, 60, 0.05), np.arange(0.05, 60.05, 0.05)], axis=1)
    assert 0.05 * free_moments(steady)[0].sum() == pytest.approx(np.pi**2 / 12)


def test_a_finger_that_hardly_moves_at_the_end_of_a_touch_excuses_no_misfit():
    p = np.r_[1e-3 * np.arange(6, 0, -1), 0.0, 0.0, np.full(4, 1e-7)]
    felt = np.arange(12) // 2 == 3
    gaps = gaps_near_touches(straight(p, felt))
    assert len(gaps) == 7  # standing still is told once
    way = 1e-3 * np.array([[k - 1, k] for k in range(6, 0, -1)])
    assert gaps[:6] == pytest.approx(way)
    assert gaps[6:].max() <= 1e-7  # it stays where it ceased to touch
    mean, _ = free_moments(1500 * gaps)
    assert mean[6:] == pytest.approx(np.log(2), abs=1e-3)


def test_gaps_are_those_of_the_touch_next_to_a_sample_with_nothing_missing_between():
    felt, valid = np.zeros(9), np.ones(9)
    felt[[0, 6]], valid[7] = 1, 0
    found = gaps_near_touches(straight(1e-3 * np.arange(9), felt, valid))
    expected = [[0, 1], [1, 2], [2, 3], [1, 2], [0, 1]]
    assert found == pytest.approx(1e-3 * np.array(expected))


def test_an_estimated_noise_of_normals_widens_the_spread_and_a_told_one_does_not(
    recorded,
):
    data, scene, _ = recorded
    data = add_noise(data.select([0]), Noise(normal=0.08, seed=1))
    guessed = precision_of(data)
    assert 0 < guessed.normal_error < 1
    told = precision_of(data, replace(scene, sigma_normal=guessed.normal))
    assert (told.normal, told.normal_error) == (guessed.normal, 0.0)
    problem, window = programme(violation_implicit, data, scene)
    window = replace(window, sigma_normal=guessed.normal)
    solution = SimpleNamespace(at=lambda problem: (problem.pack({}), problem.data({})))
    unsure = replace(window, normal_error=guessed.normal_error)
    least, most = (
        fit_of(problem, solution, w, data, 1.0).terms["touch"] for w in (window, unsure)
    )
    noisier = guessed.normal * (1 + guessed.normal_error)
    noisier = replace(window, sigma_normal=noisier)
    mean, _ = touch_moments(problem, problem.data(), noisier, 1.0)
    assert most.expected == least.expected
    assert most.spread == pytest.approx(
        np.hypot(least.spread, mean.sum() - least.expected)
    )


def test_the_error_of_the_estimated_noise_is_that_of_many_draws(recorded):
    data, _, _ = recorded
    found = [
        precision_of(add_noise(data, Noise(normal=0.08, seed=seed)))
        for seed in range(60)
    ]
    scatter = np.std([p.normal for p in found]) / np.mean([p.normal for p in found])
    assert scatter == pytest.approx(np.mean([p.normal_error for p in found]), rel=0.35)


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


@pytest.mark.slow
def test_a_contradiction_is_named_by_finger_and_action(touched):
    """Every second normal of a touch is turned: no larger model explains that."""
    data, normal = touched.measurements, touched.measurements.normal.copy()
    rows = (data.action == 1)[:, None] & data.contact & data.valid
    finger = int(np.argmax(rows.sum(axis=0)))
    every = np.flatnonzero(rows[:, finger])[::2]
    normal[every, finger] = Rotation.from_euler("z", 25, True).apply(
        normal[every, finger]
    )
    lean = Options(
        hypotheses=1, starts=1, profile_likelihood=False, check_mistakes=False
    )
    wrong = replace(data, normal=normal)
    off = solve_estimate(wrong, touched.scene, options=lean, throw=False)
    assert touched.fit.verdict == "good"
    assert off.fit.verdict == "poor"
    assert off.fit.actual > touched.fit.actual + 10
    assert f"touches of finger {finger} in action 1 cost" in off.fit.text


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
    still = np.zeros((len(ends), 3))
    gap = Steps(
        ends, ends, ends - 1, ends - 2, *[np.full(len(ends), 1 / 30)] * 2, still
    )
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


def test_physics_costs_what_the_page_says_and_has_a_row_of_its_own(estimate):
    fit, laws = estimate.fit, ("balance", "dissipation", "complementarity")
    cost = sum(v for k, v in estimate.costs.items() if any(w in k for w in laws))
    row = fit.terms[PHYSICS_ROW]
    assert row.actual == pytest.approx(cost)
    assert (row.expected, row.spread) == (len(fit.touches), len(fit.touches) ** 0.5)
    assert row.excess < row.limit
    lost = Misfit(60.0, row.expected, row.spread)
    poor = replace(fit, verdict="poor", terms={**fit.terms, PHYSICS_ROW: lost})
    assert poor.total == fit.total
    assert f"; balance and friction cost 60 nats where {row.expected}" in poor.text


@pytest.mark.parametrize(("compliant", "verdict"), [(False, "poor"), (True, "good")])
def test_a_path_that_breaks_physics_is_poor_unless_fingertips_are_soft(
    recorded, monkeypatch, compliant, verdict
):
    data, scene, _ = recorded
    data = data.select([0])
    problem, window = programme(violation_implicit, data, scene)
    window = replace(window, compliant=compliant)
    solution = SimpleNamespace(at=lambda problem: (problem.pack({}), problem.data({})))
    value = problem.value

    def costly(name, x, data):
        physics = problem.costs[name].role == PHYSICS_ROW
        return np.full(1, 40.0) if physics else 0 * value(name, x, data)

    monkeypatch.setattr(problem, "value", costly)
    fit = fit_of(problem, solution, window, data, 1.0)
    assert fit.verdict == verdict
    assert (PHYSICS_ROW in fit.terms) == (not compliant)


def test_a_body_that_was_moved_farther_than_it_slides_on_was_carried():
    still = 1e-5 * np.array([1.0, 2.0, 0.5])
    assert not moved_farther(*moved(np.r_[still, 8e-3]), LOST)
    assert moved_farther(*moved(np.r_[still, 12e-3]), LOST)
    assert not moved_farther(
        *moved(np.r_[still, 12e-3], speed=0.2), LOST
    )  # 7 mm by its speed


def test_other_doubts_are_said_and_no_touch_is_blamed(estimate):
    poor = estimate.fit.doubted("the body moved 10 mm between actions")
    assert poor.verdict == "poor"
    assert poor.text == "The fit is poor: the body moved 10 mm between actions."
    bad = replace(estimate.fit, verdict="bad")
    assert bad.doubted("it moved") is bad


def test_a_reduction_that_is_far_from_holding_makes_a_fit_poor(estimate):
    (still,) = [s for s in estimate.skipped if s.name == "still"]
    assert with_doubts(estimate.fit, estimate.skipped) is estimate.fit
    near = replace(still, value=3 * still.limit, holds=False)
    assert with_doubts(estimate.fit, (near,)) is estimate.fit
    poor = with_doubts(estimate.fit, (replace(near, value=250 * still.limit),))
    assert poor.verdict == "poor"
    assert "far from holding, still: " in poor.text
    assert "DOES NOT HOLD" in poor.text
