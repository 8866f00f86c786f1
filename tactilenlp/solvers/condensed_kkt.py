"""The matrix of a Newton step of an interior-point method, slacks eliminated.

    min f(x)   s.t.  g(x) - s = 0,   bounds of x and s

    [ H + S_x      0     J' ] [dx]     [ r_x ]
    [    0        S_s   -I  ] [ds] = - [ r_s ]       S = z / distance from the bound
    [    J        -I     0  ] [dy]     [ r_c ]

Without equalities S_s > 0 can be inverted:  (H + S_x + J' S_s J) dx = right-hand side.
The whole matrix has the inertia that a minimum needs exactly if this one is positive
definite (Nocedal and Wright, Numerical Optimization, 2006, chapter 19).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from .sparse_ldl import SparseLdl


class CondensedKkt:
    """H + diag(S_x) + J' diag(S_s) J of patterns that do not change.

    hessian: pattern of the upper triangle (n, n); jacobian: pattern (m, n).  shape:
    (m, n); size: how many values the upper triangle of the matrix has.
    """

    def __init__(self, hessian: ca.Sparsity, jacobian: ca.Sparsity):
        n = hessian.size1()
        self.jacobian_rows = np.array(jacobian.row(), int)
        self.jacobian_columns = np.array(jacobian.get_col(), int)
        left, right = _pairs_of_a_row(self.jacobian_rows, jacobian.size1())
        i, j = self.jacobian_columns[left], self.jacobian_columns[right]
        self._pairs = left[i <= j], right[i <= j]
        self._row = self.jacobian_rows[self._pairs[0]]
        rows = np.r_[hessian.row(), i[i <= j], np.arange(n)].astype(int)
        columns = np.r_[hessian.get_col(), j[i <= j], np.arange(n)].astype(int)
        places, inverse = np.unique(columns * n + rows, return_inverse=True)
        self._columns, self._rows = np.divmod(places, n)
        self._hessian, self._products, self._diagonal = np.split(
            inverse, [hessian.nnz(), hessian.nnz() + len(self._row)]
        )
        self._ldl = SparseLdl(n, self._rows, self._columns)
        self.shape, self.size = jacobian.shape, len(self._rows)

    def times(self, jacobian: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return J x, (m,); jacobian (k,): nonzeros of J."""
        products = jacobian * x[self.jacobian_columns]
        return np.bincount(self.jacobian_rows, products, self.shape[0])

    def transposed_times(self, jacobian: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return J' y, (n,)."""
        products = jacobian * y[self.jacobian_rows]
        return np.bincount(self.jacobian_columns, products, self.shape[1])

    def values(self, hessian: np.ndarray, fixed: np.ndarray) -> np.ndarray:
        """Return the Hessian's share of the matrix; fixed (n,): unknowns left out."""
        values = np.bincount(self._hessian, hessian, len(self._rows))
        if fixed.any():
            values[self._touches(fixed)] = 0
        return values

    def factorise(self, values, jacobian, in_x, in_s, fixed) -> bool:
        """Factorise the matrix; tell whether it is positive definite.

        values: of `values`; in_x (n,), in_s (m,): diagonals S_x, S_s; fixed (n,).
        """
        left, right = self._pairs
        products = in_s[self._row] * jacobian[left] * jacobian[right]
        values = values + np.bincount(self._products, products, len(values))
        if fixed.any():
            values[self._touches(fixed)] = 0
            in_x = np.where(fixed, 1.0, in_x)
        values[self._diagonal] += in_x
        return self._ldl.factorise(values)

    def solve(self, right: np.ndarray) -> np.ndarray:
        return self._ldl.solve(right)

    def _touches(self, fixed) -> np.ndarray:
        return fixed[self._rows] | fixed[self._columns]


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
