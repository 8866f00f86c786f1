"""Functions compiled for several instances at once give the digits of each alone."""

import casadi as ca
import numpy as np
import pytest

from tactilenlp.nlp.codegen import compiler, start_compilation
from tactilenlp.nlp.simd import BINARY, UNARY, WIDTH, WRITTEN, can_be_vectors
from tactilenlp.nlp.term_functions import MappedFunction

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler here")
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, np.inf, -np.inf, np.nan]


def of_columns(function, *arguments):
    """Return what a function returns for the columns of its arguments."""
    return MappedFunction(lambda: function, 1, rounded=int)(*arguments)


def operations(x, y):
    """Return expressions that use every operation there is, by its name."""
    within, positive = x / (1 + ca.fabs(x)), ca.fabs(x) + 0.1
    unary = {
        "SQRT": ca.sqrt(positive), "EXP": ca.exp(within), "LOG": ca.log(positive),
        "SIN": ca.sin(x), "COS": ca.cos(x), "TAN": ca.tan(x), "ASIN": ca.asin(within),
        "ACOS": ca.acos(within), "ATAN": ca.atan(x), "SINH": ca.sinh(within),
        "COSH": ca.cosh(within), "TANH": ca.tanh(x), "ASINH": ca.asinh(x),
        "ACOSH": ca.acosh(1 + positive), "ATANH": ca.atanh(within),
        "FLOOR": ca.floor(x), "CEIL": ca.ceil(x), "ERF": ca.erf(x),
        "LOG1P": ca.log1p(positive), "EXPM1": ca.expm1(within),
    }  # fmt: skip
    binary = {
        "POW": positive**y, "FMOD": ca.fmod(x, positive), "ATAN2": ca.atan2(x, y),
        "COPYSIGN": ca.copysign(x, y), "HYPOT": ca.hypot(x, y),
        "REMAINDER": ca.remainder(x, positive),
    }  # fmt: skip
    written = {
        "ASSIGN": x, "NEG": -x, "SQ": x * x, "TWICE": 2 * x, "INV": 1 / y, "ADD": x + y,
        "SUB": x - y, "MUL": x * y, "DIV": x / y, "LT": x < y, "LE": x <= y,
        "EQ": x == y, "NE": x != y, "NOT": ca.logic_not(x), "AND": ca.logic_and(x, y),
        "OR": ca.logic_or(x, y), "IF_ELSE_ZERO": ca.if_else(x < y, y, 0),
        "FABS": ca.fabs(x), "FMIN": ca.fmin(x, y), "FMAX": ca.fmax(x, y),
        "SIGN": ca.sign(x), "CONSTPOW": positive**2.5,
    }  # fmt: skip
    assert [*unary] == [*UNARY]
    assert {*binary} == {*BINARY}
    assert {*written} == {*WRITTEN}
    return {**unary, **binary, **written}


def test_every_operation_gives_what_the_virtual_machine_gives(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    named = operations(x, y)
    plain = ca.Function("all", [x, y], [ca.vertcat(*named.values())])
    assert can_be_vectors(plain)
    (fast,) = start_compilation([plain], vectors=True)()
    assert fast.size_in(0) == (1, WIDTH)
    left, right = np.meshgrid(SPECIAL, SPECIAL)
    drawn = np.random.default_rng(0).normal(size=(2, 35)) * 3
    given = np.hstack([[left.ravel(), right.ravel()], drawn])
    count = given.shape[1]
    assert count % WIDTH  # the last call is not full
    found, wanted = (
        of_columns(function, *given[:, None])[0] for function in (fast, plain)
    )
    for name, ours, other in zip(named, found, wanted, strict=True):
        np.testing.assert_allclose(ours, other, rtol=4e-16, err_msg=name)
        if name in WRITTEN:
            np.testing.assert_array_equal(ours, other, err_msg=name)


def test_what_cannot_be_vectors_is_compiled_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x", 2, 2)
    matrix = ca.Function("matrix", [x], [ca.sum1(x)])
    column = ca.Function("column", [x[:, 0]], [x[:1, 0] * ca.inf, ca.SX(-np.inf)])
    assert not can_be_vectors(matrix)
    wide = start_compilation([matrix, column], vectors=True)()
    assert [f.size2_in(0) for f in wide] == [2, WIDTH]
    assert wide[0](np.eye(2)).full().tolist() == [[1, 1]]
    ones, below = of_columns(wide[1], np.ones((2, 3)))
    assert ones.tolist() == [[np.inf] * 3]
    assert below.tolist() == [[-np.inf] * 3]


def test_functions_that_are_called_again_and_again_are_vectors_too(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x, a = ca.SX.sym("x", 2), ca.SX.sym("a")
    called = {"never_inline": True}
    inner = ca.Function("inner", [a, x], [ca.sin(a) * x[1], x[0] - a], called)
    step = ca.Function("step", [x, a], [ca.vertcat(*inner(a, x)) + x / 2], called)
    y = x
    for k in range(5):
        y = step(y, a / (k + 1))
    whole = ca.Function("whole", [x, a], [y, ca.sumsqr(y)])
    assert whole.n_instructions() < 50  # written out it would be more
    assert can_be_vectors(whole)
    (fast,) = start_compilation([whole], vectors=True)()
    assert fast.size2_in(0) == WIDTH
    given = np.random.default_rng(1).normal(size=(3, 11))
    for ours, other in zip(
        of_columns(fast, given[:2], given[2:]),
        of_columns(whole, given[:2], given[2:]),
        strict=True,
    ):
        np.testing.assert_array_equal(ours, other)


def test_a_function_that_calls_two_others_is_compiled_as_it_is():
    x = ca.SX.sym("x")
    sine, cosine = (
        ca.Function(name, [x], [value], {"never_inline": True})
        for name, value in (("sine", ca.sin(x)), ("cosine", ca.cos(x)))
    )
    assert not can_be_vectors(ca.Function("both", [x], [sine(x) + cosine(x)]))
