"""The terms of a programme together: values and exact derivatives, in scaled unknowns.

A term is a function of a few numbers, applied to many instances.  What all instances
read is gathered into long arrays, CasADi evaluates one term after the other between
slices of these, and what they return is summed where it belongs: a product with a
sparse matrix of the factors by which unknowns are scaled.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .nlpsol import nlpsol_functions
from .term_functions import between_slices, padded


class Assembly:
    """A programme as functions of arrays: scaled unknowns x (n,), data p, multipliers.

    jacobian (rows, n), hessian (n, n), upper triangle: patterns, whose nonzeros are
    what is returned.  The problem's strict deadline ends the making between two terms:
    large problems take seconds.  Its arrays are its own: one thread at a time.
    free, kept: which unknowns and rows a solver is given, of this programme all.
    """

    free = kept = slice(None)

    def __init__(self, problem):
        self.terms = terms = [*problem.terms.values()]
        self._scale, self._rows = problem.scale, problem.rows
        self._deadline = problem.deadline
        self._at_terms = (
            _Gathered(terms, [term.unknowns for term in terms]),
            _Gathered(terms, [term.data for term in terms]),
        )
        self._weights = _Gathered(terms, [_multipliers_of(term) for term in terms])
        functions = [term.function for term in terms]
        self._arguments = _Slices(terms, [f.arguments for f in functions])
        self._roots = _Slices(terms, [f.roots for f in functions])
        slopes = [f.jacobian_sparsity.nnz() for f in functions]
        self._found_first = _Slices(terms, [f.rows for f in functions], slopes)
        curves = [f.hessian_sparsity.nnz() for f in functions]
        self._found_second = _Slices(terms, curves)
        self._at = np.full(problem.size, np.nan), np.full(problem.data().size, np.nan)
        self._found = None
        self._add_up_values_and_slopes()
        self._add_up_curves()

    def evaluated(self, x: np.ndarray, p: np.ndarray) -> tuple:
        """Return f, its gradient (n,), g (rows,) and the nonzeros of its Jacobian."""
        self._look(x, p)
        if self._found is None:
            for evaluate, _ in self._first:
                evaluate()
            sums, n = self._sums @ self._found_first.whole, len(x)
            g = self._found_first.whole[self._constraints]
            self._found = float(sums[0]), sums[1 : 1 + n], g, sums[1 + n :]
        return self._found

    def value(self, x, p) -> tuple:
        """Return f and g (rows,)."""
        return self.evaluated(x, p)[::2]

    def values(self, x, p) -> dict[str, np.ndarray]:
        """Return the value of every term at every instance, (instances, rows)."""
        self.evaluated(x, p)
        found = self._found_first
        return {
            term.name: found.whole[found.places(k)].reshape(term.instances, -1)
            for k, term in enumerate(self.terms)
        }

    def lagrangian(self, x, p, lam_g: np.ndarray) -> tuple:
        """Return the gradient (n,) of f + lam_g' g, and g (rows,)."""
        _, gradient, g, _ = self.evaluated(x, p)
        return gradient + self.slopes(x, p).T @ lam_g, g

    def second(self, x, p, lam_f: float, lam_g: np.ndarray) -> np.ndarray:
        """Return the nonzeros of the Hessian of lam_f f + lam_g' g."""
        self._look(x, p)
        self._weights.gather(np.concatenate(([lam_f], lam_g)))
        for evaluate, _ in self._second:
            evaluate()
        return self._second_sums @ self._found_second.whole

    def slopes(self, x, p) -> sp.csr_matrix:
        """Return the Jacobian of g (rows, n)."""
        found = self.evaluated(x, p)[3], *self._places_of_slopes
        return sp.csc_matrix(found, self.jacobian.shape).tocsr()

    def curvature(self, x, p, lam_f: float, lam_g: np.ndarray) -> sp.csc_matrix:
        """Return the Hessian of lam_f f + lam_g' g (n, n), symmetric."""
        found = self.second(x, p, lam_f, lam_g), *self._places_of_curves
        upper = sp.csc_matrix(found, self.hessian.shape)
        return upper + sp.triu(upper, 1).T.tocsc()

    def _look(self, x, p) -> None:
        """Gather what the terms read at x, p, unless they were looked at last."""
        if np.array_equal(x, self._at[0]) and np.array_equal(p, self._at[1]):
            return
        self._at, self._found = (x.copy(), p.copy()), None
        unknowns, data = self._at_terms
        unknowns.gather(x * self._scale)
        data.gather(p)
        for evaluate, _ in self._solve:
            evaluate()

    @cached_property
    def functions(self) -> dict:
        """What `nlpsol` takes, with exact derivatives."""
        return nlpsol_functions(self, len(self._at[1]))

    def complete(self, x: np.ndarray, data: np.ndarray) -> np.ndarray:
        """Return all unknowns, SI: none follows from the others."""
        return x

    def multipliers(self, x, data, lam_g: np.ndarray) -> np.ndarray:
        """Return the multipliers of all constraints, given those that are kept."""
        return lam_g

    # -- functions on all instances ---------------------------------------------------
    @cached_property
    def _solve(self) -> list:
        """What finds the roots: their arguments, then the solver of each term."""
        calls = self._calls("arguments", self._at_terms, self._arguments)
        for k, term in enumerate(self.terms):
            if one := term.function.solver:
                count = term.function.equations * padded(term.instances)
                views = self._arguments.of(k), self._roots.of(k)
                calls.append(between_slices(one(), count, *views))
        return calls

    @cached_property
    def _first(self) -> list:
        return self._calls("first", (*self._at_terms, self._roots), self._found_first)

    @cached_property
    def _second(self) -> list:
        read = *self._at_terms, self._roots, self._weights
        return self._calls("second", read, self._found_second)

    def _calls(self, name: str, read, found) -> list:
        """Return what evaluates a part of all terms, between slices of long arrays."""
        calls = []
        for k, term in enumerate(self.terms):
            if (function := term.function.part(name)).nnz_out():
                views = [a for r in read for a in r.of(k)], found.of(k)
                calls.append(between_slices(function, term.instances, *views))
        return calls

    # -- where results belong ---------------------------------------------------------
    def _add_up_values_and_slopes(self) -> None:
        """Set what sums f, its gradient and the Jacobian, and where g is read."""
        n, found = len(self._scale), self._found_first
        sums, jacobian, constraints = [], [], [np.zeros(0, int)]
        for k, term in enumerate(self.terms):
            self._deadline.check()
            values, slopes = found.places(k), found.places(k, 1)
            row, column = term.jacobian_places
            factors = self._scale[column]
            if term.role is None:
                constraints.append(values)
                jacobian.append((row + term.first_row, column, factors, slopes))
            else:
                sums.append((np.zeros(len(values), int), np.ones(len(values)), values))
                sums.append((1 + column, factors, slopes))
        self._constraints = np.concatenate(constraints)
        shape = self._rows, n
        self.jacobian, self._places_of_slopes, *read = _scattered(jacobian, shape)
        sums.append((1 + n + read[0], *read[1:]))
        target, factors, read = _joined(sums, 3)
        shape = 1 + n + self.jacobian.nnz(), len(found.whole)
        self._sums = sp.csr_matrix((factors, (target, read)), shape)

    def _add_up_curves(self) -> None:
        """Lay out the Hessian, and the matrix that sums the nonzeros of its terms."""
        n, found, hessian = len(self._scale), self._found_second, []
        for k, term in enumerate(self.terms):
            self._deadline.check()
            i, j, factor = term.hessian_places
            factors = self._scale[i] * self._scale[j] * factor
            hessian.append((i, j, factors, found.places(k)))
        found = _scattered(hessian, (n, n))
        self.hessian, self._places_of_curves, target, factors, read = found
        shape = self.hessian.nnz(), len(self._found_second.whole)
        self._second_sums = sp.csr_matrix((factors, (target, read)), shape)


class _Slices:
    """One array, in which each number of the instances of each term has a slice.

    numbers: of each result, or of what is read, how many one instance of every term
    has.  A slice has room for all calls of functions of several instances.
    """

    def __init__(self, terms: list, *numbers: list[int]):
        counts = [term.instances for term in terms]
        filled = [padded(count) for count in counts]
        self._lengths = np.multiply(numbers, counts)
        self._starts = np.cumsum([0, *np.multiply(numbers, filled).ravel()])
        self._terms, self.whole = len(terms), np.zeros(self._starts[-1])

    def of(self, k: int) -> list[np.ndarray]:
        """Return the slices of term k."""
        several = range(k, len(self._starts) - 1, self._terms)
        return [self.whole[self._starts[i] : self._starts[i + 1]] for i in several]

    def places(self, k: int, which: int = 0) -> np.ndarray:
        """Return where a result of all instances of term k is."""
        first = self._starts[which * self._terms + k]
        return first + np.arange(self._lengths[which, k])


class _Gathered(_Slices):
    """What the instances of all terms read, the last one again until calls are full.

    indices: of each term (instances, numbers), into the vector that `gather` is given.
    """

    def __init__(self, terms: list, indices: list[np.ndarray]):
        super().__init__(terms, [one.shape[1] for one in indices])
        filled = [np.minimum(np.arange(padded(len(i))), len(i) - 1) for i in indices]
        read = (one[k].ravel() for one, k in zip(indices, filled, strict=True))
        self._indices = np.concatenate([np.zeros(0, int), *read])

    def gather(self, vector: np.ndarray) -> None:
        """Read a vector at the indices of all instances, into `whole`."""
        np.take(vector, self._indices, out=self.whole, mode="clip")


def _multipliers_of(term) -> np.ndarray:
    """Return which of (lam_f, lam_g) weighs each row of each instance."""
    shape = term.instances, term.function.rows
    if term.role is not None:
        return np.zeros(shape, int)
    return 1 + term.first_row + np.arange(term.rows).reshape(shape)


def _joined(parts: list[tuple], count: int) -> list[np.ndarray]:
    """Return the `count` arrays of all parts, those of a kind one after the other."""
    columns = zip(*parts, strict=True) if parts else [[np.zeros(0, int)]] * count
    return [np.concatenate([*column]) for column in columns]


def _scattered(parts, shape: tuple[int, int]) -> tuple:
    """Return the pattern of what stands at (row, column), and what sums it.

    parts: rows, columns, factors, and where the numbers are read.  Of the pattern the
    rows of its nonzeros, and where its columns start; of each number the nonzero, which
    several may share, its factor, and where it is read.
    """
    rows, columns, factors, read = _joined(parts, 4)
    row, column, target = distinct_places(rows, columns, shape)
    start = np.searchsorted(column, np.arange(shape[1] + 1))
    pattern = ca.Sparsity(*shape, start.tolist(), row.tolist())
    return pattern, (row, start), target, factors, read


def distinct_places(rows, columns, shape: tuple[int, int]) -> tuple[np.ndarray, ...]:
    """Return rows and columns of the distinct places, column by column, as CasADi's.

    Also return which of them each given place is.
    """
    rows, columns = (np.asarray(k, np.int64) for k in (rows, columns))
    order = order_by_column(rows, columns, max(shape))
    row, column = rows[order], columns[order]
    new = np.ones(len(order), bool)
    new[1:] = (row[1:] != row[:-1]) | (column[1:] != column[:-1])
    place = np.empty(len(order), np.intp)
    place[order] = np.cumsum(new) - 1
    return row[new], column[new], place


def order_by_column(rows, columns, size: int) -> np.ndarray:
    """Return the order of places column by column; size: above all numbers.

    Integers of 16 bits are sorted by their digits, in time linear in how many they are.
    """
    small = np.min_scalar_type(size)
    return np.lexsort((rows.astype(small), columns.astype(small)))
