"""Bordered factorisation of KKT matrices, in time linear in the samples.

    K = [ H + l 1   A'   ]        l > 0 keeps unobserved directions from making
        [   A     - l 1 ]         the matrix singular (LEAST_CURVATURE)

The unknowns of a sample are coupled to those of its neighbours and to a few that all
samples share (sizes, depth of touch).  Eliminated together with the rest, the shared
ones would fill the factors in; so they form the border and are solved for last, by the
Schur complement S:

    K = [ C  B ]       S = D - B' C^{-1} B
        [ B' D ]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from .term_functions import applied

LEAST_CURVATURE = 1e-9  # [1 / scaled unknown^2] l, far below that of measured unknowns
BORDER_ENTRIES = 4.0  # [-] times the entries of the median column: part of the border


def gradient(problem, x, data, weights) -> np.ndarray:
    """Return the gradient (unknowns,) of a sum of terms at x (unknowns,), both SI.

    weights: by term, one for all its rows or one for each; or names, of weight 1.
    """
    weights = weights if isinstance(weights, Mapping) else dict.fromkeys(weights, 1.0)
    g = np.zeros(problem.size)
    for name, weight in weights.items():
        term = problem.terms[name]
        rows, columns = term.jacobian_places
        slopes = np.asarray(applied(term, "first", x, data)[1]).T.ravel()
        weight = np.broadcast_to(np.ravel(weight), term.rows)
        g += np.bincount(columns, slopes * weight[rows], problem.size)
    return g


@dataclass(frozen=True, eq=False)
class BorderedFactors:
    """The factors of K: `solve` takes right sides (n + m,) or (n + m, k).

    inner, border: indices of the rows of C and of D; core: LU factors of C; reach:
    C^{-1} B.
    """

    inner: np.ndarray
    border: np.ndarray
    core: object
    B: np.ndarray
    reach: np.ndarray
    S: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return K^{-1} right, to the accuracy of the factors."""
        answer = np.empty(right.shape)
        inner = self.core.solve(np.ascontiguousarray(right[self.inner]))
        answer[self.border] = np.linalg.solve(
            self.S, right[self.border] - self.B.T @ inner
        )
        answer[self.inner] = inner - self.reach @ answer[self.border]
        return answer


def factorise(H, A) -> BorderedFactors:
    """Factorise K of scaled H (n, n), symmetric, and A (m, n), rows of unit length."""
    n, m = H.shape[0], A.shape[0]
    H, floor = H + LEAST_CURVATURE * sp.identity(n), -LEAST_CURVATURE * sp.identity(m)
    K = sp.bmat([[H, A.T], [A, floor]], format="csc")
    counts = np.diff(K.indptr)
    wide = counts > BORDER_ENTRIES * np.median(counts)
    inner, border = np.nonzero(~wide)[0], np.nonzero(wide)[0]
    core = splu(K[inner][:, inner].tocsc())
    B, D = K[inner][:, border].toarray(), K[border][:, border].toarray()
    reach = core.solve(B)
    return BorderedFactors(inner, border, core, B, reach, D - B.T @ reach)
