r"""How far off an estimate may be where what it weighs together disagrees.

At an optimum the gradients of all terms add up to nothing: those of the touches of one
finger in one action, and the forces that physics puts on the poses of one action, are
balanced by all the rest.  Each of these groups g errs as a whole: a wrong pose moves
all of its touches, a wrong coefficient of friction all of its impulses.  Hence

    K^{-1} ( sum_g  s_g s_g' ) K^{-1},        s_g = sum of the gradients of the group,

the middle of a sandwich whose errors are shared within a group (cluster-robust, Liang
and Zeger 1986): small where all say the same, large where they pull at each other.
"""

from __future__ import annotations

import numpy as np

from .curvature import Curvature


def tension(curvature: Curvature, pulls, window, action) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns that disagreement tells, SI.

    pulls: see Curvature.response_of; action (T,): of every sample.
    """
    groups = [*_touches(curvature, window, action)]
    groups += _physics(curvature, window, action)
    moved = np.array([pulls.T @ s for s in groups]).reshape(-1, pulls.shape[1])
    return moved.T @ moved


def _touches(curvature, window, action):
    """Return the gradients (n,) of the touches of each finger in each action."""
    if "touch" not in curvature.problem.terms:
        return
    each = curvature.problem.jacobian("touch", curvature.x, curvature.data)
    touch = window.touch
    key = np.stack([action[touch.sample], touch.finger])
    for pair in np.unique(key, axis=1).T:
        yield _sum(each[np.flatnonzero((key == pair[:, None]).all(axis=0))])


def _physics(curvature, window, action) -> list[np.ndarray]:
    """Return what physics pulls (n,) at the poses of each action, and at the rest."""
    problem = curvature.problem
    pull = np.zeros(problem.size)
    for name, term in problem.costs.items():
        if term.role == "physics":
            pull += _sum(problem.jacobian(name, curvature.x, curvature.data))
    for name in problem.constraints:
        slope = problem.jacobian(name, curvature.x, curvature.data)
        pull += slope.T @ curvature.multipliers[name].ravel()
    x, of = problem.variables["x"], np.full(problem.size, -1)
    of[x.span] = np.repeat(action[window.last], x.rows)
    return [np.where(of == a, pull, 0.0) for a in np.unique(of)]


def _sum(rows) -> np.ndarray:
    return np.asarray(rows.sum(axis=0)).ravel()
