"""L D L' of sparse symmetric matrices that should be positive definite.

Compiled C (sparse_ldl.c) where there is a compiler; else CasADi's `ldl`, the same
method at a tenth of the speed, whose results differ by rounding.  A pivot that is not
positive ends a factorisation: that is the test of inertia of an interior-point method.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.resources import files

import casadi as ca
import numpy as np

from ..nlp.assembly import order_by_column
from ..nlp.codegen import library

SOURCE = "sparse_ldl.c"


class SparseLdl:
    """Factorise matrices of one pattern, in an order of little fill-in (AMD).

    rows, columns (k,): places of the upper triangle, each once, all of the diagonal
    among them; n: rows of the matrix.
    """

    def __init__(self, n: int, rows: np.ndarray, columns: np.ndarray):
        both = np.r_[rows, columns].tolist(), np.r_[columns, rows].tolist()
        whole = ca.Sparsity.triplet(n, n, *both)  # the diagonal is given twice
        factor, order = whole.ldl(True)
        self._order = np.array(order)
        place = np.empty(n, int)
        place[self._order] = np.arange(n)
        i, j = place[rows], place[columns]
        i, j = np.minimum(i, j), np.maximum(i, j)
        self._from = order_by_column(i, j, n)  # of the ordered upper triangle
        upper = ca.Sparsity.triplet(n, n, i.tolist(), j.tolist())
        self.n = n
        method = _Casadi if _functions() is None else _Compiled
        self._method = method(upper, factor)

    def factorise(self, values: np.ndarray) -> bool:
        """Factorise the matrix with these values (k,); False unless it is positive."""
        return self._method.factorise(values[self._from])

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solutions for right-hand sides (n,) or (n, k)."""
        out = np.empty(right.shape)
        out[self._order] = self._method.solve(right[self._order])
        return out


class _Compiled:
    def __init__(self, upper: ca.Sparsity, factor: ca.Sparsity):
        self._factorise, self._substitute = _functions()
        n = upper.size1()
        self._values = np.zeros(upper.nnz())
        lower, pivots, work = (np.zeros(k) for k in (factor.nnz(), n, n))
        patterns = [np.array(a, np.intc) for s in (upper, factor)
                    for a in (s.colind(), s.row())]  # fmt: skip
        a_start, a_row, l_start, l_row = map(_address, patterns)
        factors = l_start, l_row, _address(lower), _address(pivots)
        matrix = a_start, a_row, _address(self._values)
        self._matrix = n, *matrix, *factors, _address(work)
        self._factors = n, *factors
        self._alive = patterns, lower, pivots, work  # while their addresses are used

    def factorise(self, values) -> bool:
        """Factorise the matrix with nonzeros (nnz,); False unless it is positive."""
        self._values[:] = values
        return self._factorise(*self._matrix) == 0

    def solve(self, right) -> np.ndarray:
        """Return the solution of right-hand sides (n,) or (n, k)."""
        x = np.array(right, order="C")
        self._substitute(*self._factors, ctypes.c_long(x[:1].size), _address(x))
        return x


class _Casadi:
    def __init__(self, upper: ca.Sparsity, factor: ca.Sparsity):
        whole = upper + upper.T
        self._whole = whole
        rows, columns = np.array(whole.row()), np.array(whole.get_col())
        keys = np.maximum(rows, columns) * upper.size1() + np.minimum(rows, columns)
        kept = np.array(upper.get_col()) * upper.size1() + np.array(upper.row())
        self._from = np.searchsorted(kept, keys)
        self._linear = ca.Linsol("ldl", "ldl", whole, {"preordering": False})
        self._matrix = ca.DM(whole)

    def factorise(self, values) -> bool:
        """Factorise the matrix with nonzeros (nnz,); False unless it is positive."""
        self._matrix = ca.DM(self._whole, values[self._from])
        self._linear.nfact(self._matrix)
        return bool(np.isfinite(values).all()) and not self._linear.neig(self._matrix)

    def solve(self, right) -> np.ndarray:
        """Return the solution of right-hand sides (n,) or (n, k)."""
        x = self._linear.solve(self._matrix, ca.DM(right))
        return np.asarray(x).reshape(right.shape)


def _address(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


@cache
def _functions() -> tuple | None:
    """Return the two functions of the compiled library, or None without a compiler."""
    compiled = library((files(__package__) / SOURCE).read_text())
    if compiled is None:
        return None
    return compiled.tactilenlp_factorise, compiled.tactilenlp_substitute
