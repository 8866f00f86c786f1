"""The Lagrangian of a problem: the sum of its costs, and of multipliers times rows.

Factorise the matrix of a solved programme, in time linear in its samples.

    K = [ H + l 1   A'   ]        l keeps what nothing sees from being singular
        [   A     - l 1 ]

Samples are coupled to their neighbours, and all of them to a few unknowns that they
share (sizes, depth of touch).  Eliminated with the rest, these would fill the factors
in; so they are the border, and solved for last:

    K = [ C  B ]       S = D - B' C^{-1} B
        [ B' D ]

How far a problem is from its optimum, judged by one Newton step.

    [ H  A' ] [ d  ]   [ -g ]        H = nabla^2 L,  g = nabla L  at multipliers lam
    [ A  0  ] [ nu ] = [  0 ]        A: constraints and bounds that are active

The decrement -g' d / 2 is what the objective would fall by if it were quadratic, d how
the unknowns would move.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

NONE: Mapping[str, np.ndarray] = {}
LOOSE = 1e-9  # [1 / scaled unknown^2] of a direction that nothing sees
WIDE = 4.0  # [-] times the entries of a median column, and it is of the border


def gradient(problem, x, data, multipliers=NONE, costs=None) -> np.ndarray:
    """Return nabla L (unknowns,), SI, at x (unknowns,) SI.

    multipliers: by constraint; with none of them, the gradient of the costs alone;
    costs: names of those that count, by default all.
    """
    g = np.zeros(problem.size)
    for name in problem.costs if costs is None else costs:
        g += np.asarray(problem.jacobian(name, x, data).sum(axis=0)).ravel()
    for name, multiplier in multipliers.items():
        g += problem.jacobian(name, x, data).T @ np.ravel(multiplier)
    return g


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


@dataclass(frozen=True, eq=False)
class Step:
    """A Newton step: what it would gain [nats], and by how many sigma it would move.

    shift (chosen,) [-] of the chosen unknowns, NaN where there is no minimum; step
    (unknowns,) of all, SI.
    """

    decrement: float
    shift: np.ndarray
    step: np.ndarray


def newton_step(problem, x, data, multipliers, pulls, held, chosen) -> Step:
    """Return the Newton step of a problem at x, with some unknowns held.

    x (unknowns,) SI; multipliers by constraint; pulls (unknowns,) of the bounds; held:
    indices of unknowns that do not move; chosen: those whose shift is asked for.
    """
    scale = problem.scale
    g = pulls + gradient(problem, x, data, multipliers)
    H, rows = sp.csc_matrix((problem.size,) * 2), []
    for name in problem.costs:
        H = H + problem.hessian(name, x, data)
    for name, term in problem.constraints.items():
        multiplier = multipliers[name]
        jacobian = problem.jacobian(name, x, data)
        H = H + problem.hessian(name, x, data, multiplier)
        value = problem.value(name, x, data)
        slack = np.minimum(value - term.lower, term.upper - value).ravel()
        rows.append(jacobian[np.abs(multiplier).ravel() > slack])
    slack = np.minimum(x - problem.bounds("lower"), problem.bounds("upper") - x) / scale
    fixed = np.abs(pulls) * scale > slack
    fixed[held] = True
    g[fixed] = 0.0  # their bounds push back
    A = sp.vstack([*rows, sp.identity(len(x), format="csr")[np.nonzero(fixed)[0]]])
    D = sp.diags(scale)
    found = _solved(D @ H @ D, A @ D, scale * g, chosen)
    return replace(found, step=scale * found.step)


def _solved(H, A, g, chosen) -> Step:
    n, m = H.shape[0], A.shape[0]
    norms = np.sqrt(np.asarray(A.multiply(A).sum(axis=1)).ravel())
    A = sp.diags(1 / np.maximum(norms, 1e-12)) @ A
    right = np.zeros((n + m, 1 + len(chosen)))
    right[:n, 0] = -g
    right[chosen, 1 + np.arange(len(chosen))] = 1.0
    found = factorised(H, A).solve(right)[:n]
    variance = np.diag(found[chosen, 1:]).copy()
    variance[variance <= 0] = np.nan
    step = found[:, 0]
    return Step(float(-g @ step) / 2, step[chosen] / np.sqrt(variance), step)
