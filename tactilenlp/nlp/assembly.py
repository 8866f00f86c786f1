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

from ..common.deadline import NEVER, Deadline
from .callbacks import ArrayFunction
from .simd import WIDTH


class Assembly:
    """A programme as functions of arrays: scaled unknowns x (n,), data p, multipliers.

    terms: costs, then constraints in the order of their rows; scale (n,); data, rows:
    how many numbers all terms read, how many rows are constrained.  jacobian (rows, n),
    hessian (n, n), upper triangle: patterns, whose nonzeros are what is returned.  A
    strict deadline ends the making between two terms: large problems take seconds.
    """

    def __init__(self, terms, scale, data: int, rows: int, deadline: Deadline = NEVER):
        self.terms, self._scale, self._rows = [*terms], scale, rows
        self._data, self._deadline = data, deadline
        self._unknowns = _Gathered([term.unknowns for term in self.terms])
        self._given = _Gathered([term.data for term in self.terms])
        self._weights = _Gathered([_multipliers_of(term) for term in self.terms])
        functions = [term.function for term in self.terms]
        numbers = [one.rows for one in functions]
        numbers += [one.jacobian_sparsity.nnz() for one in functions]
        self._first_results = _Results(2 * self.terms, numbers)
        numbers = [one.hessian_sparsity.nnz() for one in functions]
        self._second_results = _Results(self.terms, numbers)
        self._at = np.full(len(scale), np.nan), np.full(data, np.nan)
        self._found = None
        self._add_up_values_and_slopes()
        self._add_up_curves()

    def evaluated(self, x: np.ndarray, p: np.ndarray) -> tuple:
        """Return f, its gradient (n,), g (rows,) and the nonzeros of its Jacobian."""
        self._look(x, p)
        if self._found is None:
            for evaluate, _ in self._first:
                evaluate()
            sums, n = self._sums @ self._first_results.whole, len(x)
            g = self._first_results.whole[self._constraints]
            self._found = float(sums[0]), sums[1 : 1 + n], g, sums[1 + n :]
        return self._found

    def lagrangian(self, x, p, lam_g: np.ndarray) -> tuple:
        """Return the gradient (n,) of f + lam_g' g, and g (rows,)."""
        _, gradient, g, slopes = self.evaluated(x, p)
        rows, columns = np.array(self.jacobian.get_triplet(), int)
        pulls = np.bincount(columns, slopes * lam_g[rows], len(x))
        return gradient + pulls, g

    def second(self, x, p, lam_f: float, lam_g: np.ndarray) -> np.ndarray:
        """Return the nonzeros of the Hessian of lam_f f + lam_g' g."""
        self._look(x, p)
        self._weights.gather(np.concatenate(([lam_f], lam_g)))
        for evaluate, _ in self._second:
            evaluate()
        return self._second_sums @ self._second_results.whole

    def for_nlpsol(self) -> dict:
        """Return `nlp` (expressions) and the derivatives, functions, of nlpsol."""
        n, one = len(self._scale), ca.Sparsity.dense(1)
        x, p, g = (ca.Sparsity.dense(k) for k in (n, self._data, self._rows))

        def call(name, function, inputs, outputs):
            return ArrayFunction(name, function, inputs, outputs)

        values = call("value", lambda *at: self.evaluated(*at)[::2], [x, p], [one, g])
        symbols = ca.MX.sym("x", x), ca.MX.sym("p", p)
        f, rows = values(*symbols)
        return {
            "nlp": {"x": symbols[0], "p": symbols[1], "f": f, "g": rows},
            "grad_f": call(
                "grad_f", lambda *at: self.evaluated(*at)[:2], [x, p], [one, x]
            ),
            "jac_g": call(
                "jac_g", lambda *at: self.evaluated(*at)[2:], [x, p],
                [g, self.jacobian],
            ),
            "hess_lag": call(
                "hess_lag", lambda x, p, f, g: (self.second(x, p, f[0], g),),
                [x, p, one, g], [self.hessian],
            ),
            "alive": values,
        }  # fmt: skip

    def _look(self, x, p) -> None:
        """Gather what the terms read at x, p, unless they were looked at last."""
        if np.array_equal(x, self._at[0]) and np.array_equal(p, self._at[1]):
            return
        self._at, self._found = (x.copy(), p.copy()), None
        self._unknowns.gather(x * self._scale)
        self._given.gather(p)

    # -- functions on all instances ---------------------------------------------------
    @cached_property
    def _first(self) -> list:
        found, several = self._first_results, len(self.terms)
        return [
            _on_instances(
                term.function.first, term.instances,
                (self._unknowns.of(k), self._given.of(k)),
                (found.of(k), found.of(several + k)),
            )
            for k, term in enumerate(self.terms)
        ]  # fmt: skip

    @cached_property
    def _second(self) -> list:
        return [
            _on_instances(
                term.function.second, term.instances,
                (self._unknowns.of(k), self._given.of(k), self._weights.of(k)),
                (self._second_results.of(k),),
            )
            for k, term in enumerate(self.terms)
        ]  # fmt: skip

    # -- where results belong ---------------------------------------------------------
    def _add_up_values_and_slopes(self) -> None:
        """Set what sums f, its gradient and the Jacobian, and where g is read."""
        n, found, several = len(self._scale), self._first_results, len(self.terms)
        sums, jacobian, constraints = [], [], [np.zeros(0, int)]
        for k, term in enumerate(self.terms):
            self._deadline.check()
            values, slopes = found.places(k), found.places(several + k)
            row, column = term.jacobian_places
            factors = self._scale[column]
            if term.role is None:
                constraints.append(values)
                jacobian.append((row + term.first_row, column, factors, slopes))
            else:
                sums.append((np.zeros(len(values), int), np.ones(len(values)), values))
                sums.append((1 + column, factors, slopes))
        self._constraints = np.concatenate(constraints)
        self.jacobian, *places = _scattered(jacobian, (self._rows, n))
        sums.append((1 + n + places[0], *places[1:]))
        size = 1 + n + self.jacobian.nnz(), len(found.whole)
        self._sums = _sums(*_joined(sums, 3), size)

    def _add_up_curves(self) -> None:
        n, found, hessian = len(self._scale), self._second_results, []
        for k, term in enumerate(self.terms):
            self._deadline.check()
            i, j, factor = term.hessian_places
            factors = self._scale[i] * self._scale[j] * factor
            hessian.append((i, j, factors, found.places(k)))
        self.hessian, *places = _scattered(hessian, (n, n))
        self._second_sums = _sums(*places, (self.hessian.nnz(), len(found.whole)))


class _Gathered:
    """What the instances of all terms read, one term after the other.

    indices: of each term (instances, numbers), into the vector that `gather` is given.
    """

    def __init__(self, indices: list[np.ndarray]):
        indices = [one[_filled(len(one))].ravel() for one in indices]
        self._starts = np.cumsum([0, *map(len, indices)])
        self._indices = np.concatenate([np.zeros(0, int), *indices])
        self.whole = np.zeros(len(self._indices))

    def gather(self, vector: np.ndarray) -> None:
        np.take(vector, self._indices, out=self.whole, mode="clip")

    def of(self, k: int) -> np.ndarray:
        return self.whole[self._starts[k] : self._starts[k + 1]]


class _Results:
    """What functions return, one after the other: `numbers` for each instance."""

    def __init__(self, terms: list, numbers: list[int]):
        self._lengths = [t.instances * n for t, n in zip(terms, numbers, strict=True)]
        padded = [_padded(t.instances) * n for t, n in zip(terms, numbers, strict=True)]
        self._starts = np.cumsum([0, *padded])
        self.whole = np.zeros(int(self._starts[-1]))

    def of(self, k: int) -> np.ndarray:
        return self.whole[self._starts[k] : self._starts[k + 1]]

    def places(self, k: int) -> np.ndarray:
        """Return where the results of the instances are, which are the first."""
        return self._starts[k] + np.arange(self._lengths[k])


def _padded(instances: int) -> int:
    return -(-instances // WIDTH) * WIDTH


def _filled(instances: int) -> np.ndarray:
    """Return the numbers of instances, the last one again until calls are full."""
    return np.minimum(np.arange(_padded(instances)), instances - 1)


def _multipliers_of(term) -> np.ndarray:
    """Return which of (lam_f, lam_g) weighs each row of each instance."""
    shape = term.instances, term.function.rows
    if term.role is not None:
        return np.zeros(shape, int)
    return 1 + term.first_row + np.arange(term.rows).reshape(shape)


def _on_instances(function: ca.Function, instances: int, given, found) -> tuple:
    """Return what applies a term's function to all instances, and what it needs alive.

    given, found: slices of arrays that it reads and writes.
    """
    width = function.size2_in(0)
    calls = -(-instances // width)
    buffer, evaluate = function.map(calls).buffer()
    for k, array in enumerate(given):
        if size := function.size1_in(k) * width * calls:
            buffer.set_arg(k, memoryview(array[:size]))
    for k, array in enumerate(found):
        if size := function.size1_out(k) * width * calls:
            buffer.set_res(k, memoryview(array[:size]))
    return evaluate, buffer


def _joined(parts: list[tuple], count: int) -> list[np.ndarray]:
    """Return the `count` arrays of all parts, those of a kind one after the other."""
    columns = zip(*parts, strict=True) if parts else [[np.zeros(0, int)]] * count
    return [np.concatenate([*column]) for column in columns]


def _sums(target, factors, read, shape) -> sp.csr_matrix:
    """Return the matrix that adds up what is read, times factors, at each target."""
    return sp.csr_matrix((factors, (target, read)), shape)


def _scattered(parts, shape: tuple[int, int]) -> tuple:
    """Return the pattern of what stands at (row, column), and arguments of `_sums`.

    parts: rows, columns, factors, and where the numbers are read.  A target is a
    nonzero of the pattern, which several numbers may share.
    """
    rows, columns, factors, read = _joined(parts, 4)
    keys = columns.astype(np.int64) * shape[0] + rows  # column by column, as CasADi's
    places, target = np.unique(keys, return_inverse=True)
    column, row = np.divmod(places, max(1, shape[0]))
    start = np.searchsorted(column, np.arange(shape[1] + 1))
    pattern = ca.Sparsity(*shape, start.tolist(), row.tolist())
    return pattern, target, factors, read
