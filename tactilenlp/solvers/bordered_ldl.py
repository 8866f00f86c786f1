"""Factorisation of sparse symmetric matrices with a border of dense rows.

    [ C   B ]     C: sparse, must be positive definite
    [ B'  D ]     S = D - B' C^-1 B: dense, must have a given number of eigenvalues < 0

By Haynsworth's formula (Linear Algebra Appl. 1, 1968) the inertia of the whole matrix
is the sum of those of C and S.  Unknowns that many others are coupled to, such as the
parameters of a body, would fill the factors of C in, and a dense S is factorised at the
speed of the machine.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dsytrf, dsytrs

from .sparse_ldl import SparseLdl


class BorderedLdl:
    """Factorise matrices of one pattern.

    rows, columns (k,): places of the upper triangle, each once, all of the diagonal
    among them; border (n,): which rows are the border; negative: eigenvalues below zero
    that the matrix must have.
    """

    def __init__(self, rows, columns, border: np.ndarray, negative: int = 0):
        inner = ~border
        number = np.where(border, np.cumsum(border), np.cumsum(inner)) - 1
        self._inner, self._border = np.flatnonzero(inner), np.flatnonzero(border)
        self._negative = negative
        within = inner[rows] & inner[columns]
        beside = inner[rows] ^ inner[columns]
        self._in_core = np.flatnonzero(within)
        self._in_sides = np.flatnonzero(beside)
        self._in_corner = np.flatnonzero(~within & ~beside)
        i, j = number[rows], number[columns]
        self._core = SparseLdl(len(self._inner), i[within], j[within])
        swapped = border[rows[beside]]
        side = np.where(swapped, j[beside], i[beside])
        self._sides = side, np.where(swapped, i[beside], j[beside])
        corner = i[self._in_corner], j[self._in_corner]
        self._corner = np.minimum(*corner), np.maximum(*corner)

    def factorise(self, values: np.ndarray) -> bool:
        """Factorise the matrix of these values (k,); False if its inertia is wrong."""
        count = len(self._border)
        if not count:
            return self._core.factorise(values)
        if not self._core.factorise(values[self._in_core]):
            return False
        self._B = np.zeros((len(self._inner), count))
        self._B[self._sides] = values[self._in_sides]
        S = np.zeros((count, count))
        S[self._corner] = values[self._in_corner]
        self._reach = self._core.solve(self._B)
        S -= self._B.T @ self._reach  # the upper triangle is read
        self._S, self._pivots, failed = dsytrf(S)
        if failed or not np.isfinite(self._S).all():
            return False
        return _below_zero(self._S, self._pivots) == self._negative

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution for a right-hand side (n,)."""
        if not len(self._border):
            return self._core.solve(right)
        out = np.empty(len(right))
        core = self._core.solve(right[self._inner])
        rest = right[self._border] - self._B.T @ core
        out[self._border], _ = dsytrs(self._S, self._pivots, rest)
        out[self._inner] = core - self._reach @ out[self._border]
        return out


def _below_zero(factors: np.ndarray, pivots: np.ndarray) -> int:
    """Return how many eigenvalues below zero the factors of dsytrf stand for.

    A block of two rows, whose pivots are negative numbers, has one.
    """
    single = pivots > 0
    return int((np.diag(factors)[single] < 0).sum() + (~single).sum() // 2)
