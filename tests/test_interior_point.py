"""The interior-point method finds what IPOPT finds, with smaller matrices."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from swing_up import TIGHT, cone, decay, pendulum, stationarity

from tactilenlp import problem_of
from tactilenlp.errors import OptionError
from tactilenlp.nlp.problem import Problem
from tactilenlp.solvers import solve as solving
from tactilenlp.solvers import sparse_ldl
from tactilenlp.solvers.bordered_ldl import BorderedLdl
from tactilenlp.solvers.condensed_kkt import CondensedKkt
from tactilenlp.solvers.interior_point import InteriorPoint
from tactilenlp.solvers.line_search import Filter, Stuck
from tactilenlp.solvers.options import NAMES, Settings, SolverOptions
from tactilenlp.solvers.primal_dual import Run
from tactilenlp.solvers.solve import Solvers, make_ipopt, solve
from tactilenlp.solvers.sparse_ldl import SparseLdl


def positive(rng, n: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a sparse positive definite matrix and places of its upper triangle."""
    half = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.05)
    matrix = half @ half.T + np.eye(n)
    return matrix, *np.nonzero(np.triu(matrix))


@pytest.fixture(params=["compiled", "casadi"])
def method(request, monkeypatch):
    """Both ways in which a matrix is factorised."""
    if request.param == "casadi":
        monkeypatch.setattr(sparse_ldl, "_functions", lambda: None)
    elif sparse_ldl._functions() is None:
        pytest.skip("no C compiler on this machine")
    return request.param


def test_a_sparse_system_is_solved(method):
    matrix, rows, columns = positive(np.random.default_rng(0))
    ldl, right = SparseLdl(len(matrix), rows, columns), np.arange(len(matrix)) - 7.0
    assert ldl.factorise(matrix[rows, columns])
    # Backward stable: rounding times the condition number, about 100.
    np.testing.assert_allclose(matrix @ ldl.solve(right), right, atol=1e-11)


def test_an_indefinite_matrix_is_refused(method):
    matrix, rows, columns = positive(np.random.default_rng(1))
    ldl = SparseLdl(len(matrix), rows, columns)
    lowest = np.linalg.eigvalsh(matrix)[0]
    for shift in (lowest - 1e-6, lowest + 1e-6):
        moved = matrix - shift * np.eye(len(matrix))
        assert ldl.factorise(moved[rows, columns]) == (shift < lowest)
    assert not ldl.factorise(np.full(len(rows), np.nan))
    assert ldl.factorise(matrix[rows, columns])  # nothing is left of what failed


def test_both_ways_give_the_same_digits(monkeypatch):
    if sparse_ldl._functions() is None:
        pytest.skip("no C compiler on this machine")
    matrix, rows, columns = positive(np.random.default_rng(2))
    found, right = [], np.arange(len(matrix)) - 7.0
    for functions in (sparse_ldl._functions, lambda: None):
        monkeypatch.setattr(sparse_ldl, "_functions", functions)
        ldl = SparseLdl(len(matrix), rows, columns)
        assert ldl.factorise(matrix[rows, columns])
        found.append(ldl.solve(right))
    np.testing.assert_allclose(*found, rtol=1e-14)


@pytest.mark.parametrize("shared", [0, 5])
def test_a_matrix_with_a_border_is_factorised_if_its_inertia_is_right(method, shared):
    rng = np.random.default_rng(4)
    matrix, *_ = positive(rng)
    n = len(matrix)
    border = np.zeros(n + 2, bool)
    border[rng.permutation(n)[:shared]] = border[n:] = True
    A = np.zeros((2, n))
    A[:, border[:n]] = rng.normal(size=(2, shared))
    whole = np.block([[matrix, A.T], [A, np.zeros((2, 2))]])
    places = np.nonzero(np.triu(whole + np.eye(n + 2)))
    ldl, right = BorderedLdl(*places, border, negative=2), rng.normal(size=n + 2)
    # Without unknowns that they share the equations read nothing: singular.
    assert ldl.factorise(whole[places]) == (shared > 0)
    if shared:
        np.testing.assert_allclose(whole @ ldl.solve(right), right, atol=1e-11)
    assert not ldl.factorise(whole[places] - 9.0 * (places[0] == places[1]))
    assert not ldl.factorise(np.full(len(places[0]), np.nan))
    plain = BorderedLdl(*np.nonzero(np.triu(matrix)), border[:n])
    assert plain.factorise(matrix[np.nonzero(np.triu(matrix))])
    np.testing.assert_allclose(matrix @ plain.solve(right[:n]), right[:n], atol=1e-11)


@pytest.mark.parametrize("equal", [(), (2,)])
def test_the_condensed_matrix_is_the_whole_one_without_slacks(equal):
    rng = np.random.default_rng(3)
    H, J = np.diag([3.0, 4.0, 5.0, 6.0]), np.zeros((3, 4))
    H[0, 2] = H[2, 0] = 0.5
    J[0, :2], J[1, 3], J[2, 1:] = rng.normal(size=2), 1.5, rng.normal(size=3)
    rows = ca.sparsify(ca.DM(J)).sparsity()
    upper = ca.sparsify(ca.DM(np.triu(H))).sparsity()
    tied = np.isin(np.arange(3), equal)
    kkt = CondensedKkt(upper, rows, tied)
    second = np.triu(H)[upper.row(), upper.get_col()]
    first = J[rows.row(), rows.get_col()]
    in_x, in_s, fixed = rng.random(4), rng.random(3), np.zeros(4, bool)
    right, of_equal = rng.normal(size=4), rng.normal(size=len(equal))
    A, loose = J[tied], J[~tied]
    whole = H + np.diag(in_x) + loose.T @ np.diag(in_s[~tied]) @ loose
    np.testing.assert_allclose(kkt.times(first, right), J @ right, atol=1e-15)
    np.testing.assert_allclose(
        kkt.transposed_times(first, in_s), J.T @ in_s, atol=1e-15
    )
    for left_out in ([], [1]):
        fixed[left_out] = True
        given = first, in_x, in_s, kkt.entries_of(fixed)
        assert kkt.factorise(kkt.matrix(second, *given))
        step, forces = kkt.solve(np.where(fixed, 0.0, right), of_equal)
        assert not step[fixed].any()
        sums = whole @ step + A.T @ forces
        np.testing.assert_allclose(sums[~fixed], right[~fixed], atol=1e-13)
        np.testing.assert_allclose(A @ step, of_equal, atol=1e-13)
    assert not kkt.factorise(kkt.matrix(-9 * second, *given))
    unit = np.eye(4) + loose.T @ loose
    assert kkt.factorise(kkt.unit(first, kkt.entries_of(np.zeros(4, bool))))
    step, forces = kkt.solve(right, of_equal)
    np.testing.assert_allclose(unit @ step + A.T @ forces, right, atol=1e-13)


def ring():
    """Return a problem one of whose rows is an equation."""
    problem = Problem()
    x = problem.variable("x", 3, 4, guess=0.1, lower=-5.0, upper=0.8, unit="m", scale=2)
    problem.minimize("far", lambda x: ca.sumsqr(x - 1) + ca.sin(x[0]), x, role="prior")
    problem.subject_to(
        "ring", lambda x: x[0] ** 2 + x[1] * x[2] - 0.3, x[:, [1]], lower=0, upper=0
    )
    problem.subject_to("room", lambda x: ca.sum1(x) ** 2, x, upper=2.0)
    return problem


TARGETS = [2.0, 0.3, 0.4], [1.0, 3.0, 4.0], [-4.0, 0.6, 0.8]


@pytest.mark.parametrize("problem", [*map(cone, TARGETS), ring()], ids=[*"abc", "ring"])
def test_an_optimum_and_its_multipliers_are_those_of_ipopt(problem):
    assert isinstance(Solvers(problem).solver_for(TIGHT), InteriorPoint)
    ours = solve(problem, TIGHT)
    other = solve(problem, solver=make_ipopt(problem.assembly, TIGHT))
    assert (ours.solver, other.solver) == ("interior_point", "ipopt")
    assert max(ours.stationarity, other.stationarity) < 1e-7
    assert max(ours.complementarity, other.complementarity) < 1e-7
    assert ours.status == other.status == "Solve_Succeeded"
    assert ours.objective == pytest.approx(other.objective, rel=1e-9, abs=1e-12)
    for name, value in other.values.items():
        np.testing.assert_allclose(ours.values[name], value, atol=1e-7)
    for name, force in other.multipliers.items():
        np.testing.assert_allclose(ours.multipliers[name], force, atol=1e-6)
    assert max(ours.violations.values()) < 1e-9
    again = solve(problem, TIGHT, start=ours)
    assert again.iterations < other.iterations  # its multipliers are of use
    assert again.objective == pytest.approx(ours.objective, rel=1e-9, abs=1e-12)


def test_a_page_ends_where_ipopt_ends(recorded, estimate):
    """From the same start, half a millimetre off, with as many iterations or so."""
    problem = problem_of(estimate.measurements, recorded[1], at=estimate)
    options = SolverOptions(ipopt={"mu_init": 1e-3})
    start = dict(estimate.unknowns)
    start["x"] = start["x"] + np.array([[0.5e-3], [0.0], [0.0]])
    ipopt = make_ipopt(problem.assembly, options)
    ours, other = (
        solve(problem, options, start=start, solver=solver) for solver in (None, ipopt)
    )
    # Either may end in one of two optima of the shipped recording, 0.1 nats apart.
    assert ours.objective == pytest.approx(other.objective, abs=0.2)
    assert ours.iterations == pytest.approx(other.iterations, rel=0.5)
    assert max(ours.violations.values()) < 1e-6


def test_many_equations_and_options_of_ipopt_alone_are_left_to_ipopt():
    assert not isinstance(
        Solvers(pendulum()).solver_for(SolverOptions()), InteriorPoint
    )
    watched = SolverOptions(ipopt={"watchdog_trial_iter_max": 3})
    assert not isinstance(Solvers(decay()[0]).solver_for(watched), InteriorPoint)


def test_an_option_of_zero_switches_the_early_end_off():
    found = solve(cone([2.0, 0.3, 0.4]), SolverOptions(ipopt={"acceptable_iter": 0}))
    assert found.status == "Solve_Succeeded"
    assert found.iterations > 0


@pytest.mark.parametrize(
    "wrong",
    [
        *({"tol": "tight"}, {"max_iter": "9"}, {"mu_init": -1.0}),
        *({"acceptable_iter": 1.5}, {"tol": [1e-6]}, {"max_iter": {}}),
    ],
)
def test_options_that_make_no_sense_are_refused(wrong):
    with pytest.raises(OptionError, match=next(iter(wrong))):
        solve(cone([2.0, 0.3, 0.4]), SolverOptions(ipopt=wrong))


@pytest.mark.parametrize("diverged", [False, True])
def test_where_no_step_is_accepted_a_second_run_starts(monkeypatch, diverged):
    """From the last point, or from the original start if the first run diverged."""
    problem, searched = cone([1.0, 3.0, 4.0]), Filter.first_accepted
    whole, filters, begun = solve(problem, TIGHT), [], []

    def refuse_in_the_first_run(self, at, *line):
        if self not in filters:
            filters.append(self)
            begun.append(at.w)
        if self is filters[0] and len(begun) > 3:
            raise Stuck
        if self is filters[0]:
            begun.append(at.w)
        return searched(self, at, *line)

    monkeypatch.setattr(Filter, "first_accepted", refuse_in_the_first_run)
    monkeypatch.setattr(Run, "diverged", lambda run: diverged)
    monkeypatch.setattr(solving, "make_ipopt", None)  # it is not asked
    found = solve(problem, TIGHT)
    assert found.success
    assert found.objective == pytest.approx(whole.objective, rel=1e-9)
    assert len(filters) == 2
    from_first, from_last = (np.abs(begun[-1] - begun[k]).max() for k in (0, -2))
    assert (from_first < from_last) == diverged


@pytest.mark.parametrize("last", [(1.5, 3.0), (1.5, 1.0), (0.5, 3.0)])
def test_a_run_diverged_where_primal_and_dual_errors_grew(last):
    run = SimpleNamespace(history=[(9.0, 1.0, 2.0, 0.1), (8.0, *last, 0.1)])
    assert Run.diverged(run) == (last == (1.5, 3.0))
    assert not Run.diverged(SimpleNamespace(history=[]))


def test_where_no_step_is_accepted_ipopt_solves_from_the_same_start(monkeypatch):
    problem = cone([1.0, 3.0, 4.0])
    whole = solve(problem, TIGHT)

    def refuse(*_):
        raise Stuck

    monkeypatch.setattr(Filter, "first_accepted", refuse)
    other = solve(problem, TIGHT)
    assert other.success
    assert (whole.solver, other.solver) == ("interior_point", "ipopt")
    assert other.objective == pytest.approx(whole.objective, rel=1e-9)


def test_where_one_small_step_follows_another_ipopt_takes_over(monkeypatch):
    problem, searched = cone([1.0, 3.0, 4.0]), Filter.first_accepted

    def creep(self, at, dw, slope, longest, mu, evaluated):
        return searched(self, at, dw, slope, 1e-6 * longest, mu, evaluated)

    monkeypatch.setattr(Filter, "first_accepted", creep)
    solution = solve(problem, TIGHT)
    assert solution.success
    assert solution.iterations < 30  # those of IPOPT


def test_what_is_fixed_stays_and_the_rest_is_optimal():
    problem = cone([1.0, 3.0, 4.0])
    start = {"f": np.array([[3.0], [1.0], [2.0]])}
    first = [0]
    solution = solve(problem, TIGHT, start=start, fixed=(first,))
    assert solution.values["f"][0] == 3.0
    assert np.abs(stationarity(problem, solution)).max() < 1e-7
    assert solution.bound_multipliers["f"][0] != 0


def test_the_names_of_options_are_those_of_ipopt():
    problem = cone([1.0, 3.0, 4.0])
    settings = Settings(**SolverOptions().named(warm=False))
    assert settings.tol == SolverOptions().tolerance
    every = {name: getattr(settings, name) for name in NAMES}
    every["max_wall_time"] = 10.0
    ipopt = make_ipopt(problem.assembly, SolverOptions(ipopt=every))
    solution = solve(problem, solver=ipopt)
    assert solution.success


def test_rounding_puts_no_point_on_a_bound():
    problem = Problem()
    x = problem.variable("x", 2, 3, guess=1.0, lower=1.0, upper=2.0, unit="m", scale=1)
    problem.minimize("low", lambda x: 1e12 * ca.sum1(x), x, role="prior")
    found = solve(problem, SolverOptions(tolerance=1e-8))
    assert found.success
    np.testing.assert_allclose(found.values["x"], 1.0, atol=1e-12)
