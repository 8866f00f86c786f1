"""Fingers that are not where they say: an unknown of the page, with a prior."""

from dataclasses import replace

import numpy as np
import pytest
from programmes import programme

from formulations import quasi_static, violation_implicit
from formulations.shape import CUBOID
from tactilenlp import (
    Action,
    Estimate,
    Options,
    Scene,
    Workspace,
    observed_information,
    solve_estimate,
)
from tactilenlp.errors import OptionError, SceneError
from tactilenlp.exploration.expected_information import ExpectedInformation
from tactilenlp.exploration.push_model import push_function
from tactilenlp.information.comparisons import information_gain
from tactilenlp.problem.reductions import Reductions

SIGMA = 2e-3  # [m]
OFF = np.array([[1.5, -1.0, 0.5], [-2.0, 1.0, -0.5]]) * 1e-3  # [m]


# Fewer hypotheses than by default: two actions are searched in a second or two.
LEAN = Options(hypotheses=2, starts=4, profile_likelihood=False)

pytestmark = pytest.mark.usefixtures("not_compiled")  # compiling takes longer


def lean(data, scene, start=None):
    return solve_estimate(data, scene, options=LEAN, start=start, throw=False)


def moved(data, way):
    """Return data whose fingers say that they are elsewhere by `way` (F, 3) [m]."""
    return replace(data, finger_position=data.finger_position + way)


@pytest.fixture(scope="module")
def exact(recorded):
    """The estimate of two actions, of fingers that are where they say."""
    data, scene, _ = recorded
    return lean(data.select(range(2)), scene)


@pytest.fixture(scope="module")
def told(recorded):
    """The estimate of the same actions whose fingers are OFF, and the scene."""
    data, scene, _ = recorded
    scene = replace(scene, sigma_offset=SIGMA)
    return lean(moved(data.select(range(2)), -OFF), scene), scene


@pytest.mark.parametrize("page", [quasi_static, violation_implicit])
@pytest.mark.parametrize("planar", [True, False])
def test_derivatives_with_offsets_are_those_of_finite_differences(
    recorded, page, planar
):
    data, scene, _ = recorded
    scene = replace(scene, sigma_offset=SIGMA)
    problem, _ = programme(page, data.select([1]), scene, Reductions(planar=planar))
    rng = np.random.default_rng(0)
    start = {
        name: v.guess + 0.3 * v.scale[:, None] * rng.normal(size=v.guess.shape)
        for name, v in problem.variables.items()
    }
    assert start["finger offset"].shape == (3, 2)
    report = problem.check(start)
    worst = max(max(errors) for errors in report.derivatives.values())
    assert max(worst, report.assembled) < 1e-4, str(report)


@pytest.mark.parametrize(
    "page", [quasi_static, pytest.param(violation_implicit, marks=pytest.mark.slow)]
)
def test_an_offset_is_the_same_as_fingers_elsewhere(recorded, page):
    data, scene, _ = recorded
    data = data.select([0, 1])
    known, _ = programme(page, moved(data, OFF), scene)
    open_, _ = programme(page, data, replace(scene, sigma_offset=SIGMA))
    rng, size = np.random.default_rng(1), {}
    for name, v in known.variables.items():
        size[name] = v.guess + 0.3 * v.scale[:, None] * rng.normal(size=v.guess.shape)
    x = known.pack(size), open_.pack(size | {"finger offset": OFF.T})
    for name in known.terms:
        values = [
            p.value(name, at, p.data()) for p, at in zip((known, open_), x, strict=True)
        ]
        assert np.allclose(*values, rtol=1e-9, atol=1e-9), name
    cost = open_.value("finger offset prior", x[1], open_.data())[:, 0]
    assert cost == pytest.approx((OFF**2).sum(axis=1) / (2 * SIGMA**2))


def test_nothing_is_paid_where_fingers_are_where_they_say(recorded):
    data, scene, _ = recorded
    problem, _ = programme(violation_implicit, data.select([0, 1]), scene)
    assert "finger offset" not in problem.variables
    assert "finger offset prior" not in problem.terms


@pytest.fixture(scope="module")
def certain(recorded):
    """The estimate where the prior of the offsets leaves nothing open."""
    data, scene, _ = recorded
    return lean(data.select(range(2)), replace(scene, sigma_offset=1e-9))


@pytest.mark.slow
def test_a_prior_that_is_certain_is_the_same_as_none(certain, exact):
    again = certain
    assert again.objective == pytest.approx(exact.objective, abs=1e-4)
    assert np.abs(again.side_lengths - exact.side_lengths).max() < 1e-6
    assert np.abs(again.position - exact.position).max() < 1e-6
    assert np.abs(again.finger_offset).max() < 1e-8
    sigmas = (e.information.sigma("side_lengths") for e in (again, exact))
    assert np.allclose(*sigmas, rtol=1e-2)


def test_a_known_offset_is_found_within_its_sigma(told):
    estimate, _ = told
    sigma = estimate.information.sigma("finger_offset")
    wide = estimate.information.widened(2.0).sigma("finger_offset")
    np.testing.assert_allclose(wide, 2 * sigma)
    assert sigma.shape == (2, 3)
    off = (estimate.finger_offset - OFF).ravel()
    # what all fingers share is known by the prior alone
    C = estimate.information.covariance("finger_offset")
    both = np.tile(np.eye(3), 2) / 2
    common = np.sqrt(np.diag(both @ C @ both.T))
    assert common[:2] == pytest.approx(SIGMA / np.sqrt(2), rel=0.1)
    assert off @ np.linalg.solve(C, off) / 6 < 2.1  # 95 % of chi^2 of six
    assert (sigma < 1.1 * SIGMA).all()


def assert_within_sigma(found, exact):
    off = found.position[-1] - exact.position[-1]
    assert (np.abs(off) < 3 * found.information.sigma("position")).all()
    off = found.side_lengths - exact.side_lengths
    assert (np.abs(off) < 3 * found.information.sigma("side_lengths")).all()


def test_the_body_is_found_within_a_sigma_that_tells_of_the_offset(told, exact):
    found, _ = told
    for quantity in ("side_lengths", "position"):
        sigma = found.information.sigma(quantity)
        sharp = exact.information.sigma(quantity)
        assert (sigma > 5 * sharp)[sharp < 1e-3].all()
    assert_within_sigma(found, exact)


@pytest.mark.slow
def test_an_offset_that_is_ignored_is_against_the_data_or_softens_the_fingertips(
    told, recorded, exact
):
    found, _ = told
    _, known, _ = recorded
    ignorant = lean(found.measurements, replace(known, compliance=0.0))
    assert found.objective < ignorant.objective - 10.0
    # soft fingertips and a body that tilts explain it in part: sigma tells of that
    soft = lean(found.measurements, known)
    assert soft.compliance > 0
    assert_within_sigma(soft, exact)


def test_a_world_that_is_moved_moves_the_body_and_no_offset(told):
    estimate, scene = told
    way = np.array([0.03, -0.02, 0.0])
    again = lean(moved(estimate.measurements, way), scene)
    assert again.objective == pytest.approx(estimate.objective, abs=1e-3)
    assert np.abs(again.finger_offset - estimate.finger_offset).max() < 1e-5
    assert np.abs(again.position - estimate.position - way).max() < 1e-5


def test_offsets_survive_a_file_and_are_told(told, tmp_path):
    estimate, _ = told
    estimate.save(tmp_path / "estimate.npz")
    again = Estimate.load(tmp_path / "estimate.npz")
    assert np.array_equal(again.finger_offset, estimate.finger_offset)
    assert np.array_equal(again.information.offsets, estimate.information.offsets)
    assert again.scene.sigma_offset == SIGMA
    assert "finger 1 by (" in again.summary()
    more = observed_information(again, kind="gauss_newton")
    assert np.isfinite(more.sigma("side_lengths")).all()


def test_hypotheses_carry_offsets_to_the_next_action(told, recorded):
    estimate, scene = told
    data, _, _ = recorded
    assert all(h.offset is not None for h in estimate.hypotheses)
    later = lean(moved(data.select(range(3)), -OFF), scene, start=estimate)
    sigma = estimate.information.sigma("finger_offset")
    assert (np.abs(later.finger_offset - OFF) < 3 * sigma).all()


@pytest.mark.parametrize("formulation", ["paper", "multiple_shooting"])
def test_pages_that_know_no_offsets_say_so(recorded, formulation):
    data, scene, _ = recorded
    scene = replace(scene, sigma_offset=SIGMA)
    with pytest.raises(SceneError, match=r"sigma_offset.*violation_implicit"):
        solve_estimate(data, scene, formulation=formulation)
    with pytest.raises(SceneError, match="measured finger positions as exact"):
        solve_estimate(data, scene, shape="polytope")
    with pytest.raises(SceneError, match="sigma_offset"):
        Scene(sigma_offset=0.0)


@pytest.fixture
def action(recorded):
    data, _, _ = recorded
    space = Workspace(finger_radius=float(data.finger_radius[0]))
    return Action(np.array([0.2, 0.1, -0.2, 0.1]), space)


def test_an_action_tells_less_of_the_body_where_fingers_are_off(told, action):
    expected = ExpectedInformation(told[0], action.workspace, hypotheses=1)
    belief, F = expected.beliefs[0], expected.gain(action)
    k = len(belief.z)
    assert belief.information.shape == (k + 6, k + 6)
    # had the offsets been found out just before, the same touches would tell more
    known = belief.information[:k, :k]
    told_of_body = expected.prospect(action).information
    assert 0 < F < information_gain(known, told_of_body)


def test_what_is_known_of_body_and_offsets_marginalises_to_the_body(told):
    information = told[0].information
    k = len(information.names)
    C = np.linalg.inv(information.with_offsets)[:k, :k]
    assert np.allclose(C, np.linalg.inv(information.matrix), rtol=1e-6, atol=0)


@pytest.mark.slow
def test_a_certain_prior_tells_of_an_action_what_none_does(certain, exact, action):
    gains = [
        ExpectedInformation(e, action.workspace, hypotheses=1).gain(action)
        for e in (certain, exact)
    ]
    assert gains[0] == pytest.approx(gains[1], rel=1e-3)


def test_an_action_of_fingers_that_were_not_measured_is_refused(told, exact, action):
    alone = Workspace(fingers=1)
    with pytest.raises(OptionError, match=r"workspace\.fingers.*expected 2.*got 1"):
        ExpectedInformation(told[0], alone)
    expected = ExpectedInformation(told[0], action.workspace, hypotheses=1)
    for ask in (expected.gain, expected.prospect):
        with pytest.raises(OptionError, match=r"workspace\.fingers"):
            ask(alone.action([0.2, 0.1]))
    # fingers that are where they say may be others
    known = ExpectedInformation(exact, alone, hypotheses=1)
    assert np.isfinite(known.gain(alone.action([0.2, 0.1])))


def test_a_body_follows_fingers_that_are_elsewhere():
    n, k = 30, 12
    step = push_function(CUBOID, False, 2, n, True)
    s = np.linspace(0, 1, n + 1)[:, None]
    ends = [(0.06, 0.012, 0.02), (0.018, 0.012, 0.02)]
    lines = [
        a * (1 - s) + b * s for a, b in [np.array(ends), np.array(ends) * [-1, -1, 1]]
    ]
    z = np.array([0.05, 0.04, 0.03, 0.0, 0.0, 0.1])
    known, mute = [0.3, 0.5, 4.9, 160.0, 1.7], [1e-9, 1e9, 1e9]

    def way(first):
        r = np.hstack([lines[0] + first, lines[1]]).T
        rest = np.zeros(3), r[:, 0], np.zeros(3), np.zeros((3, k)), np.zeros((3, 3))
        out = step(
            *rest, z, r[:, :-1], r[:, 1:], [0.01, 0.01], known,
            mute, 1.0,
        )  # fmt: skip
        return out[2].full()[:, -1], out[3].full()[:, -k:]

    slopes = way(np.zeros(3))[1][:, 6:8]
    for axis in range(2):
        by = 1e-6 * np.eye(3)[axis]
        found = (way(by)[0] - way(-by)[0]) / 2e-6
        # the prediction holds contact forces fixed within a step: a few per cent
        assert slopes[:, axis] == pytest.approx(found, rel=0.2, abs=0.05)
