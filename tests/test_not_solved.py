"""What cannot be solved is said loudly, by name."""

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from swing_up import (
    STEPS,
    decay,
    pendulum,
    stationarity,
)

from tactilenlp.errors import NotConverged, OptionError, PageError
from tactilenlp.nlp.problem import Problem
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solution import violation_in_words
from tactilenlp.solvers.solve import solve


def impossible():
    problem = Problem()
    x = problem.variable("x", 1, guess=0.0, unit="m", scale=1)
    problem.minimize("small", lambda x: x**2, x, role="prior")
    problem.subject_to("above the table", lambda x: x, x, lower=3.0)
    problem.subject_to("below the lamp", lambda x: x, x, upper=1.0)
    problem.subject_to("anywhere", lambda x: x, x, lower=-9.0)
    return problem


def test_an_infeasible_problem_names_its_worst_terms_and_carries_them():
    problem = impossible()
    with pytest.raises(NotConverged, match="Infeasible") as caught:
        solve(problem)
    error = caught.value
    assert "above the table by" in error.got
    assert "below the lamp by" in error.got
    for name in problem.terms:
        assert name in error.problem
    violations = error.solution.violations
    # Two metres apart, shared between the two however the solver likes.
    assert violations["above the table"] + violations["below the lamp"] >= 2.0 - 1e-6
    assert violations["anywhere"] == 0.0


def test_the_largest_violation_is_told_with_the_name_of_its_constraint():
    solution = solve(impossible(), throw=False)
    worst = max(solution.violations, key=solution.violations.get)
    words = violation_in_words(solution.violations)
    assert repr(worst) in words
    assert f"{solution.violations[worst]:.1g} (dimensionless)" in words
    assert violation_in_words({"anywhere": 0.0}) == "no constraint is violated"
    assert violation_in_words({}) == "no constraint is violated"


def test_the_error_survives_a_journey_between_processes():
    with pytest.raises(NotConverged) as caught:
        solve(impossible())
    error = pickle.loads(pickle.dumps(caught.value))
    assert str(error) == str(caught.value)
    assert error.solution.violations == caught.value.solution.violations
    np.testing.assert_array_equal(
        error.solution.values["x"], caught.value.solution.values["x"]
    )


def test_without_throw_the_result_comes_back_marked():
    solution = solve(impossible(), throw=False)
    assert not solution.success
    assert "Infeasible" in solution.status


def test_a_time_limit_ends_with_the_iterate_reached_and_says_so():
    problem, hurry = pendulum(), SolverOptions(time_limit=1e-6)
    solution = solve(problem, hurry, throw=False)
    assert not solution.success
    assert solution.status == "Maximum_WallTime_Exceeded"
    assert np.isfinite(solution.objective)
    assert solution.values["state"].shape == (2, STEPS + 1)
    with pytest.raises(NotConverged, match="WallTime") as caught:
        solve(problem, hurry)
    assert caught.value.solution.violations.keys() == problem.constraints.keys()


@pytest.mark.parametrize("missing", ["mumsp", "ma27", "ma97", 3])
def test_a_linear_solver_that_is_not_there_is_refused_before_a_solve(missing):
    """Some builds of IPOPT would end the process, others name none of those here."""
    with pytest.raises(OptionError, match="'mumps', 'spral'"):
        SolverOptions(ipopt={"linear_solver": missing})
    with pytest.raises(OptionError, match="did you mean 'mumps'"):
        SolverOptions(ipopt={"linear_solver": "mumsp"})


def test_an_option_that_ipopt_refuses_does_not_pass_silently():
    problem, _, _ = decay()
    missing = SolverOptions(ipopt={"nlp_scaling_method": "equilibration-based"})
    with pytest.raises(NotConverged, match="Invalid_Option after 0 iterations"):
        solve(problem, missing)
    solution = solve(problem, missing, throw=False)
    assert not solution.success
    assert solution.iterations == 0
    np.testing.assert_array_equal(solution.values["c"][:, 0], [1, 1, 0])


def test_a_function_that_leaves_the_numbers_does_not_pass_silently():
    problem = Problem()
    x = problem.variable("x", 1, guess=-1.0, unit="m", scale=1)
    problem.minimize("root", lambda x: ca.sqrt(x) + x**2, x, role="prior")
    with pytest.raises(NotConverged, match="Invalid_Number"):
        solve(problem)


@pytest.mark.parametrize(
    ("option", "value"),
    [("tolerance", 0.0), ("time_limit", -1.0), ("iterations", 0), ("push", np.nan)],
)
def test_an_option_out_of_range_is_named(option, value):
    with pytest.raises(OptionError, match=f"{option}: out of range"):
        replace(SolverOptions(), **{option: value})


def test_an_unknown_start_fixed_name_or_parameter_is_named():
    problem = pendulum()
    with pytest.raises(PageError, match="angle: no such variable"):
        solve(problem, start={"angle": 0.0})
    with pytest.raises(PageError, match="angle: no such variable"):
        solve(problem, fixed=("angle",))
    with pytest.raises(PageError, match="step: no such parameter"):
        solve(problem, parameters={"step": 0.0})


def test_a_success_that_violates_constraints_is_none():
    """IPOPT with loose tolerances of one's own accepts what does not hold."""
    names = "tol", "constr_viol_tol", "dual_inf_tol", "compl_inf_tol"
    loose = dict.fromkeys(names, 1e6)
    solution = solve(pendulum(), SolverOptions(ipopt=loose), throw=False)
    assert solution.violations["dynamics"] > 1e-4
    assert not solution.success
    assert solution.status == "Constraints_Violated"


def test_a_claimed_success_that_is_no_optimum_is_rejected():
    """What a solver says of its own convergence is compared with the programme."""
    problem, _, _ = decay()

    class Hasty:
        def __call__(self, x0, **_):
            return {"x": x0, "lam_x": 0 * x0, "lam_g": np.zeros(0)}

        def stats(self):
            return {"success": True, "return_status": "Solved", "iter_count": 0}

    solution = solve(problem, solver=Hasty(), throw=False)
    slope = np.abs(stationarity(problem, solution)).max()
    assert solution.stationarity == pytest.approx(slope)
    assert slope > 1
    assert not solution.success
    assert solution.status == "Optimality_Conditions_Violated"


def test_an_equation_that_holds_is_no_lack_of_complementarity():
    """Multipliers of 1e7 times residuals of 1e-9 are no distance from a limit."""
    for start in np.random.default_rng(0).normal(size=(25, 2, 1)):
        problem = Problem()
        x = problem.variable("x", 2, guess=start, unit="m", scale=1)
        problem.minimize(
            "pull", lambda x: 1e7 * ca.sumsqr(x - ca.DM([3, 1])), x, role="prior"
        )
        problem.subject_to("circle", lambda x: ca.sumsqr(x), x, lower=1, upper=1)
        solution = solve(problem)
        assert solution.violations["circle"] < 1e-8
        assert solution.complementarity == 0.0
