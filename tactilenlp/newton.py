r"""How far a problem is from its optimum, judged by one Newton step.

    [ H  A' ] [ d  ]   [ -g ]        H = nabla^2 L,  g = nabla L  at multipliers lam
    [ A  0  ] [ nu ] = [  0 ]        A: constraints and bounds that are active

The decrement -g' d / 2 is what the objective would fall by if it were quadratic, d how
the unknowns would move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from .lagrangian import gradient
from .saddle import factorised


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
