"""A problem is described and examined before any solve."""

import math
from dataclasses import replace

import casadi as ca
import pytest
from made_up import merged

from tactilenlp.nlp.problem import Problem


def test_a_description_names_sizes_units_terms_and_nonzeros():
    problem = merged()
    text, f = problem.describe(), problem.assembly.functions
    assert f"{problem.size} unknowns, {problem.rows} constraint rows" in text
    assert f"Jacobian {f['jac_g'].nnz_out(1)}," in text
    assert f"Hessian {f['hess_lag'].nnz_out(0)}\n" in text
    lines = {line.split("  ")[1]: line for line in text.splitlines() if line[0] == " "}
    assert "3 x 4     [m]" in lines["x"]
    assert "4 x 1 row(s) of 9 unknowns, 5 data  physics" in lines["swing"]
    assert "3 x 3 row(s) of 8 unknowns, 0 data" in lines["lever"]
    assert "2.5 [N/m]" in lines["stiffness"]


def test_a_good_problem_passes_its_check():
    report = merged().check()
    assert report.good, str(report)
    assert str(report).endswith("all good")
    # `sum` and two rows of `lever` at the same poses: 11 rows of 14 unknowns.
    assert (report.rank, report.rows, report.equality_rank) == (11, 11, 2)
    assert max(max(both) for both in report.derivatives.values()) < 1e-7
    assert report.assembled < 1e-7


def test_a_term_that_is_flat_where_it_is_examined_is_not_called_good():
    problem = Problem()
    x = problem.variable("x", 1, guess=0.0, unit="m", scale=1.0)
    problem.minimize("near", lambda x: x**2, x, role="prior")
    problem.minimize("far", lambda x: 7 - ca.exp(-((x - 40) ** 2)), x, role="prior")
    report = problem.check()
    assert report.flat == ("far",)
    assert report.good
    assert not str(report).endswith("all good")
    assert problem.check({"x": 39.5}).flat == ()


@pytest.mark.parametrize("which", ["first", "second"])
def test_a_wrong_derivative_is_found_and_named(which):
    problem = merged()
    term = problem.constraints["lever"]
    parts, place = [*term.function.compiled()], {"first": 1, "second": 2}[which]
    right = parts[place]
    symbols = [ca.MX.sym("s", *right.size_in(i)) for i in range(right.n_in())]
    out = right.call(symbols)
    wrong = ca.Function("wrong", symbols, [*out[:-1], out[-1] * 1.01])
    parts[place] = wrong
    falsified = replace(term.function, compiled=lambda: parts)
    problem.constraints["lever"] = replace(term, function=falsified)
    report = problem.check()
    word = {"first": "Jacobian", "second": "Hessian"}[which]
    assert any(f'the {word} of "lever" is off' in line for line in report.findings)
    assert not any('"swing"' in line for line in report.findings)


def test_what_is_not_finite_at_the_guess_is_found():
    problem = Problem()
    x = problem.variable("x", 2, 3, guess=0, unit="m", scale=1)
    problem.minimize("length", ca.norm_2, x, role="prior")
    problem.minimize("log", lambda x: ca.log(x[0] + 1e-9), x, role="prior")
    problem.minimize("sine", lambda x: math.sin(x[0]), x, role="prior")
    findings = "\n".join(problem.check().findings)
    assert '"sine" is not finite at the guess' in findings  # not CasADi's sine: NaN
    assert '"length" has 3 finite values at the guess but no derivatives' in findings
    assert '"log" or a derivative of it is not finite near the guess' in findings


def test_a_constraint_without_numbers_hides_no_curvature_of_the_costs():
    problem = Problem()
    x = problem.variable("x", 2, guess=-1.0, unit="m", scale=1)
    problem.minimize("distance", lambda x: ca.sumsqr(x - 1), x, role="prior")
    problem.subject_to("root", lambda x: ca.sqrt(x[0]), x, lower=0.0)
    assert problem.check().curvature["x"] == pytest.approx((2.0, 2.0))


def test_a_bad_scale_is_named_with_its_remedy():
    problem = Problem()
    x = problem.variable("x", 1, guess=0.1, unit="m", scale=1)
    y = problem.variable("y", 1, guess=0.1, unit="m", scale=1)
    problem.minimize("millimetres", lambda x: (1e6 * x) ** 2 / 2, x, role="prior")
    problem.minimize("metres", lambda y: y**2 / 2, y, role="prior")
    problem.subject_to("weak", lambda y: 1e-6 * y, y, lower=0)
    findings = problem.check().findings
    assert len(findings) == 2
    assert "x is badly scaled" in findings[0]
    assert "1.0e+06-fold" in findings[0]
    assert '"weak" is badly scaled' in findings[1]


def test_equalities_that_say_the_same_twice_are_named():
    problem = Problem()
    x = problem.variable("x", 3, guess=1.0, unit="m", scale=1)
    problem.subject_to("sum", lambda x: ca.sum1(x), x, lower=1, upper=1)
    problem.subject_to("first", lambda x: x[0] ** 2, x, lower=1, upper=1)
    problem.subject_to("twice", lambda x: 2 * ca.sum1(x), x, lower=2, upper=2)
    problem.subject_to("room", lambda x: ca.sum1(x), x, upper=3)
    report = problem.check()
    assert (report.rank, report.rows) == (2, 4)
    assert (report.equality_rank, report.equalities) == (2, 3)
    assert "equalities depend on each other" in report.findings[0]
    assert "twice" in report.findings[0] or "sum" in report.findings[0]


def test_unknowns_and_parameters_that_no_term_reads_are_named():
    problem = Problem()
    x = problem.variable("x", 2, 3, guess=1.0, unit="m", scale=1)
    problem.variable("y", 1, 2, guess=1.0, unit="m", scale=1)
    problem.parameter("weight", 1.0)
    problem.minimize("a", lambda x: x[0] ** 2, x[:, :2], role="prior")
    assert problem.check().unused == ("x (4 of 6, first [1, 0])", "y", "weight")


def test_a_check_is_the_same_for_the_same_seed():
    assert str(merged().check(seed=5)) == str(merged().check(seed=5))
