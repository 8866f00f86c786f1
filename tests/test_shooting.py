"""Single and multiple shooting, complementarity: one body, three programmes."""

import importlib
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formulations import complementarity, multiple_shooting, paper, shooting
from formulations.shape import CUBOID
from tactilenlp import (
    ExpectedInformation,
    Options,
    Scene,
    Workspace,
    expected_information_gain,
    information_gain,
    solve_estimate,
)
from tactilenlp.data.sensor_noise import precision_of
from tactilenlp.errors import PageError, SceneError
from tactilenlp.information.error_budget_terms import missing_impulses
from tactilenlp.nlp.kkt import kkt_system_of
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.reductions import (
    Reductions,
    required_reductions,
    window_of_samples,
)
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import Solvers, solve, solve_levels

STEPS, DT = 20, 0.05


def braked(target):
    """Reach a target in STEPS by throwing a ball against drag, rate and size free."""
    problem = Problem()
    drag = problem.variable("drag", 1, lower=0, guess=0.5, unit="1/s", scale=0.1)
    state = problem.variable(
        "state", 2, STEPS + 1, guess=[1.0, 0.3], unit="m, m/s", scale=[0.1, 1.0]
    )
    now, before = np.arange(1, STEPS + 1), np.arange(STEPS)

    def after(drag, s):
        v = s[1] / (1 + DT * drag * ca.sqrt(1 + s[1] ** 2))
        return ca.vertcat(s[0] + DT * v, v)

    problem.follow("motion", after, drag, state[:, before], gives=state[:, now])
    problem.minimize(
        "miss", lambda s, p: (s[0] - p) ** 2 / 2e-2, state[:, now], target,
        role="likelihood",
    )  # fmt: skip
    problem.minimize("size", lambda d: (d - 1) ** 2 / 2, drag, role="prior")
    problem.subject_to("start", lambda s: s[0], state[:, 0], lower=0, upper=0.2)
    return problem


def test_elimination_ends_where_the_whole_programme_does():
    """Same optimum, same multipliers: shooting against all states as unknowns."""
    target = 0.9 * (1 - np.exp(-2 * DT * np.arange(1, STEPS + 1)))
    problem, options = braked(target), SolverOptions(tolerance=1e-9)
    whole = solve(problem, options)
    reduced = solve(problem, options, eliminate=True)
    assert len(problem.eliminated.free) == 3
    assert reduced.objective == pytest.approx(whole.objective, rel=1e-7)
    for name, value in whole.values.items():
        np.testing.assert_allclose(reduced.values[name], value, atol=1e-6)
    for name, value in whole.multipliers.items():
        np.testing.assert_allclose(reduced.multipliers[name], value, atol=1e-4)
    assert max(reduced.violations.values()) < 1e-12
    assert reduced.solver == whole.solver == "ipopt"
    for solution in (whole, reduced):  # of the whole programme, also where it follows
        assert solution.stationarity < 1e-6
        assert solution.complementarity < 1e-8


def test_the_eliminated_gradient_and_hessian_are_exact():
    problem = braked(np.linspace(0.1, 1.0, STEPS))
    functions, data = problem.eliminated.functions, problem.data()
    u, lam, h = np.array([12.0, 0.5, 1.7]), np.array([0.7]), 1e-6
    u = u[np.argsort(problem.eliminated.free)]

    def slope(u):
        out = [np.asarray(f).ravel() for f in functions["grad_f"](u, data)]
        jac = np.asarray(functions["jac_g"](u, data)[1])
        return out[0][0], out[1], out[1] + jac.T @ lam

    ways = h * np.eye(3)
    by_hand = [(slope(u + e)[0] - slope(u - e)[0]) / (2 * h) for e in ways]
    np.testing.assert_allclose(slope(u)[1], by_hand, rtol=1e-6)
    by_hand = [(slope(u + e)[2] - slope(u - e)[2]) / (2 * h) for e in ways]
    H = np.asarray(ca.DM(functions["hess_lag"](u, data, 1.0, lam)))
    H = H + np.triu(H, 1).T
    np.testing.assert_allclose(H, by_hand, rtol=1e-5, atol=1e-6 * np.abs(H).max())


def test_what_follows_from_itself_is_refused():
    problem = Problem()
    x = problem.variable("x", 1, 2, guess=0.0, unit="m", scale=1.0)
    problem.follow("forth", lambda x: 2 * x, x[:, 0], gives=x[:, 1])
    problem.follow("back", lambda x: 2 * x, x[:, 1], gives=x[:, 0])
    with pytest.raises(PageError, match="follow from each other"):
        _ = problem.eliminated
    empty = Problem()
    empty.variable("x", 1, guess=0.0, unit="m", scale=1.0)
    with pytest.raises(PageError, match="nothing to eliminate"):
        _ = empty.eliminated


@pytest.fixture(scope="module")
def begun(recorded):
    """The first two actions, and the pages' problems from a start near the truth."""
    data, scene, truth = recorded
    data = data.select([0, 1])
    T, precision = data.samples, precision_of(data, scene)
    turn = Rotation.from_quat(np.roll(truth["object_quaternion"][:T], -1, axis=1))
    yaw = np.unwrap(turn.as_euler("zyx")[:, 0])
    x = np.vstack([truth["object_position"][:T, :2].T, yaw])
    theta, x = truth["side_lengths"] * 1.03, x + np.c_[[1e-3, -1e-3, 0.03]]

    def solved(page):
        made = required_reductions(page, Reductions())
        known = (data, scene, CUBOID, precision, made)
        window, problem = window_of_samples(*known, guess=(theta, x)), Problem()
        page.build(problem, window, scene, CUBOID)
        start = {"theta": theta, "x": x[:, window.last]}
        return SimpleNamespace(
            problem=problem, window=window,
            solution=solve_levels(problem, page.LEVELS, start),
        )  # fmt: skip

    return solved


@pytest.mark.slow
def test_single_and_multiple_shooting_find_the_same_motion(begun, recorded):
    single, multiple = begun(shooting), begun(multiple_shooting)
    assert single.solution.success
    assert multiple.solution.success
    # Equal programmes: what is left is the tolerance of two solves.
    assert single.solution.objective == pytest.approx(
        multiple.solution.objective, abs=1e-3
    )
    assert single.solution.violations["motion, 2 fingers"] < 1e-9
    theta = recorded[2]["side_lengths"]
    for found in (single, multiple):
        # y and z are touched on both sides; x is the prior's yet.
        off = found.solution.values["theta"][1:, 0] - theta[1:]
        assert np.abs(off).max() < 0.5e-3


@pytest.mark.slow
def test_complementarity_is_solved_to_a_small_residual(begun):
    found = begun(complementarity)
    assert found.solution.success
    assert max(found.solution.violations.values()) < 1e-5
    problem, solution = found.problem, found.solution
    x, data = solution.at(problem)
    for name in ("finger", "ground"):
        outside = problem.value(f"{name} cone, exact", x, data).max()
        assert outside <= complementarity.APEX_ROUNDING * 1.01
    gap = problem.value("finger gap", x, data)
    assert gap.min() > -1e-6


@pytest.mark.slow
@pytest.mark.parametrize("page", [multiple_shooting, complementarity])
def test_hard_physics_are_doubted_as_much_as_penalised_ones(begun, page):
    """An impulse may be missing: it moves the last pose, not a size felt twice."""
    found = begun(page)
    kkt = kkt_system_of(found.problem, found.solution)
    sizes, x = (found.problem.variables[name].span for name in ("theta", "x"))
    chosen = np.r_[sizes.start : sizes.stop, x.stop - 3 : x.stop]
    _, by_constraint = kkt.sensitivity(chosen)
    sigma = np.sqrt(np.diag(missing_impulses(kkt, by_constraint)))
    assert 0.05e-3 < np.linalg.norm(sigma[3:5]) < 5e-3
    assert sigma[1:3].max() < 0.05e-3


EDITED = """
from formulations import multiple_shooting, shooting
from formulations.shooting import LEVELS, REDUCTIONS


def build(nlp, window, scene, shape):
    shooting.build(nlp, window, scene, shape)
    nlp.minimize(
        "flat prior", lambda theta: ((theta[0] - 0.02) / 1e-3) ** 2 / 2,
        nlp.variables["theta"], role="prior",
    )
"""


@pytest.mark.slow
def test_an_edited_equation_reaches_estimate_information_and_gain(
    recorded, tmp_path, monkeypatch
):
    """A page of a user: a narrow prior on side x, nothing else is changed."""
    (tmp_path / "my_shooting.py").write_text(EDITED)
    monkeypatch.syspath_prepend(tmp_path)
    page = importlib.import_module("my_shooting")
    data, scene, _ = recorded
    # One start: from another, side y may be the narrow one.
    lean, data = Options(hypotheses=1, starts=1), data.select([0])
    mine = solve_estimate(data, scene, formulation=page, options=lean)
    plain = solve_estimate(data, scene, formulation="shooting", options=lean)
    assert mine.side_lengths[0] == pytest.approx(0.02, abs=2e-3)
    assert abs(plain.side_lengths[0] - 0.02) > 5e-3
    assert mine.costs["flat prior"] < 1
    sigma = [e.information.sigma("side_lengths")[0] for e in (mine, plain)]
    alone = mine.information.of_hessian().sigma("side_lengths")[0]
    assert alone < 1.1e-3 < 3e-3 < sigma[1]
    assert sigma[0] < 1.2e-3
    # An action that would tell side x to a millimetre tells little that is new.
    known = [ExpectedInformation(e).beliefs[0].information for e in (mine, plain)]
    told = np.zeros_like(known[0])
    told[0, 0] = 1e6
    gains = [information_gain(k, told) for k in known]
    assert gains[0] < np.log(2) / 2 + 0.01 < 1 < gains[1]
    action = Workspace().action([0.0, 0.2, 0.3, 0.2])
    # less is left to tell of a side that the new prior knows than without its part
    found = mine.information
    prior = replace(found, matrix=found.matrix - found.part("flat prior"))
    pair = mine, replace(mine, information=prior)
    expected = [expected_information_gain(e, action) for e in pair]
    assert 0 < expected[0] < expected[1] < 100


@pytest.mark.slow
def test_the_impulses_of_shooting_balance_the_motion(recorded):
    data, scene, _ = recorded
    lean = Options(hypotheses=1, starts=2)
    e = solve_estimate(
        data.select([0]), scene, formulation="multiple_shooting", options=lean
    )
    total = sum(e.impulses.values())
    v = np.diff(e.position, axis=0) / data.dt
    change = scene.mass * np.diff(v, axis=0)
    # The ground also carries the weight.
    change[:, 2] += scene.mass * scene.gravity * data.dt
    np.testing.assert_allclose(total[2:], change, atol=1e-9)
    assert (
        np.abs(e.impulses["finger 0"]).max() + np.abs(e.impulses["finger 1"]).max()
        > 0.1 * scene.mass * scene.gravity * data.dt
    )


def test_a_page_of_planar_motion_asks_for_a_ground(recorded):
    with pytest.raises(SceneError, match="planar"):
        solve_estimate(
            recorded[0].select([0]), Scene(ground=None, gravity=0.0),
            formulation="shooting",
        )  # fmt: skip


@pytest.mark.slow
def test_the_envelope_gradient_is_that_of_the_inner_minimum(begun):
    """The paper's descent: min over impulses, then the loss's own slope there."""
    found = begun(paper)
    problem, data = found.problem, found.problem.data()
    options = SolverOptions(tolerance=1e-9, barrier=1e-3)
    start = {n: found.solution.values[n] for n in ("theta", "x", "finger", "ground")}
    # Off the optimum, where gaps are zero and min(0, phi)^2 bends.
    start["theta"] = start["theta"] + 1e-3
    solver = Solvers(problem).solver_for(options)

    def inner(start):
        return solve(
            problem, options, start=start, fixed=("theta", "x"), throw=False,
            solver=solver,
        )  # fmt: skip

    at = inner(start)
    x = problem.pack(at.values)
    slope = sum(problem.jacobian(n, x, data).sum(axis=0) for n in problem.costs)
    values = problem.unpack(np.asarray(slope).ravel())
    for name, row, column in (("theta", 1, 0), ("x", 0, 10), ("x", 2, 20)):
        h, ends = 1e-4 * problem.variables[name].scale[row], []
        for sign in (1, -1):
            moved = {n: v.copy() for n, v in at.values.items()}
            moved[name][row, column] += sign * h
            ends.append(inner(moved).objective)
        by_hand = (ends[0] - ends[1]) / (2 * h)
        largest = np.abs(values[name][row]).max()
        assert values[name][row, column] == pytest.approx(by_hand, abs=2e-3 * largest)
