"""Sigma tells what is known to err, and names what is not known at all."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import Estimate, Problem, assumption_sensitivity, observed_information
from tactilenlp.errors import OptionError
from tactilenlp.geometry.transforms import rotation_of
from tactilenlp.information.comparisons import gauss_newton
from tactilenlp.information.error_budget import errors_by_name, summed
from tactilenlp.information.error_budget_terms import (
    UNTOUCHED_FACTOR,
    untouched_faces,
)
from tactilenlp.information.linearisation import Linearisation, kkt_residual
from tactilenlp.information.measurement_noise import gaps_of_touches, touches
from tactilenlp.information.tangent_space import TangentSpace, inverse
from tactilenlp.nlp.kkt import LEAST_CURVATURE, kkt_system_of
from tactilenlp.problem.hypothesis import Hypothesis, resized
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import solve

UP = np.array([0.0, 0.0, 1.0])
UNITS = np.r_[1e3, 1e3, 1e3, 1e3, 1e3, 50.0]  # to mm, a radian as 50 mm


@pytest.fixture(scope="module")
def kkt(programme):
    return kkt_system_of(programme.problem, programme.solution)


@pytest.fixture(scope="module")
def sensitivity(estimate):
    return assumption_sensitivity(estimate)


def chain(slope=0.8, noise=0.1, drift=0.05, steps=12):
    """A state that drifts from step to step, measured at each: linear and Gaussian."""
    y = np.random.default_rng(0).normal(size=steps)
    problem = Problem()
    gain = problem.variable("gain", 1, guess=0.0, unit="1", scale=1.0)
    x = problem.variable("x", 1, steps, guess=0.0, unit="m", scale=0.1)
    problem.minimize("prior", lambda a: a**2 / 2, gain, role="prior")
    problem.minimize(
        "felt", lambda x, y: (x - y) ** 2 / (2 * noise**2), x, y, role="likelihood"
    )
    problem.minimize(
        "drift", lambda a, x, x_1: (x - slope * x_1 - a) ** 2 / (2 * drift**2),
        gain, x[:, 1:], x[:, :-1], role="physics",
    )  # fmt: skip
    step = np.eye(steps + 1)[2:] - slope * np.eye(steps + 1)[1:-1]
    step[:, 0] = -1
    felt = np.eye(steps + 1)[1:]
    H = felt.T @ felt / noise**2 + step.T @ step / drift**2
    H[0, 0] += 1
    return problem, np.linalg.inv(H)


def test_covariance_of_a_linear_gaussian_chain_is_exact_to_the_eighth_digit():
    problem, C = chain()
    kkt = kkt_system_of(problem, solve(problem, SolverOptions(tolerance=1e-10)))
    chosen = np.array([0, problem.size - 1])
    found = kkt.sensitivity(chosen)[0][chosen]
    assert np.allclose(found, C[np.ix_(chosen, chosen)], rtol=1e-8)


def test_hessian_of_the_estimate_is_the_slope_of_its_gradient(kkt):
    problem, rng = kkt.problem, np.random.default_rng(0)
    way = rng.normal(size=problem.size) * problem.scale
    exact, found = kkt.hessian(problem.terms) @ way, []
    whole = kkt.curvature @ (way / problem.scale) / problem.scale
    assert np.allclose(whole, exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())
    for h in (1e-6, 2e-6):
        ends = []
        for side in (1, -1):
            x = kkt.x + side * h * way
            moved = type(kkt)(**{**vars_of(kkt), "x": x})
            ends.append(kkt_residual(problem, moved)[0])
        found.append((ends[0] - ends[1]) / (2 * h))
    extrapolated = (4 * found[0] - found[1]) / 3
    error = np.abs((extrapolated - exact) * problem.scale).max()
    assert error < 1e-6 * np.abs(exact * problem.scale).max()


def vars_of(kkt):
    return {name: getattr(kkt, name) for name in kkt.__dataclass_fields__}


def test_the_parts_of_the_information_sum_to_the_whole(estimate):
    information = estimate.information
    roles = ("likelihood", "physics", "prior", "regulariser", "constraint")
    total = sum(information.part(role) for role in roles)
    assert np.allclose(total, information.matrix, rtol=1e-4)
    assert np.trace(information.part("touch")) > 0
    with pytest.raises(OptionError, match="likelihood"):
        information.part("weather")


def test_a_size_touched_on_both_faces_is_known_from_touch_and_not_from_the_prior(
    estimate,
):
    information = estimate.information
    axis = np.argmax(estimate.faces.min(axis=1))
    touch = information.part("likelihood")[axis, axis]
    assert touch > 3 * information.part("size prior")[axis, axis]


def test_fingers_that_all_shift_carry_the_body_along_and_keep_its_size(sensitivity):
    for axis, word in enumerate("xy"):
        total = sum(sensitivity.moves[f"finger {f} offset {word}"] for f in (0, 1))
        expected = np.zeros(6)
        expected[3 + axis] = 1.0
        # the sizes are held by a prior and least impulses as well, hence not exactly
        assert np.allclose(total, expected, atol=1e-3)


def test_a_wrong_mass_moves_impulses_and_not_the_body(sensitivity):
    assert np.abs(sensitivity.moves["mass"] * UNITS).max() < 0.05  # mm per kg


@pytest.mark.parametrize("name", ["friction_finger", "sigma_normal"])
def test_sensitivity_is_what_solving_again_gives(
    estimate, programme, sensitivity, name
):
    scene, window = estimate.scene, programme.window
    owner = scene if hasattr(scene, name) and getattr(scene, name) else window
    step, ends = 2e-3 * getattr(owner, name), []
    for side in (1, -1):
        changed = replace(owner, **{name: getattr(owner, name) + side * step})
        build = programme.job.build
        problem = build(window, changed) if owner is scene else build(changed)
        solution = solve(
            problem, SolverOptions(tolerance=1e-10, barrier=1e-9, push=1e-9),
            start=programme.solution.values,
        )  # fmt: skip
        z = np.r_[solution.values["theta"][:, 0], solution.values["x"][:, -1]]
        ends.append(z)
    again = (ends[0] - ends[1]) / (2 * step) * UNITS
    told = sensitivity.moves[name] * UNITS
    # contacts near their cones' edges change state within the step
    assert np.abs(again - told).max() < 0.05 * np.abs(again).max() + 1e-3


def test_what_curves_down_is_named_and_not_repaired():
    problem = Problem()
    a = problem.variable("a", 2, guess=0.0, unit="m", scale=1.0)
    problem.minimize("bowl", lambda a: ca.sumsqr(a), a, role="prior")
    problem.minimize("ridge", lambda a: -2 * a[1] ** 2, a, role="physics")
    saddle = solve(problem, SolverOptions(iterations=1), throw=False)
    saddle.values["a"][:] = 0.0
    kkt = kkt_system_of(problem, saddle)
    term, direction = kkt.negative
    assert term == "ridge"
    assert abs(direction[1]) > 10 * abs(direction[0])
    assert gauss_newton(kkt).negative is None
    assert kkt.sensitivity(np.array([1]))[0][1, 0] < 0


def test_what_curves_down_is_found_among_thousands_of_unknowns():
    """Where curvatures span twelve decades and Lanczos' method would not end."""
    problem, stiff = Problem(), np.logspace(-6, 6, 2000)
    a = problem.variable("a", 1, 2000, guess=0.0, unit="m", scale=1.0)
    problem.minimize("bowl", lambda a, k: k * a**2, a, stiff, role="prior")
    problem.minimize("ridge", lambda a: -(a**2), a[:, [1000]], role="physics")
    problem.minimize("pair", lambda a, b: -3 * a * b, a[:, [7]], a[:, [8]],
                     role="regulariser")  # fmt: skip
    saddle = solve(problem, SolverOptions(iterations=1), throw=False)
    saddle.values["a"][:] = 0.0
    term, direction = kkt_system_of(problem, saddle).negative
    assert term == "pair"
    assert set(np.argsort(np.abs(direction))[-2:]) == {7, 8}


def test_a_direction_that_is_known_exactly_has_a_finite_information():
    C = np.diag([1e-6, 0.0, 4e-6])
    assert np.all(np.isfinite(inverse(C)))
    assert inverse(C)[0, 0] == pytest.approx(1e6)


@pytest.mark.parametrize(("axis", "face"), [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_a_resized_body_keeps_the_face_that_was_touched(axis, face):
    yaw = 0.7
    h = Hypothesis(
        np.array([0.04, 0.05, 0.06]), np.array([[0.1], [0.2], [yaw]]), 0.0, ()
    )
    touched = np.eye(2)[face] * 5
    other = resized(h, axis, 0.02, touched)
    along = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])[axis]
    side = (-1, 1)[face]
    where = [along @ o.x[:2, 0] + side * o.theta[axis] / 2 for o in (h, other)]
    assert where[0] == pytest.approx(where[1])
    assert other.theta[axis] == 0.02


def test_information_survives_a_file(estimate, tmp_path):
    estimate.save(tmp_path / "estimate.npz")
    again = Estimate.load(tmp_path / "estimate.npz")
    C = estimate.information.covariance_matrix
    assert np.array_equal(again.information.covariance_matrix, C)
    with np.load(tmp_path / "estimate.npz") as file:  # by its older name
        assert np.array_equal(file["information/spread"], C)
    kind = [observed_information(e, "sandwich").matrix for e in (estimate, again)]
    assert np.array_equal(*kind)


def test_a_face_that_nothing_touched_is_as_doubtful_as_the_fingers_paths_are_noisy():
    yaw, noise = 0.7, 1e-3
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    z = np.r_[0.05, 0.03, 0.04, 0.1, 0.2, yaw]
    tangent = TangentSpace(("",) * 6, np.arange(6), np.eye(6), {}, (), z, R, R, UP)

    def doubt_of(*faces):
        return untouched_faces(tangent, CUBOID, faces, noise, True)

    doubt = doubt_of([9, 9], [9, 0], [0, 9])
    assert doubt[1, 1] == pytest.approx((UNTOUCHED_FACTOR * noise) ** 2)
    assert doubt[0, 0] == doubt[2, 2] == 0
    # the face that was touched stays where it is: centre less half the side
    face = np.r_[0, -0.5, 0, -s, c, 0]
    assert face @ doubt @ face == pytest.approx(0, abs=1e-15)
    assert not doubt_of([9, 9], [9, 9], [0, 9]).any()


def test_the_face_that_a_body_stands_on_is_known_on_ground_that_leans():
    lean = rotation_of([np.cos(0.3), np.sin(0.3), 0.0, 0.0]).as_matrix()
    z, faces = np.zeros(9), [[9, 9], [9, 9], [0, 9]]

    def doubt_of(R, up):
        tangent = TangentSpace(("",) * 9, np.arange(9), np.eye(9), {}, (), z, R, R, up)
        return untouched_faces(tangent, CUBOID, faces, 1e-3, True)

    assert not doubt_of(np.eye(3), UP).any()
    assert not doubt_of(lean, lean @ UP).any()
    assert doubt_of(lean, UP).any()  # it stands on an edge


def test_a_finger_off_its_face_is_off_in_that_touch_alone(programme, kkt):
    data, window = programme.job.data, programme.window
    touch, first = window.touch, np.zeros(len(window.touch))
    first[next(iter(touches(window, data).values()))] = 1.0
    p_wf = touch.p_wf + 2e-3 * first[:, None] * touch.normal
    moved = replace(window, touch=replace(touch, p_wf=p_wf))
    before = gaps_of_touches(kkt, window, data)
    after = gaps_of_touches(kkt, moved, data)
    assert before.max() < 0.1e-3  # this recording contradicts itself nowhere
    assert after[0] == pytest.approx(2e-3, abs=0.1e-3)
    assert np.allclose(after[1:], before[1:])


def test_what_keeps_the_matrix_regular_counts_as_a_prior(programme, kkt, monkeypatch):
    chosen = np.arange(3)
    by_gradient, _ = kkt.sensitivity(chosen)
    at = Linearisation(kkt, programme.job, programme.window).response(chosen, np.eye(3))
    errors = summed(errors_by_name(at))
    monkeypatch.setattr(
        "tactilenlp.information.error_budget_terms.LEAST_CURVATURE",
        1.0 + LEAST_CURVATURE,
    )
    more = summed(errors_by_name(at)) - errors
    scaled = by_gradient / programme.problem.scale[:, None]
    assert np.allclose(more, scaled.T @ scaled, rtol=1e-6)


@pytest.mark.parametrize("rows", [3, 6])
def test_a_size_that_is_no_width_moves_no_pose(rows):
    """A shape of one's own may have more sizes than the body has axes."""
    x = np.linspace(0.1, 0.5, 4 * rows).reshape(rows, 4)
    before = Hypothesis(np.array([0.05, 0.04, 0.03, 0.002]), x, 0.0, ())
    after = resized(before, 3, 0.004, (0, 0))
    assert after.theta.tolist() == [0.05, 0.04, 0.03, 0.004]
    assert np.array_equal(after.x, x)
