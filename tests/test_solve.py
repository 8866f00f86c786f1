"""A pendulum, a fit and a cone, solved by a machine that knows none of them."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from swing_up import (
    DT,
    STEPS,
    TIGHT,
    TORQUE,
    cone,
    decay,
    faster,
    pendulum,
    stationarity,
)

from tactilenlp.errors import OptionError
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import Solvers, solve, solve_levels


def test_a_pendulum_swings_up_as_its_differential_equation_says():
    problem = pendulum()
    solution = solve(problem)
    torque = solution.values["torque"][0]
    assert np.abs(torque).max() == pytest.approx(TORQUE, rel=1e-4)  # it has to swing
    t = np.arange(STEPS + 1) * DT
    truth = solve_ivp(
        lambda s, x: [x[1], faster(x, np.interp(s, t, torque))], (0, t[-1]), [0, 0],
        t_eval=t, rtol=1e-9, atol=1e-9, max_step=DT,
    )  # fmt: skip
    # The trapezoidal rule errs by dt^2 / 12 of the third derivative: at 10 rad/s and
    # 50 rad/s^2, one hundredth of a radian a step, grown on the way up.
    np.testing.assert_allclose(solution.values["state"][0], truth.y[0], atol=0.2)
    assert solution.violations["dynamics"] < 1e-6


def test_a_fit_ends_where_another_solver_ends():
    problem, t, y = decay()
    solution = solve(problem, TIGHT)
    other = least_squares(
        lambda c: c[0] * np.exp(-c[1] * t) + c[2] - y, [1, 1, 0], xtol=1e-14, gtol=1e-14
    )
    np.testing.assert_allclose(solution.values["c"][:, 0], other.x, rtol=1e-7)
    assert solution.objective == pytest.approx(other.cost, rel=1e-9)
    assert solution.costs == {"misfit": solution.objective}


@pytest.mark.parametrize(
    ("target", "nearest"),
    [
        ([2.0, 0.3, 0.4], [2.0, 0.3, 0.4]),  # inside: stays
        ([1.0, 3.0, 4.0], [3.0, 1.8, 2.4]),  # outside: (n + t) / 2 on the cone
        ([-4.0, 0.6, 0.8], [0.0, 0.0, 0.0]),  # behind the apex
    ],
)
def test_the_nearest_force_of_a_cone_is_its_projection(target, nearest):
    problem = cone(target)
    solution = solve(problem, TIGHT)
    # The apex is rounded by a millinewton, and by 1e-3^2 / (2 * 3) on the mantle.
    np.testing.assert_allclose(solution.values["f"][:, 0], nearest, atol=1.1e-3)
    on = bool(solution.multipliers["cone"][0, 0] < -1e-3)
    assert on == (target != nearest)


# What is said of a solution is true


@pytest.mark.parametrize(
    "problem", [pendulum(), cone([1.0, 3.0, 4.0]), cone([-4.0, 0.6, 0.8])]
)
def test_the_named_multipliers_balance_the_slopes(problem):
    solution = solve(problem, TIGHT)
    slope = np.abs(stationarity(problem, solution)).max()
    assert slope < 1e-7
    assert solution.stationarity == pytest.approx(slope, abs=1e-12)
    assert solution.complementarity < 1e-6
    x, data = problem.pack(solution.values), problem.data()
    for name, term in problem.constraints.items():
        value, force = problem.value(name, x, data), solution.multipliers[name]
        slack = np.where(force > 0, term.upper - value, value - term.lower)
        slack = np.where(force == 0, 0.0, slack)  # an infinite limit pulls with zero
        assert np.abs(slack * force).max() < 1e-6
    for name, v in problem.variables.items():
        value, force = solution.values[name], solution.bound_multipliers[name]
        slack = np.where(force > 0, v.upper - value, value - v.lower)
        assert np.abs(np.where(force == 0, 0.0, slack) * force).max() < 1e-6


def test_violations_and_costs_are_recomputed_from_where_the_solver_stopped():
    problem = pendulum()
    solution = solve(problem, SolverOptions(iterations=2), throw=False)
    x, data = problem.pack(solution.values), problem.data()
    for name in problem.constraints:
        value, term = problem.value(name, x, data), problem.constraints[name]
        beyond = np.maximum(term.lower - value, value - term.upper).max()
        assert solution.violations[name] == max(0.0, beyond)
    assert solution.costs["effort"] == problem.value("effort", x, data).sum()
    assert max(solution.violations.values()) > 1e-3
    assert not solution.success


def test_the_optimum_does_not_depend_on_the_units_of_the_solver():
    one, hundred = (solve(pendulum(scale), TIGHT) for scale in (1.0, 100.0))
    assert hundred.objective == pytest.approx(one.objective, rel=1e-7)
    np.testing.assert_allclose(hundred.values["state"], one.values["state"], atol=1e-5)
    for name, force in one.multipliers.items():
        np.testing.assert_allclose(hundred.multipliers[name], force, atol=1e-4)
    np.testing.assert_allclose(
        hundred.bound_multipliers["torque"], one.bound_multipliers["torque"], atol=1e-4
    )


def test_the_same_problem_gives_the_same_solution_to_the_last_digit():
    first, again = solve(pendulum()), solve(pendulum())
    assert first.iterations == again.iterations
    for group in ("values", "multipliers", "bound_multipliers"):
        for name, value in getattr(first, group).items():
            np.testing.assert_array_equal(value, getattr(again, group)[name])


# Parameters, starts, levels


def test_one_solver_serves_every_value_of_a_parameter():
    problem = cone([2.0, 0.1, 0.0])
    solver = Solvers(problem).solver_for(TIGHT)
    for height in (2.0, 3.0):
        goal = [height, 0.1, 0.0]  # off the axis, where IPOPT creeps along the cone
        solution = solve(problem, TIGHT, parameters={"target": goal}, solver=solver)
        np.testing.assert_allclose(solution.values["f"][:, 0], goal, atol=1e-7)
        assert solution.parameters["target"].tolist() == goal


def test_with_the_torque_fixed_the_machine_simulates():
    problem, shared = pendulum(), np.linspace(0, 2, STEPS + 1)
    del problem.constraints["end"]  # the last declared: no row moves
    torque = np.sin(4 * shared)[None]
    solution = solve(problem, TIGHT, start={"torque": torque}, fixed=("torque",))
    np.testing.assert_array_equal(solution.values["torque"], torque)
    truth = solve_ivp(
        lambda s, x: [x[1], faster(x, np.sin(4 * s))], (0, 2), [0, 0],
        t_eval=shared, rtol=1e-9, atol=1e-9,
    )  # fmt: skip
    np.testing.assert_allclose(solution.values["state"][0], truth.y[0], atol=0.1)
    # What holds the torque is told as well, though IPOPT knows nothing of it.
    assert np.abs(solution.bound_multipliers["torque"]).max() > 0
    assert np.abs(stationarity(problem, solution)).max() < 1e-7


def test_a_start_outside_its_bounds_is_brought_inside():
    solution = solve(pendulum(), start={"torque": np.full((1, STEPS + 1), 50.0)})
    assert np.abs(solution.values["torque"]).max() <= TORQUE


@dataclass(frozen=True)
class Level:
    parameters: dict = field(default_factory=dict)
    fixed: tuple = ()
    eliminate: bool = False
    ipopt: dict = field(default_factory=dict)
    warm_start: dict | None = None


def first_mus(solvers) -> list[float]:
    """Return the mu_init of every solver that was built."""
    return [dict(key[:2])["mu_init"] for key in solvers.by_options]


def test_levels_start_where_the_one_before_ended_and_add_up():
    problem = cone([1.0, 3.0, 4.0])
    levels = [Level({"target": [9.0, 3.0, 4.0]}), Level(fixed=("f",)), Level()]
    solvers = Solvers(problem)
    options = SolverOptions(tolerance=1e-8)
    first = solve_levels(problem, levels[:2], {}, options, solvers)
    np.testing.assert_allclose(first.values["f"][:, 0], [9, 3, 4], atol=1e-6)
    last = solve_levels(problem, levels, {}, options, solvers)
    np.testing.assert_allclose(last.values["f"][:, 0], [3, 1.8, 2.4], atol=1e-6)
    assert sum(last.iterations_by_level) == last.iterations
    assert last.iterations_by_level[:2] == first.iterations_by_level
    assert len(first_mus(solvers)) == 1  # the same options: one solver


def test_a_level_that_takes_the_multipliers_before_it_has_less_to_do():
    problem = cone([1.0, 3.0, 4.0])
    cold = [Level(), Level(ipopt={"mu_init": 1e-5})]
    warm = [Level(), Level(warm_start={"mu_init": 1e-5})]
    ends = [solve_levels(problem, levels, {}) for levels in (cold, warm)]
    np.testing.assert_allclose(ends[0].values["f"], ends[1].values["f"], atol=1e-5)
    assert ends[1].iterations_by_level[1] < ends[0].iterations_by_level[1]
    assert ends[1].success


def test_what_a_cold_barrier_does_not_solve_is_tried_with_the_warm_one():
    problem = cone([1.0, 3.0, 4.0])
    solvers = Solvers(problem)
    stiff = {"max_iter": 2, "mu_init": 0.1}
    levels = [
        Level(ipopt={"max_iter": 1}),
        Level(ipopt=stiff, warm_start={"mu_init": 1e-5}),
    ]
    end = solve_levels(problem, levels, {}, solvers=solvers)
    assert not end.success
    assert first_mus(solvers) == [1e-2, 0.1, 1e-5]
    assert sum(end.iterations_by_level) == end.iterations == 5


def test_after_a_level_that_stopped_early_the_barrier_is_that_of_a_cold_start():
    problem = cone([1.0, 3.0, 4.0])
    for iterations, mu in ((200, 1e-5), (1, 0.1)):
        solvers = Solvers(problem)
        next_one = Level(ipopt={"mu_init": 0.1}, warm_start={"mu_init": 1e-5})
        first = Level(ipopt={"max_iter": iterations})
        end = solve_levels(problem, [first, next_one], {}, solvers=solvers)
        assert end.success
        assert first_mus(solvers) == [1e-2, mu]


def test_a_start_may_be_a_solution_of_the_same_problem():
    problem = cone([1.0, 3.0, 4.0])
    known = solve(problem)
    again = solve(problem, SolverOptions(barrier=1e-7), start=known)
    assert again.success
    assert again.iterations <= 3 < known.iterations


def test_solves_with_other_options_have_a_solver_of_their_own():
    solvers, options = Solvers(cone([1.0, 3.0, 4.0])), SolverOptions(iterations=1)
    changed = {"iterations": 2}, {"barrier": 1e-3}, {"push": 1e-2}, {"tolerance": 1e-3}
    first = solvers.solver_for(options)
    assert solvers.solver_for(replace(options)) is first
    others = {solvers.solver_for(replace(options, **change)) for change in changed}
    assert len({first, *others}) == 5


def test_options_of_a_solve_hold_for_every_level_of_a_continuation():
    problem, few = pendulum(), SolverOptions(iterations=2)
    levels = (Level({}), Level({}, ipopt={"max_iter": 100}))
    start = {name: v.guess for name, v in problem.variables.items()}
    solution = solve_levels(problem, levels, start, few)
    assert not solution.success
    assert solution.iterations == 4
    with pytest.raises(OptionError, match="iterations: wrong type"):
        SolverOptions(iterations=2.5)


def test_levels_are_no_options():
    with pytest.raises(OptionError, match="options: wrong type"):
        solve(pendulum(), (Level({}),))
