r"""Factorise the matrix of a solved programme, in time linear in its samples.

    K = [ H + l 1   A'   ]        l keeps what nothing sees from being singular
        [   A     - l 1 ]

Samples are coupled to their neighbours, and all of them to a few unknowns that they
share (sizes, depth of touch).  Eliminated with the rest, these would fill the factors
in; so they are the border, and solved for last:

    K = [ C  B ]       S = D - B' C^{-1} B
        [ B' D ]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

LOOSE = 1e-9  # [1 / scaled unknown^2] of a direction that nothing sees
WIDE = 4.0  # [-] times the entries of a median column, and it is of the border


@dataclass(frozen=True, eq=False)
class Saddle:
    """A factorised K; `solve` answers right sides (n + m,) or (n + m, k)."""

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


def factorised(H, A) -> Saddle:
    """Factorise K of scaled H (n, n), symmetric, and A (m, n), rows of unit length."""
    n, m = H.shape[0], A.shape[0]
    H, floor = H + LOOSE * sp.identity(n), -LOOSE * sp.identity(m)
    K = sp.bmat([[H, A.T], [A, floor]], format="csc")
    counts = np.diff(K.indptr)
    wide = counts > WIDE * np.median(counts)
    inner, border = np.nonzero(~wide)[0], np.nonzero(wide)[0]
    core = splu(K[inner][:, inner].tocsc())
    B, D = K[inner][:, border].toarray(), K[border][:, border].toarray()
    reach = core.solve(B)
    return Saddle(inner, border, core, B, reach, D - B.T @ reach)
