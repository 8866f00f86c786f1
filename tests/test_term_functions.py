"""A term function is derived once on a machine; compiled or not, its digits agree."""

import os
import pickle
import subprocess
import sys
from contextlib import nullcontext

import casadi as ca
import numpy as np
import pytest
from made_up import merged

from formulations.implicit import are_noted, noting_roots, root
from tactilenlp.nlp.codegen import compiler
from tactilenlp.nlp.problem import Problem
from tactilenlp.nlp.term_functions import TermFunctionCache


def fit(problem, name, function, columns=3):
    x = problem.variable(f"x {name}", 2, columns, guess=1.0, unit="m", scale=1)
    problem.minimize(name, function, x, np.arange(columns), role="prior")
    return problem.costs[name].function


def test_a_function_is_derived_once_however_often_and_wide_it_is_used(interpreted):
    problem = Problem()
    first = fit(problem, "a", lambda x, d: x[0] ** 3 * d)
    again = fit(problem, "b", lambda y, e: y[0] ** 3 * e, columns=200)
    other = fit(Problem(), "a", lambda x, d: x[0] ** 3 * d)
    assert first is again is other
    assert interpreted.derived == 1


def test_a_term_function_is_derived_once_on_a_machine(monkeypatch, tmp_path):
    if compiler() is None:
        pytest.skip("no C compiler here")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    caches = TermFunctionCache(), TermFunctionCache()  # as of two processes
    found = [Problem(cache=cache) for cache in caches]
    for problem in found:
        assert fit(problem, "a", lambda x, d: x[0] ** 3 * d).part("first").n_out() == 2
    assert [cache.derived for cache in caches] == [1, 0]
    assert caches[0].seconds > 0 == caches[1].seconds
    functions = [problem.costs["a"].function for problem in found]
    assert functions[0].jacobian_sparsity == functions[1].jacobian_sparsity
    assert functions[0].hessian_sparsity == functions[1].hessian_sparsity
    x, data = found[0].pack({}), found[0].data()
    slopes = [problem.jacobian("a", x, data).toarray() for problem in found]
    np.testing.assert_array_equal(*slopes)
    library = next(tmp_path.rglob("*.so"))
    spoilt = tmp_path / "spoilt" / "tactilenlp" / library.name
    spoilt.parent.mkdir(parents=True)
    spoilt.write_bytes(b"no library")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "spoilt"))
    cache = TermFunctionCache()
    fit(Problem(cache=cache), "a", lambda x, d: x[0] ** 3 * d)
    assert cache.derived == 1


def test_a_cache_stays_in_its_process(interpreted):
    assert TermFunctionCache() is not interpreted
    assert pickle.loads(pickle.dumps(TermFunctionCache())) is interpreted


def test_an_edited_function_is_derived_anew(interpreted):
    problem, power = Problem(), 3
    first = fit(problem, "a", lambda x, d: x[0] ** power * d)
    power = 4  # the same source: what counts is the expression
    edited = fit(problem, "b", lambda x, d: x[0] ** power * d)
    assert first is not edited
    assert interpreted.derived == 2
    x, data = problem.pack({}), problem.data()
    slopes = [problem.jacobian(n, x, data)[2].max() for n in ("a", "b")]
    assert slopes == [6.0, 8.0]  # 2 x^3 and 2 x^4 at x = 1


def test_terms_over_nothing_cost_nothing(interpreted):
    problem = Problem()
    x = problem.variable("x", 2, 5, guess=0, unit="m", scale=1)
    none = np.zeros((0, 3))
    problem.minimize(
        "far", lambda x, d: ca.sumsqr(x) * d[0], x[:, []], none, role="prior"
    )
    problem.subject_to("gap", lambda x: x, x[:, np.zeros(0, int)], lower=0)
    assert problem.terms == {}
    assert problem.rows == interpreted.derived == 0


def test_compiled_term_functions_and_the_virtual_machine_give_the_same_digits(request):
    if compiler() is None:
        pytest.skip("no C compiler here")
    fast = merged()
    request.getfixturevalue("interpreted")
    plain = merged()
    x, data = fast.pack({}), fast.data()
    assert fast.costs["swing"].function.part("first").class_name() == "External"
    assert plain.costs["swing"].function.part("first").class_name() == "SXFunction"
    for name in fast.terms:
        for of in ("value", "jacobian", "hessian"):
            a, b = (getattr(problem, of)(name, x, data) for problem in (fast, plain))
            np.testing.assert_array_equal(*(getattr(m, "data", m) for m in (a, b)))


def test_without_a_compiler_the_same_solution_comes_out():
    script = """
import casadi as ca
from tactilenlp.nlp.codegen import compiler
from tactilenlp.nlp.problem import Problem
from tactilenlp.solvers.solve import solve
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


def test_a_root_is_differentiated_by_the_implicit_function_theorem(interpreted):
    def cube_root(z, d):
        """Return z0 + u^2 with u^3 + u = z1 d, by noted roots and written out."""
        a = ca.SX.sym("a")
        u = a
        for _ in range(60):
            u = u - (u**3 + u - a) / (3 * u**2 + 1)
        solver = ca.Function("solver", [a], [u])
        if are_noted():
            u = root(lambda u: u**3 + u - z[1] * d, solver, z[1] * d)
        else:
            u = solver(z[1] * d)
        return z[0] + u**2 + ca.sin(u) * z[0]

    derived = [
        fit(Problem(noting=noting), "a", cube_root)
        for noting in (noting_roots, nullcontext)
    ]
    assert derived[0] is not derived[1]
    z, d = np.array([[0.3], [0.7]]), np.array([[1.3]])
    for which, given in (("first", (z, d)), ("second", (z, d, np.array([[2.0]])))):
        noted, whole = (np.vstack(one.evaluated(which, *given)) for one in derived)
        assert np.allclose(noted, whole, rtol=1e-12), which
    sizes = [one.part("second").n_instructions() for one in derived]
    assert sizes[0] < sizes[1] / 3


def test_a_root_that_is_read_twice_is_one(interpreted):
    a = ca.SX.sym("a")
    same = ca.Function("solver", [a], [a])

    def twice(z, d):
        way = ca.cos(z[0]) * d
        one, again = (root(lambda u: u - way, same, ca.cos(z[0]) * d) for _ in "ab")
        return one * again + z[1]

    found = fit(Problem(noting=noting_roots), "a", twice)
    assert found.roots == 1
    value, _ = found.evaluated("first", np.array([[0.2], [1.0]]), np.array([[3.0]]))
    assert value[0, 0] == pytest.approx((3 * np.cos(0.2)) ** 2 + 1)


def test_roots_of_one_solver_and_of_several(interpreted):
    a = ca.SX.sym("a")
    same, double = (ca.Function("solver", [a], [k * a]) for k in (1, 2))

    def both(first, second):
        def term(z, d):
            one = root(lambda u: u - z[0], first, z[0])
            other = root(lambda u: u - (2 if second is double else 1) * d, second, d)
            return one**2 * other

        return term

    z = np.array([[1, 2, 3], [0, 0, 0]])
    for second, factor in ((same, 1), (double, 2)):
        found = fit(Problem(noting=noting_roots), "a", both(same, second))
        value, slopes = found.evaluated("first", z, np.array([[4, 5, 6]]))
        assert found.roots == 2
        assert value.ravel().tolist() == [4 * factor, 20 * factor, 54 * factor]
        assert slopes.ravel().tolist() == [8 * factor, 20 * factor, 36 * factor]
