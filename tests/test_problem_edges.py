"""What a user's own Problem may be asked for: bounds of what follows, wrong names."""

import casadi as ca
import numpy as np
import pytest

from tactilenlp import Problem
from tactilenlp.errors import PageError, TactileError
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import solve


def recursion(upper=np.inf):
    """Return min (u - 3)^2 with y_0 = 2 u, y_k = y_{k-1} + 1, and y bounded."""
    nlp = Problem()
    u = nlp.variable("u", 1, guess=0.0, unit="1", scale=1.0)
    y = nlp.variable("y", 1, 3, guess=0.0, unit="1", scale=1.0, upper=upper)
    nlp.follow("first", lambda u: 2 * u, u, gives=y[:, 0])
    nlp.follow("next", lambda before: before + 1, y[:, :2], gives=y[:, 1:])
    nlp.minimize("cost", lambda u: (u - 3) ** 2, u, role="prior")
    return nlp, u


def test_what_follows_from_others_has_no_bounds_where_it_is_eliminated():
    free, _ = recursion()
    found = solve(free, eliminate=True)
    assert found.values["y"].ravel() == pytest.approx([6, 7, 8])
    bounded, _ = recursion(upper=4.0)
    with pytest.raises(PageError, match="bounds"):
        solve(bounded, eliminate=True)
    whole = solve(bounded, SolverOptions())
    assert whole.values["y"].ravel() == pytest.approx([2, 3, 4], abs=1e-5)
    with pytest.raises(PageError, match="fixed"):
        solve(free, eliminate=True, fixed=("y",))


def test_a_solution_starts_a_problem_to_which_a_constraint_was_added():
    nlp, u = recursion()
    before = solve(nlp)
    nlp.subject_to("least", lambda u: u, u, lower=4.0)
    assert solve(nlp, start=before).values["u"].item() == pytest.approx(4.0, abs=1e-5)


@pytest.mark.parametrize(
    "call",
    [
        lambda nlp, u: solve(nlp, fixed=(np.array([100]),)),
        lambda nlp, u: solve(nlp, fixed=(np.array([0.5]),)),
        lambda nlp, u: solve(Problem()),
        lambda nlp, u: nlp.value("typo", np.zeros(4), nlp.data()),
        lambda nlp, u: nlp.jacobian("typo", np.zeros(4), nlp.data()),
        lambda nlp, u: nlp.hessian("typo", np.zeros(4), nlp.data()),
        lambda nlp, u: nlp.subject_to("c", ca.sumsqr, u, per=u[:, 0], upper=1),
    ],
)
def test_what_a_problem_does_not_have_is_refused_in_words(call):
    with pytest.raises(TactileError):
        call(*recursion())


def test_indices_of_unknowns_can_be_held():
    nlp, _ = recursion()
    start = {"u": np.array([[1.5]])}
    found = solve(nlp, start=start, fixed=(np.array([0]),))
    assert found.values["u"].item() == 1.5


def test_a_point_without_a_number_leaves_no_trace_where_unknowns_are_eliminated():
    nlp = Problem()
    u = nlp.variable("u", 1, guess=1.0, unit="1", scale=1.0)
    y = nlp.variable("y", 1, 2, guess=1.0, unit="1", scale=1.0)
    nlp.follow("root", ca.sqrt, u, gives=y[:, [0]])
    nlp.follow("next", lambda a: a + 1, y[:, [0]], gives=y[:, [1]])
    nlp.minimize("cost", lambda b: (b - 3) ** 2, y[:, [1]], role="prior")
    few, data = nlp.eliminated, nlp.data()
    values = [few.value(np.array([at]), data)[0] for at in (1.0, -1.0, 1.0, 4.0)]
    assert values[0] == values[2] == 1.0
    assert values[3] == 0.0
    assert np.isnan(values[1])
    found = solve(nlp, start={"u": [[30.0]]}, eliminate=True)
    assert found.values["u"].item() == pytest.approx(4.0, abs=1e-4)


def test_one_column_cannot_follow_from_several_instances():
    nlp, u = recursion()
    z = nlp.variable("z", 1, guess=0.0, unit="1", scale=1.0)
    nlp.follow("twice", lambda u, d: u + d, u, np.array([1.0, 2.0]), gives=z[:, [0]])
    with pytest.raises(PageError, match="twice: several instances"):
        solve(nlp, eliminate=True)


def test_what_follows_without_an_instance_is_left_out():
    nlp, _ = recursion()
    y, none = nlp.variables["y"], np.zeros(0, int)
    nlp.follow("later", lambda b: b + 1, y[:, none], gives=y[:, none])
    assert solve(nlp, eliminate=True).values["y"].ravel() == pytest.approx([6, 7, 8])


@pytest.mark.parametrize("limits", [(np.inf, np.inf), (-np.inf, -np.inf)])
def test_a_row_that_no_number_meets_is_refused(limits):
    nlp, u = recursion()
    lower, upper = limits
    with pytest.raises(PageError, match="limits cross"):
        nlp.subject_to(
            "c", lambda u: ca.vertcat(u, u), u, lower=[0, lower], upper=[1, upper]
        )


def test_a_problem_without_unknowns_is_examined():
    assert Problem().check().findings == ()
