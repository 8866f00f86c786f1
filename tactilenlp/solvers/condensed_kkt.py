"""The matrix of a Newton step of an interior-point method, slacks eliminated.

    min f(x)   s.t.  g(x) - s = 0,   h(x) = 0,   bounds of x and s

    [ H + S_x      0     J'   A' ] [dx]     [ r_x ]
    [    0        S_s   -I    0  ] [ds] = - [ r_s ]     S = z / distance from the bound
    [    J        -I     0    0  ] [dy]     [ r_c ]
    [    A         0     0    0  ] [dv]     [ r_h ]

S_s > 0 can be inverted:

    [ H + S_x + J' S_s J   A' ] [dx]
    [          A           0  ] [dv] = right-hand side

The whole matrix has the inertia that a minimum needs exactly if this one has as many
eigenvalues below zero as there are equations h (Nocedal and Wright, Numerical
Optimization, 2006, chapter 19).  Equations, what they read and unknowns that many
others are coupled to are the border of its factors.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..nlp.assembly import distinct_places
from ..nlp.kkt import read_by_many
from .bordered_ldl import BorderedLdl

# Fewer rows are left among the sparse ones: a sparse page has 4 to 10, whose fill-in
# costs less than the calls for a dense matrix; a dense page has 70 and more.
LEAST_BORDER = 20


class CondensedKkt:
    """The matrix of patterns that do not change.

    hessian: pattern of the upper triangle (n, n); jacobian: pattern (m, n) of g and h;
    equal (m,): which rows are equations.  shape: (m, n); size: how many values the
    upper triangle of the matrix has.
    """

    def __init__(self, hessian: ca.Sparsity, jacobian: ca.Sparsity, equal: np.ndarray):
        n, self.shape, self.equal = hessian.size1(), jacobian.shape, equal
        self.jacobian_rows = np.array(jacobian.row(), int)
        self.jacobian_columns = np.array(jacobian.get_col(), int)
        left, right = _pairs_of_a_row(self.jacobian_rows, jacobian.size1())
        upper = self.jacobian_columns[left] <= self.jacobian_columns[right]
        upper &= ~equal[self.jacobian_rows[left]]
        self._pairs = left[upper], right[upper]
        self._row = self.jacobian_rows[self._pairs[0]]
        self._tied = np.flatnonzero(equal[self.jacobian_rows])
        tied = self.jacobian_columns[self._tied]
        equation = n + (np.cumsum(equal) - 1)[self.jacobian_rows[self._tied]]
        whole = n + int(equal.sum())
        i, j = (self.jacobian_columns[k] for k in self._pairs)
        rows = np.r_[hessian.row(), i, np.arange(whole), tied]
        columns = np.r_[hessian.get_col(), j, np.arange(whole), equation]
        distinct = distinct_places(rows, columns, (whole, whole))
        self._rows, self._columns, self._place = distinct
        self._diagonal = self._place[hessian.nnz() + len(i) :][:n]
        self._zero = np.zeros(hessian.nnz()), np.zeros(whole - n)
        many = read_by_many(np.bincount(np.r_[self._rows, self._columns]))
        border = many & (np.count_nonzero(many) >= LEAST_BORDER)
        border[n:] = border[tied] = True
        self._ldl = BorderedLdl(self._rows, self._columns, border, negative=whole - n)
        self.size = len(self._rows)

    def times(self, jacobian: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return J x, (m,); jacobian (k,): nonzeros of J."""
        products = jacobian * x[self.jacobian_columns]
        return np.bincount(self.jacobian_rows, products, self.shape[0])

    def transposed_times(self, jacobian: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return J' y, (n,)."""
        products = jacobian * y[self.jacobian_rows]
        return np.bincount(self.jacobian_columns, products, self.shape[1])

    def entries_of(self, fixed: np.ndarray) -> tuple:
        """Return the entries in rows and columns of fixed unknowns (n,), the pivots."""
        whole = np.concatenate((fixed, np.zeros(len(self._zero[1]), bool)))
        entries = np.flatnonzero(whole[self._rows] | whole[self._columns])
        return entries, self._diagonal[fixed]

    def matrix(self, hessian, jacobian, in_x, in_s, left_out) -> np.ndarray:
        """Return the values of the matrix; S_x (n,), S_s (m,).

        hessian, jacobian: nonzeros; left_out: of unknowns that are fixed, `entries_of`.
        """
        left, right = self._pairs
        products = in_s[self._row] * jacobian[left] * jacobian[right]
        parts = hessian, products, in_x, self._zero[1], jacobian[self._tied]
        values = np.bincount(self._place, np.concatenate(parts), self.size)
        entries, pivots = left_out
        values[entries] = 0.0
        values[pivots] = 1.0
        return values

    def unit(self, jacobian, left_out, in_s: float = 1.0) -> np.ndarray:
        """Return the matrix of 1 in place of H + S_x, and in_s in place of S_s."""
        m, n = self.shape
        in_s = np.full(m, in_s)
        return self.matrix(self._zero[0], jacobian, np.ones(n), in_s, left_out)

    def least_squares(self, jacobian, slope, left_out) -> np.ndarray:
        """Return v, of each equation, that makes slope + A' v smallest, else zeros."""
        none = self._zero[1]
        if len(none) and self.factorise(self.unit(jacobian, left_out, in_s=0.0)):
            return self.solve(-slope, none)[1]
        return none

    def factorise(self, values: np.ndarray) -> bool:
        """Factorise a `matrix`; tell whether its inertia is that of a minimum."""
        return self._ldl.factorise(values)

    def solve(self, of_x: np.ndarray, of_h: np.ndarray) -> tuple:
        """Return dx, dv for the right-hand sides of x and of the equations."""
        step = self._ldl.solve(np.concatenate((of_x, of_h)))
        return step[: len(of_x)], step[len(of_x) :]


def _pairs_of_a_row(rows: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return all ordered pairs (k, l) of nonzeros that stand in one row."""
    by_row = np.argsort(rows, kind="stable")
    lengths = np.bincount(rows, minlength=count)
    each = lengths[rows[by_row]]
    left = np.repeat(by_row, each)
    starts = np.cumsum(lengths) - lengths
    first = np.repeat(starts[rows[by_row]], each)
    within = np.arange(len(left)) - np.repeat(np.cumsum(each) - each, each)
    return left, by_row[first + within]
