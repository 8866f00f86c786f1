"""A term is a small function; the machine derives it once and scatters it exactly."""

import math
import os
import subprocess
import sys
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from tactilenlp import kind
from tactilenlp.codegen import compiler
from tactilenlp.errors import PageError
from tactilenlp.nlp import Problem

ROUNDING = 1e-12  # [relative] a few hundred operations of doubles
# Central differences with steps of 1e-5 of a scale: 1e-10 of truncation and 1e-11 of
# rounding, both times derivatives of order one hundred.
DIFFERENCE = 1e-7


def swing(x, x_1, x_2, pull, stiffness, d):
    """A made-up nonlinear cost of three poses, two data and two settings."""
    speed_up = x - 2 * x_1 + x_2
    return (
        stiffness * ca.sumsqr(speed_up) / (1 + ca.sumsqr(x - d))
        + ca.sin(x[0] * x_2[1] * 3) * pull
        + ca.exp(x_1[0] - x[1]) * x_2[2] ** 2
    )


def lever(theta, x, x_1):
    """Three made-up rows of a size and two poses."""
    return ca.vertcat(
        theta[0] * ca.cos(x[2]) + theta[1] * x_1[1] ** 2,
        ca.dot(x, x_1) * theta[1],
        x[0] * x_1[2] - theta[0] ** 3,
    )


def merged():
    """Make a problem in which one instance reads the same pose twice, and thrice."""
    rng = np.random.default_rng(1)
    problem = Problem()
    theta = problem.variable("theta", 2, guess=[0.3, 0.7], unit="m", scale=[0.1, 2.0])
    x = problem.variable(
        "x", 3, 4, guess=rng.normal(size=(3, 4)), unit="m", scale=[1.0, 0.5, 3.0]
    )
    stiffness = problem.parameter("stiffness", 2.5, "N/m")
    target = problem.parameter("target", [0.1, -0.2, 0.3], "m")
    now, before, before_2 = np.array([[1, 0, 0], [2, 1, 1], [3, 3, 3], [3, 1, 0]]).T
    pull = rng.normal(size=4)
    problem.minimize(
        "swing", swing, x[:, now], x[:, before], x[:, before_2], pull, stiffness,
        target, role="physics",
    )  # fmt: skip
    problem.minimize(
        "size", lambda theta: ca.sumsqr(theta - 1) ** 2, theta, role="prior"
    )
    problem.subject_to(
        "lever",
        lever,
        theta,
        x[:, [2, 1, 1]],
        x[:, [2, 2, 0]],
        lower=[-1, 0, 0],
        upper=1,
    )
    problem.subject_to("sum", lambda x: ca.sum1(x), x[:, 1:3], lower=0, upper=0)
    return problem


def differences(function, x, width=1e-5):
    """Return central differences of a vector function, (rows, unknowns)."""
    steps = width * np.eye(len(x))
    return np.stack(
        [(function(x + s) - function(x - s)) / (2 * width) for s in steps], 1
    )


# Derivatives


def test_merged_poses_give_the_right_gradient_jacobian_and_hessian():
    problem = merged()
    f, data = problem.functions, problem.data()
    rng = np.random.default_rng(2)
    x, lam = rng.normal(size=problem.size), rng.normal(size=problem.rows)

    def cost(x):
        si = problem.unpack(x * problem.scale)
        theta, poses = si["theta"][:, 0], si["x"]
        total = np.sum((theta - 1) ** 2) ** 2
        pull = data[problem.costs["swing"].data[:, 0]]
        for k, poses_of in enumerate([(1, 0, 0), (2, 1, 1), (3, 3, 3), (3, 1, 0)]):
            row = swing(*(ca.DM(poses[:, c]) for c in poses_of), pull[k], 2.5,
                        ca.DM([0.1, -0.2, 0.3]))  # fmt: skip
            total += float(row)
        return np.array([total])

    def lagrangian_slope(x):
        slope = np.asarray(f["grad_f"](x, data)[1]).ravel()
        return slope + np.asarray(f["jac_g"](x, data)[1]).T @ lam

    value, gradient = f["grad_f"](x, data)
    assert float(value) == pytest.approx(cost(x)[0], rel=ROUNDING)
    np.testing.assert_allclose(
        np.asarray(gradient).T, differences(cost, x), atol=DIFFERENCE * 100
    )
    jacobian = np.asarray(f["jac_g"](x, data)[1])
    numeric = differences(lambda x: np.asarray(f["jac_g"](x, data)[0]).ravel(), x)
    np.testing.assert_allclose(jacobian, numeric, atol=DIFFERENCE * 100)
    upper = np.asarray(f["hess_lag"](x, data, 1.0, lam))
    assert not np.tril(upper, -1).any()
    numeric = differences(lagrangian_slope, x)
    np.testing.assert_allclose(
        upper + np.triu(upper, 1).T, numeric, atol=DIFFERENCE * np.abs(numeric).max()
    )


def test_named_derivatives_in_si_add_up_to_the_assembled_ones():
    problem = merged()
    f, data, s = problem.functions, problem.data(), problem.scale
    rng = np.random.default_rng(3)
    x, lam = rng.normal(size=problem.size), rng.normal(size=problem.rows)
    si = x * s
    gradient = sum(problem.jacobian(n, si, data).sum(axis=0) for n in problem.costs)
    jacobian = np.vstack(
        [problem.jacobian(n, si, data).toarray() for n in problem.constraints]
    )
    hessian = sum(problem.hessian(n, si, data) for n in problem.costs)
    for name, term in problem.constraints.items():
        hessian = hessian + problem.hessian(name, si, data, lam[term.span])
    upper = np.triu(hessian.toarray() * np.outer(s, s))
    tight = {"rtol": ROUNDING, "atol": ROUNDING}
    np.testing.assert_allclose(
        np.asarray(f["grad_f"](x, data)[1]).ravel(), np.ravel(gradient) * s, **tight
    )
    np.testing.assert_allclose(f["jac_g"](x, data)[1], jacobian * s, **tight)
    np.testing.assert_allclose(f["hess_lag"](x, data, 1, lam), upper, **tight)


def test_an_unknown_that_no_cost_reads_has_zero_slope_for_the_solver_too():
    problem = Problem()
    x = problem.variable("x", 2, 3, guess=1.0, unit="m", scale=1)
    problem.minimize("last", lambda x: x[1] ** 2, x[:, [2]], role="prior")
    problem.subject_to("all", lambda x: ca.sum1(x), x, lower=0)
    gradient = problem.functions["grad_f"](np.ones(6), problem.data())[1]
    # The solver's interface copies nonzeros one after the other: all must be there.
    assert gradient.sparsity().is_dense()
    assert np.asarray(gradient).ravel().tolist() == [0, 0, 0, 0, 0, 2]


def test_a_parameter_changes_the_programme_without_building_it_anew():
    problem = merged()
    built, x = problem.functions, problem.pack({})
    soft, stiff = problem.data({"stiffness": 1.0}), problem.data({"stiffness": 3.0})
    costs = [problem.value("swing", x, d).sum() for d in (soft, problem.data(), stiff)]
    # The cost is linear in the stiffness, whose declared value, 2.5, stays as it was.
    assert costs[1] == pytest.approx(costs[0] + 0.75 * (costs[2] - costs[0]), rel=1e-12)
    assert problem.functions is built
    values = [float(built["grad_f"](x / problem.scale, d)[0]) for d in (soft, stiff)]
    assert values[1] - values[0] == pytest.approx(costs[2] - costs[0], rel=1e-12)


def test_compiled_kinds_and_the_virtual_machine_give_the_same_digits(request):
    if compiler() is None:
        pytest.skip("no C compiler here")
    fast = merged()
    request.getfixturevalue("interpreted")
    plain = merged()
    x, data = fast.pack({}), fast.data()
    assert fast.costs["swing"].kind.value.class_name() == "External"
    assert plain.costs["swing"].kind.value.class_name() == "SXFunction"
    for name in fast.terms:
        for of in ("value", "jacobian", "hessian"):
            a, b = (getattr(problem, of)(name, x, data) for problem in (fast, plain))
            np.testing.assert_array_equal(*(getattr(m, "data", m) for m in (a, b)))


def test_without_a_compiler_the_same_solution_comes_out():
    script = """
import casadi as ca
from tactilenlp.codegen import compiler
from tactilenlp.nlp import Problem
from tactilenlp.solve import solve
problem = Problem()
x = problem.variable("x", 2, guess=[-1.2, 1], unit="1", scale=1)
banana = lambda x: 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2 + ca.sin(x[1])
problem.minimize("banana", banana, x, role="prior")
print(compiler() is None, solve(problem).values["x"].ravel().tolist())
"""
    answers = []
    for switch in ("0", "1"):
        run = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True,
            env={**os.environ, "TACTILENLP_COMPILE": switch},
        )  # fmt: skip
        answers.append(run.stdout.strip().splitlines()[-1].split(" ", 1))
    assert answers[0][0] == "True"
    assert answers[0][1] == answers[1][1]


# Kinds


@pytest.fixture
def derivations(monkeypatch, interpreted):
    """Count derivations, with nothing derived so far."""
    done, derive = [], kind._derive
    monkeypatch.setattr(
        kind, "_derive", lambda traced: done.append(1) or derive(traced)
    )
    return done


def fit(problem, name, function, columns=3):
    x = problem.variable(f"x {name}", 2, columns, guess=1.0, unit="m", scale=1)
    problem.minimize(name, function, x, np.arange(columns), role="prior")
    return problem.costs[name].kind


def test_a_function_is_derived_once_however_often_and_wide_it_is_used(derivations):
    problem = Problem()
    first = fit(problem, "a", lambda x, d: x[0] ** 3 * d)
    again = fit(problem, "b", lambda y, e: y[0] ** 3 * e, columns=200)
    other = fit(Problem(), "a", lambda x, d: x[0] ** 3 * d)
    assert first is again is other
    assert len(derivations) == 1


def test_a_kind_is_derived_once_on_a_machine(monkeypatch, tmp_path):
    if compiler() is None:
        pytest.skip("no C compiler here")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    done, derive, found = [], kind._derive, []
    monkeypatch.setattr(
        kind, "_derive", lambda traced: done.append(1) or derive(traced)
    )
    for _ in range(2):  # two processes, as far as the kinds can tell
        monkeypatch.setattr(kind, "_cache", {})
        problem = Problem()
        fit(problem, "a", lambda x, d: x[0] ** 3 * d)
        found.append(problem)
    assert len(done) == 1
    kinds = [problem.costs["a"].kind for problem in found]
    assert kinds[0].jacobian_sparsity == kinds[1].jacobian_sparsity
    assert kinds[0].hessian_sparsity == kinds[1].hessian_sparsity
    x, data = found[0].pack({}), found[0].data()
    slopes = [problem.jacobian("a", x, data).toarray() for problem in found]
    np.testing.assert_array_equal(*slopes)
    library = next(tmp_path.rglob("*.so"))
    spoilt = tmp_path / "spoilt" / "tactilenlp" / library.name
    spoilt.parent.mkdir(parents=True)
    spoilt.write_bytes(b"no library")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "spoilt"))
    monkeypatch.setattr(kind, "_cache", {})
    fit(Problem(), "a", lambda x, d: x[0] ** 3 * d)
    assert len(done) == 2


def test_an_edited_function_is_derived_anew(derivations):
    problem, power = Problem(), 3
    first = fit(problem, "a", lambda x, d: x[0] ** power * d)
    power = 4  # the same source: what counts is the expression
    edited = fit(problem, "b", lambda x, d: x[0] ** power * d)
    assert first is not edited
    assert len(derivations) == 2
    x, data = problem.pack({}), problem.data()
    slopes = [problem.jacobian(n, x, data)[2].max() for n in ("a", "b")]
    assert slopes == [6.0, 8.0]  # 2 x^3 and 2 x^4 at x = 1


def test_terms_over_nothing_cost_nothing(derivations):
    problem = Problem()
    x = problem.variable("x", 2, 5, guess=0, unit="m", scale=1)
    none = np.zeros((0, 3))
    problem.minimize(
        "far", lambda x, d: ca.sumsqr(x) * d[0], x[:, []], none, role="prior"
    )
    problem.subject_to("gap", lambda x: x, x[:, np.zeros(0, int)], lower=0)
    assert problem.terms == {}
    assert problem.rows == len(derivations) == 0


# Names and vectors


def test_unknowns_are_ordered_by_column_and_survive_a_round_trip():
    problem = merged()
    x = np.arange(problem.size, dtype=float)
    values = problem.unpack(x)
    assert values["x"][:, 0].tolist() == [2, 3, 4]
    np.testing.assert_array_equal(problem.pack(values), x)


def test_what_is_reported_can_be_read_and_costs_nothing():
    problem = merged()
    x = problem.variables["x"]
    before = problem.functions["grad_f"](np.ones(problem.size), problem.data())[0]
    problem.report("doubled", lambda x: 2 * x, x[:, [3]])
    after = problem.functions["grad_f"](np.ones(problem.size), problem.data())[0]
    got = problem.value("doubled", problem.pack({}), problem.data())
    np.testing.assert_array_equal(got, 2 * x.guess[:, [3]].T)
    assert float(before) == float(after)
    assert "doubled" not in problem.terms


def declare(problem):
    return problem.variable("y", 2, 3, guess=0, unit="m", scale=1)


@pytest.mark.parametrize(
    ("mistake", "says"),
    [
        (lambda p: p.variable("x", 3, guess=0, unit="m", scale=1), "x: declared twice"),
        (lambda p: p.parameter("target", 0), "target: declared twice"),
        (
            lambda p: p.minimize("lever", ca.sumsqr, declare(p), role="prior"),
            "lever: declared twice",
        ),
        (
            lambda p: p.variable("z", 3, guess=[0, 1], unit="m", scale=1),
            r"z: wrong shape: expected \(3, 1\), got \(2,\)",
        ),
        (
            lambda p: p.variable("z", 3, guess=0, unit="m", scale=[1, 1]),
            "z: wrong shape",
        ),
        (lambda p: p.variable("z", 3, guess=0, unit="m", scale=0), "z: not a scale"),
        (
            lambda p: p.variable("z", 3, guess=0, lower=1, upper=0, unit="m", scale=1),
            "z: bounds cross",
        ),
        (lambda p: p.variable("z", 1, guess=np.nan, unit="m", scale=1), "not finite"),
        (lambda p: declare(p)[0, 1], "y: only whole columns"),
        (lambda p: declare(p)[1], "y: only whole columns"),
        (lambda p: declare(p)[:, 3], "y: no such columns"),
        (
            lambda p: p.minimize("a", ca.sumsqr, declare(p), role="weight"),
            "a: unknown role: expected one of .*likelihood.* got weight",
        ),
        (
            lambda p: p.minimize("a", lambda y: y, declare(p), role="prior"),
            "a: a cost is one number: expected 1 row, got 2",
        ),
        (
            lambda p: p.minimize("a", lambda y: max(y[0], 0), declare(p), role="prior"),
            "a: the term's function cannot be traced.*pure CasADi",
        ),
        (
            lambda p: p.minimize("a", lambda y, z: y, declare(p), role="prior"),
            "a: the term's function cannot be traced.*missing 1 required",
        ),
        (
            lambda p: p.subject_to("a", ca.dot, declare(p), np.ones((4, 2))),
            r"a: arguments disagree on the number of instances: got \[3, 4\]",
        ),
        (
            lambda p: p.subject_to("a", ca.dot, declare(p), np.ones((3, 2, 2))),
            r"a: not data.*flatten matrices",
        ),
        (
            lambda p: p.subject_to("a", ca.dot, declare(p), np.full((3, 2), np.nan)),
            "a: not data.*6 NaN",
        ),
        (
            lambda p: p.subject_to("a", lambda y: y, declare(p), lower=[0, 0, 0]),
            r"a: wrong shape of a limit: expected \(3, 2\), got \(3,\)",
        ),
        (
            lambda p: p.subject_to("a", lambda y: y, declare(p), lower=1, upper=0),
            "a: limits cross",
        ),
        (
            lambda p: p.subject_to("a", lambda y: y, declare(Problem())),
            "a: y belongs to another problem",
        ),
        (
            lambda p: p.data({"stifness": 1}),
            r"stifness: no such parameter.*'stiffness'",
        ),
        (
            lambda p: p.data({"target": [1, 2]}),
            "target: not a value.*expected 3 numbers",
        ),
        (lambda p: p.data({"target": np.nan}), "target: not a value"),
        (lambda p: p.pack({"thata": 1}), "thata: no such variable.*'theta'"),
        (
            lambda p: p.pack({"x": np.ones((4, 3))}),
            r"x: wrong shape: expected \(3, 4\)",
        ),
    ],
)
def test_a_mistake_on_a_page_is_answered_with_its_name(mistake, says):
    with pytest.raises(PageError, match=says):
        mistake(merged())


# Before any solve


def test_a_description_names_sizes_units_terms_and_nonzeros():
    problem = merged()
    text, f = problem.describe(), problem.functions
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


@pytest.mark.parametrize("which", ["first", "second"])
def test_a_wrong_derivative_is_found_and_named(which):
    problem = merged()
    term = problem.constraints["lever"]
    right = getattr(term.kind, which)
    symbols = [ca.MX.sym("s", *right.size_in(i)) for i in range(right.n_in())]
    out = right.call(symbols)
    wrong = ca.Function("wrong", symbols, [*out[:-1], out[-1] * 1.01])
    falsified = replace(term.kind, **{which: wrong})
    problem.constraints["lever"] = replace(term, kind=falsified)
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


def test_columns_that_no_instance_reads_have_indices_all_the_same():
    x = Problem().variable("x", 3, 5, guess=0.0, unit="m", scale=1.0)
    assert x[:, []].indices.shape == (0, 3)
    assert x[:, np.zeros((0, 2), int)].indices.shape == (0, 6)
