"""The reduced exact Hessian is the covariance of the estimator."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactilenlp import Problem, observed_information
from tactilenlp.errors import OptionError, TactileError
from tactilenlp.information.tangent_space import known_faces, unobserved
from tactilenlp.nlp.kkt import kkt_system_of
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import solve

SIGMA = 0.1


def line(slope, offset, t, y):
    return (slope * t + offset - y) ** 2 / (2 * SIGMA**2)


def fit(y, t, upper=np.inf, past=False):
    """A straight line through (t, y), by two unknowns and as many states if `past`."""
    problem = Problem()
    slope = problem.variable("slope", 1, guess=0.0, upper=upper, unit="m/s", scale=0.1)
    offset = problem.variable("offset", 1, guess=0.0, unit="m", scale=2.0)
    if not past:
        problem.minimize("fit", line, slope, offset, t, y, role="likelihood")
        return problem, solve(problem, SolverOptions(tolerance=1e-9))
    state = problem.variable("state", 1, len(t), guess=0.0, unit="m", scale=0.3)
    problem.subject_to(
        "states on the line", lambda a, b, s, t: s - a * t - b, slope, offset, state, t,
        lower=0, upper=0,
    )  # fmt: skip
    problem.minimize(
        "fit", lambda s, y: (s - y) ** 2 / (2 * SIGMA**2), state, y, role="likelihood"
    )
    return problem, solve(problem, SolverOptions(tolerance=1e-9))


@pytest.fixture
def samples():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 15)
    return t, 0.7 * t - 0.2 + SIGMA * rng.normal(size=15)


def least_squares_covariance(t):
    A = np.c_[t, np.ones_like(t)]
    return np.linalg.inv(A.T @ A) * SIGMA**2


def active(problem, solution) -> int:
    """Return how many constraints and bounds are active at a solution."""
    return sum(kkt_system_of(problem, solution).active.values())


def test_covariance_of_a_line_is_that_of_least_squares(samples):
    t, y = samples
    solved = fit(y, t)
    C = kkt_system_of(*solved).marginal(np.array([0, 1]))
    assert np.allclose(C, least_squares_covariance(t), rtol=1e-6)
    assert active(*solved) == 0


def test_states_that_constraints_tie_to_the_line_are_marginalised_away(samples):
    t, y = samples
    solved = fit(y, t, past=True)
    C = kkt_system_of(*solved).marginal(np.array([0, 1]))
    assert np.allclose(C, least_squares_covariance(t), rtol=1e-6)
    assert active(*solved) == len(t)


def test_an_active_bound_leaves_no_variance_and_conditions_the_rest(samples):
    t, y = samples
    solved = fit(y, t, upper=0.2)
    C = kkt_system_of(*solved).marginal(np.array([0, 1]))
    assert active(*solved) == 1
    assert C[0, 0] == pytest.approx(0, abs=1e-8)
    assert C[1, 1] == pytest.approx(SIGMA**2 / len(t), rel=1e-4)


def test_what_is_active_is_told_by_name_and_what_may_be_is_too(samples):
    t, y = samples
    free = solved_slope(y, t)
    told = {}
    for word, upper in (("on", free - 0.1), ("tie", free), ("off", free + 0.1)):
        kkt = kkt_system_of(*fit(y, t, upper=upper))
        told[word] = kkt.active["bounds of slope"]
        told[word] = told[word], kkt.ambiguous["bounds of slope"]
        assert kkt.active["bounds of offset"] == 0
    assert told["on"] == (1, 0)
    assert told["off"] == (0, 0)
    assert told["tie"][1] == 1  # multiplier and slack both vanish: nobody can tell


def test_an_equality_counts_though_nothing_pulls_at_it():
    """y = x of residual and multiplier zero: y is known as well as x."""
    problem = Problem()
    x = problem.variable("x", 1, guess=1.0, unit="m", scale=1.0)
    y = problem.variable("y", 1, guess=1.0, unit="m", scale=1.0)
    problem.minimize("fit", lambda x: 50 * (x - 1) ** 2, x, role="likelihood")
    problem.subject_to("same", lambda x, y: y - x, x, y, lower=0, upper=0)
    solution = solve(problem)
    exact = {"x": np.ones((1, 1)), "y": np.ones((1, 1))}
    none = {name: 0 * m for name, m in solution.multipliers.items()}
    solution = replace(solution, values=exact, multipliers=none)
    kkt = kkt_system_of(problem, solution)
    assert kkt.active["same"] == 1
    C = kkt.sensitivity(np.array([0, 1]))[0]
    np.testing.assert_allclose(C[:2, :2], 0.01, rtol=1e-6)


def solved_slope(y, t):
    return fit(y, t)[1].values["slope"].item()


def test_predicted_scatter_is_the_scatter_of_repeated_experiments():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 1, 10)
    found = [solved_slope(0.5 * t + SIGMA * rng.normal(size=10), t) for _ in range(200)]
    predicted = np.sqrt(least_squares_covariance(t)[0, 0])
    # 200 draws know a standard deviation to 5 %, taken three times
    assert np.std(found) == pytest.approx(predicted, rel=0.15)


def test_a_direction_that_nothing_sees_has_a_huge_variance_and_raises_nothing():
    problem = Problem()
    a = problem.variable("a", 2, guess=0.0, unit="m", scale=1.0)
    problem.minimize("sum", lambda a: (a[0] + a[1]) ** 2, a, role="likelihood")
    C = kkt_system_of(problem, solve(problem)).marginal(np.array([0, 1]))
    assert C[0, 0] > 1e6
    assert C[0, 0] + 2 * C[0, 1] + C[1, 1] == pytest.approx(0.5, rel=1e-3)


def test_faces_that_were_never_touched_are_named():
    assert unobserved(np.array([[5, 0], [0, 0], [9, 0]]) > 0) == (
        "side x: face +x never touched",
        "side y: neither face touched",
        "side z: top never touched",
    )
    assert unobserved(np.array([[5, 3], [4, 8], [9, 4]]) > 0) == ()


def test_only_a_ground_makes_the_face_known_that_a_body_lies_on():
    """Also where it was tipped: the faces that it stood on first and lies on last."""
    tipped = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    tangent = SimpleNamespace(up=np.eye(3)[2], R_first=np.eye(3), R=tipped)
    faces = np.array([[9, 0], [9, 9], [0, 9]])
    known = known_faces(tangent, faces, grounded=True)
    assert known.all()  # z at first, +x points down in the end
    assert unobserved(known) == ()
    afloat = known_faces(tangent, faces, grounded=False)
    assert unobserved(afloat, upright=False) == (
        "side x: face +x never touched",
        "side z: face -z never touched",
    )
    assert unobserved(afloat)[1] == "side z: bottom never touched"
    assert unobserved(np.zeros((3, 2), bool))[2] == "side z: neither face touched"


def test_information_of_an_estimate_is_positive_and_covers_all_its_names(estimate):
    information = observed_information(estimate)
    assert np.linalg.eigvalsh(information.matrix).min() > 0
    assert len(information.names) == len(information.matrix)
    assert (information.sigma("side_lengths") > 0).all()
    assert np.isnan(replace(information, ground=None).sigma("rotation")[:2]).all()
    tilts = information.sigma("rotation")[:2]  # of the body on its ground
    assert np.radians(0.05) < tilts.min() < tilts.max() < np.radians(0.5)
    assert information.fixed == ("rotation x", "rotation y")
    bounds = {f"bounds of {name}" for name in ("theta", "x", "finger", "ground")}
    assert bounds < information.active.keys() == information.ambiguous.keys()
    assert information.indefinite == ()
    assert information.sigma("position")[2] == pytest.approx(
        information.sigma("side_lengths")[2] / 2
    )


def test_the_summary_says_where_the_hessian_is_not_positive_definite(estimate):
    assert "positive definite" not in estimate.summary()
    curved = replace(estimate.information, indefinite=("touch along x[2, 0]",))
    (said,) = {*replace(estimate, information=curved).remarks} - {*estimate.remarks}
    assert said.startswith("The Hessian of the objective is not positive definite")
    assert "(touch along x[2, 0])" in said


def test_an_unknown_quantity_names_the_known_ones(estimate):
    with pytest.raises(OptionError, match="side_lengths"):
        observed_information(estimate).sigma("mass")
    with pytest.raises(OptionError, match="exact"):
        observed_information(estimate, kind="guess")


def test_a_gaussian_prior_alone_gives_back_its_deviation():
    problem = Problem()
    a = problem.variable("a", 1, guess=0.0, unit="m", scale=1e-3)
    problem.minimize("prior", lambda a: ca.sumsqr(a / 0.02) / 2, a, role="prior")
    C = kkt_system_of(problem, solve(problem)).marginal(np.array([0]))
    assert np.sqrt(C.item()) == pytest.approx(0.02, rel=1e-6)


def test_jacobians_whose_product_overflows_are_refused_in_words(estimate, monkeypatch):
    k = len(estimate.information.names)
    flood = np.full((k, k), np.inf)
    there = "tactilenlp.information.comparisons.sum_of_samples"
    monkeypatch.setattr(there, lambda *_: flood)
    with pytest.raises(TactileError, match="overflows"):
        observed_information(estimate, "inverse_dynamics")
