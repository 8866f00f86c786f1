"""Fingertips that yield: derivatives, a case by hand, recovery, and rigid ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from programmes import programme, sums, true_values

from formulations import violation_implicit
from formulations.indentation import COMPLIANCE_SIGMA
from formulations.names import CENTRE_OF_MASS, COMPLIANCE
from formulations.shape import CUBOID
from tactilenlp import (
    Estimate,
    Measurements,
    Options,
    Scene,
    cuboid_errors,
    solve_estimate,
)
from tactilenlp.errors import SceneError
from tactilenlp.exploration.beliefs import sensor_model
from tactilenlp.interface.request import make_job, read_request
from tactilenlp.local.levels import levels_of
from tactilenlp.problem.reductions import Reductions

FOREIGN = ROOT.parent / "shared" / "foreign"
SOFT = Reductions(rigid=False)
G = 9.81  # [m/s^2]


@pytest.fixture(scope="module")
def foreign() -> Path:
    """The folder of recordings in plain MuJoCo; skips where it is absent."""
    if not FOREIGN.is_dir():
        pytest.skip(f"no recordings of other worlds beside this checkout ({FOREIGN})")
    return FOREIGN


def test_derivatives_with_compliance_are_those_of_finite_differences(
    two_actions, interpreted
):
    data, scene, truth = two_actions
    problem, window = programme(violation_implicit, data, scene, SOFT)
    values = true_values(problem, window, truth, np.random.default_rng(3))
    report = problem.check(values | {COMPLIANCE: 1.3e-3})
    for name in ("touch", "compliance prior"):
        assert max(report.derivatives[name]) < 1e-5, name
    assert report.assembled < 1e-5


def test_a_finger_sits_as_deep_as_compliance_times_impulse_over_weight(two_actions):
    data, scene, truth = two_actions
    problem, window = programme(violation_implicit, data, scene, SOFT)
    values = true_values(problem, window, truth, np.random.default_rng(3))
    values |= {COMPLIANCE: 2e-3, "depth": 1e-5}
    x, given = problem.pack(values), problem.data()
    inside = problem.value("indentation", x, given)[:, 0]
    row, stepped = window.push_of_touch
    w = scene.mass * G * window.step.dt[window.push.step[row]]
    expected = 1e-5 + stepped * 2e-3 * values["finger"][0, row] / w
    np.testing.assert_allclose(inside, expected, rtol=1e-9)
    assert inside.max() > 1e-4  # impulses at random press some fingers in


def test_no_compliance_costs_what_rigid_fingertips_cost(two_actions):
    data, scene, truth = two_actions
    costs = []
    for choice in (SOFT, Reductions()):
        problem, window = programme(violation_implicit, data, scene, choice)
        values = true_values(problem, window, truth, np.random.default_rng(3))
        none = {COMPLIANCE: 0.0} if COMPLIANCE in problem.variables else {}
        costs.append(sums(problem, values | none))
    assert costs[0].pop("compliance prior") == 0.0
    assert costs[0].pop("push prior") > 0.0  # of the impulses alone
    assert costs[0] == pytest.approx(costs[1], rel=1e-12)


def test_known_compliance_is_a_parameter_in_metres_per_newton(two_actions):
    data, scene, _ = two_actions
    known = replace(scene, compliance=3e-4)
    problem, _ = programme(violation_implicit, data, known)
    assert COMPLIANCE not in problem.variables
    given = problem.data()[problem.parameters[COMPLIANCE].span]
    assert given == pytest.approx(3e-4 * scene.mass * G)
    rigid, _ = programme(violation_implicit, data, replace(scene, compliance=0.0), SOFT)
    assert COMPLIANCE not in rigid.variables
    assert COMPLIANCE not in rigid.parameters


@pytest.mark.parametrize("wrong", [-1e-4, 1.0, np.nan, "soft"])
def test_an_impossible_compliance_is_refused(wrong):
    with pytest.raises(SceneError, match="compliance"):
        Scene(compliance=wrong)


def test_rigid_fingertips_stay_rigid_where_the_fit_is_good(estimate):
    assert estimate.fit.verdict == "good"
    assert estimate.compliance is None
    (rigid,) = [s for s in estimate.skipped if s.name == "rigid"]
    assert rigid.holds
    assert rigid.value < rigid.limit


@pytest.mark.slow
@pytest.mark.parametrize("box", [0, 2])
def test_soft_contacts_are_found_and_sizes_are_within_three_sigma(
    foreign, box, tmp_path
):
    # MuJoCo's default contact: rigid fingertips are 1.5 to 2.6 mm off, 12 sigma.
    file = foreign / f"box_{box}_default.npz"
    estimate = solve_estimate(Measurements.load(file), Scene.load(file))
    with np.load(file) as truth:
        off = cuboid_errors(
            estimate.side_lengths, estimate.position[-1], estimate.quaternion[-1],
            truth["side_lengths"], truth["object_position"][-1],
            truth["object_quaternion"][-1],
        )  # fmt: skip
    sigma = estimate.information.sigma("side_lengths")[off.permutation]
    assert np.abs(off.side_lengths[:2]).max() < 0.6e-3  # x and y were touched
    assert np.abs(off.side_lengths / sigma).max() < 3
    assert 0 < estimate.compliance * estimate.scene.mass * G < COMPLIANCE_SIGMA
    assert "Fingertips are soft" in estimate.summary()
    estimate.save(tmp_path / "soft.npz")
    again = Estimate.load(tmp_path / "soft.npz")
    assert again.compliance == estimate.compliance
    assert again.fit == estimate.fit


@pytest.mark.slow
@pytest.mark.parametrize("box", range(5))
def test_one_action_of_soft_fingertips_leaves_no_path_of_rigid_ones(foreign, box):
    file = foreign / f"box_{box}_default.npz"
    data, scene = Measurements.load(file), Scene.load(file)
    data = data.select(data.action[:1])
    soft = replace(scene, compliance=COMPLIANCE_SIGMA / (scene.mass * G) / 2)
    known = solve_estimate(data, soft, throw=False)
    found = solve_estimate(data, scene, throw=False)
    assert found.fit.verdict == "good"
    # 2.5 mm under one weight are a guess; the freed compliance explains as much.
    assert found.objective < known.objective + 1.0


def test_compliance_is_held_at_its_guess_before_it_is_free(two_actions):
    data, scene, _ = two_actions
    job = make_job(data, scene, CUBOID, Options(), 0.0, violation_implicit)
    soft = replace(job, reductions=replace(job.reductions, rigid=False))
    *held, last = levels_of(soft)
    assert held
    assert all(COMPLIANCE in level.fixed for level in held)
    assert not last.fixed
    assert not any(COMPLIANCE in k.fixed for k in levels_of(job))


@pytest.mark.slow
def test_a_box_that_rocks_is_let_tilt_and_its_untouched_height_stays_open(foreign):
    # Flat, its height is told by a lever arm: 8 mm off at 0.14 mm, 58 sigma.
    file = foreign / "box_4_stiff.npz"
    estimate = solve_estimate(Measurements.load(file), Scene.load(file))
    assert len(estimate.unknowns["x"]) == 6
    height = np.argmin(estimate.faces.min(axis=1))
    with np.load(file) as truth:
        true = np.sort(truth["side_lengths"])
    off = np.abs(np.sort(estimate.side_lengths) - true).max()
    assert off < 3 * estimate.information.sigma("side_lengths")[height]


@pytest.mark.slow
def test_a_better_optimum_that_a_profile_meets_is_kept_with_its_impulses(foreign):
    """From guessed impulses the solve went elsewhere: 30.9 nats, not 25.1."""
    file = foreign / "box_4_default.npz"
    estimate = solve_estimate(Measurements.load(file), Scene.load(file))
    assert estimate.success
    assert estimate.objective < 28.0


def test_a_page_without_compliance_takes_fingertips_as_rigid(two_actions):
    data, scene, _ = two_actions
    lean = Options(hypotheses=1, starts=1, profile_likelihood=False)
    estimate = solve_estimate(data, scene, formulation="quasi_static", options=lean)
    assert estimate.compliance is None


def test_derivatives_with_a_free_centre_of_mass_are_those_of_finite_differences(
    two_actions, interpreted
):
    data, scene, truth = two_actions
    free = Reductions(central=False)
    problem, window = programme(violation_implicit, data, scene, free)
    values = true_values(problem, window, truth, np.random.default_rng(3))
    report = problem.check(values | {CENTRE_OF_MASS: np.array([1e-3, -2e-3, 5e-4])})
    balances = [name for name in report.derivatives if name.startswith("balance")]
    for name in (*balances, "centre of mass prior"):
        assert max(report.derivatives[name]) < 1e-5, name
    assert report.assembled < 1e-5


def test_a_known_centre_of_mass_is_no_unknown(two_actions):
    data, scene, _ = two_actions
    known = replace(scene, sigma_centre=0.0)
    problem, _ = programme(violation_implicit, data, known, Reductions(central=False))
    assert CENTRE_OF_MASS not in problem.variables


def test_the_centre_of_mass_stays_the_centroid_where_the_fit_is_good(estimate):
    (central,) = [s for s in estimate.skipped if s.name == "central"]
    assert central.holds
    assert not estimate.centre_of_mass.any()


def test_a_soft_fingertip_tells_less_about_the_next_touch(estimate):
    rigid = sensor_model(estimate)
    soft = sensor_model(
        replace(estimate, scene=replace(estimate.scene, compliance=2e-4))
    )
    assert soft[0] == rigid[0]
    assert soft[1] > 1.2 * rigid[1]
    assert soft[2] > 1.2 * rigid[2]


@pytest.mark.parametrize("formulation", ["quasi_static", "multiple_shooting", "paper"])
def test_pages_of_rigid_fingertips_refuse_a_compliance_that_is_told(
    recorded, formulation
):
    data, scene, _ = recorded
    soft = replace(scene, compliance=1e-3)
    with pytest.raises(SceneError, match=r"compliance.*violation_implicit"):
        solve_estimate(data, soft, formulation=formulation)
    read_request(data, replace(scene, compliance=0.0), "cuboid", formulation)


@pytest.mark.parametrize("gravity", [9.81, 1.62])
def test_softness_is_told_by_a_force_whatever_the_gravity(estimate, gravity):
    found = replace(
        estimate, scene=replace(estimate.scene, gravity=gravity),
        unknowns=estimate.unknowns | {COMPLIANCE: np.array([[0.7e-3]])},
    )  # fmt: skip
    force = 0.7e-3 / found.compliance
    assert f"they yield 0.70 mm under {force:.1f} N." in found.summary()
