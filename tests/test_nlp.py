"""A term is a small function; the machine scatters its derivatives exactly."""

from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from made_up import merged, swing

from tactilenlp.errors import PageError
from tactilenlp.nlp.problem import Problem

ROUNDING = 1e-12  # [relative] a few hundred operations of doubles
# Central differences with steps of 1e-5 of a scale: 1e-10 of truncation and 1e-11 of
# rounding, both times derivatives of order one hundred.
DIFFERENCE = 1e-7


def differences(function, x, width=1e-5):
    """Return central differences of a vector function, (rows, unknowns)."""
    steps = width * np.eye(len(x))
    return np.stack(
        [(function(x + s) - function(x - s)) / (2 * width) for s in steps], 1
    )


def test_merged_poses_give_the_right_gradient_jacobian_and_hessian():
    problem = merged()
    f, data = problem.assembly.functions, problem.data()
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
    f, data, s = problem.assembly.functions, problem.data(), problem.scale
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
    gradient = problem.assembly.functions["grad_f"](np.ones(6), problem.data())[1]
    # The solver's interface copies nonzeros one after the other: all must be there.
    assert gradient.sparsity().is_dense()
    assert np.asarray(gradient).ravel().tolist() == [0, 0, 0, 0, 0, 2]


def test_a_parameter_changes_the_programme_without_building_it_anew():
    problem = merged()
    built, x = problem.assembly.functions, problem.pack({})
    soft, stiff = problem.data({"stiffness": 1.0}), problem.data({"stiffness": 3.0})
    costs = [problem.value("swing", x, d).sum() for d in (soft, problem.data(), stiff)]
    # The cost is linear in the stiffness, whose declared value, 2.5, stays as it was.
    assert costs[1] == pytest.approx(costs[0] + 0.75 * (costs[2] - costs[0]), rel=1e-12)
    assert problem.assembly.functions is built
    values = [float(built["grad_f"](x / problem.scale, d)[0]) for d in (soft, stiff)]
    assert values[1] - values[0] == pytest.approx(costs[2] - costs[0], rel=1e-12)


def test_unknowns_are_ordered_by_column_and_survive_a_round_trip():
    problem = merged()
    x = np.arange(problem.size, dtype=float)
    values = problem.unpack(x)
    assert values["x"][:, 0].tolist() == [2, 3, 4]
    np.testing.assert_array_equal(problem.pack(values), x)


def test_what_is_reported_can_be_read_and_costs_nothing():
    problem = merged()
    x = problem.variables["x"]
    before = problem.assembly.functions["grad_f"](
        np.ones(problem.size), problem.data()
    )[0]
    problem.report("doubled", lambda x: 2 * x, x[:, [3]])
    after = problem.assembly.functions["grad_f"](np.ones(problem.size), problem.data())[
        0
    ]
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
            "a: unknown role: expected one of .*likelihood.*got .weight",
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
            lambda p: p.subject_to("a", lambda y: y, (y := declare(p))[:, :2], per=y),
            r"a: arguments disagree on the number of instances: got \[2, 3\]",
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
            lambda p: p.subject_to(
                "a", lambda y: y, declare(p), per=declare(Problem())
            ),
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


def test_columns_that_no_instance_reads_have_indices_all_the_same():
    x = Problem().variable("x", 3, 5, guess=0.0, unit="m", scale=1.0)
    assert x[:, []].indices.shape == (0, 3)
    assert x[:, np.zeros((0, 2), int)].indices.shape == (0, 6)


class Pull(NamedTuple):
    f: object
    r: object
    scale: object


def test_a_named_tuple_of_arguments_reaches_the_function_by_its_names():
    problem = Problem()
    f = problem.variable("f", 2, 3, guess=1.0, unit="N", scale=1.0)
    data = np.arange(6.0).reshape(3, 2)

    def work(pull, other):
        assert pull.scale is None
        return ca.dot(pull.f, pull.r) + other[0]

    pulls = Pull(f[:, [2, 0, 1]], data, None)
    problem.minimize("work", work, pulls, [5.0, 6.0, 7.0], role="physics")
    x = np.arange(6.0)  # columns (0, 1), (2, 3), (4, 5)
    rows = x.reshape(3, 2)[[2, 0, 1]]
    expected = (rows * data).sum(axis=1) + np.array([5, 6, 7])
    found = problem.value("work", x, problem.data())[:, 0]
    np.testing.assert_allclose(found, expected)
    slope = problem.jacobian("work", x, problem.data()).toarray()
    assert (slope[0] == [0, 0, 0, 0, 0, 1]).all()
