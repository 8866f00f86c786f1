"""Summarise solved actions by a Gaussian: what they say of the body and its last pose.

Near a page's optimum its objective over the unknowns that later actions share,
c = (theta, other numbers of the body, last pose), all others minimised out, is

    f(c) = f* + |U (c - c*)|^2 / 2,     U'U = (E' K^-1 E)^-1

with K the Hessian of the Lagrangian plus the curvature of the barrier, multiplier over
slack, of constraints and bounds.  The others follow c by K^-1 E (E' K^-1 E)^-1.
A page with this in place of the past costs as little as its last action.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

LOOSE = 1e-6  # [1 / scaled unknown^2] of a direction that nothing sees
PINNED = 1e10  # [1 / scaled unknown^2] of one that cannot move
IMPULSE = "N s"  # unit of what belongs to a step, be it the only one
HELD = 1e8  # [1 / scaled unknown^2] across an equality
SLACK = 1e-9  # [-] least slack that a multiplier is divided by


@dataclass(frozen=True, eq=False)
class Past:
    """The Gaussian of the shared unknowns c (d,), and how all others follow them.

    names (d,): the variable of each; mean (d,), covariance (d, d), SI; along: what a
    change of c does, by name, (rows, columns, d); knot (T,): the pose of each sample.
    """

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    along: dict[str, np.ndarray]
    knot: np.ndarray

    def rows(self, name: str) -> np.ndarray:
        """Return where a variable's numbers are in c."""
        return np.nonzero(np.array(self.names) == name)[0]

    def settings(self, problem) -> dict:
        """Return the parameters of `remember` in a problem that shares these."""
        names = [*dict.fromkeys(n for n, _ in _shared(problem, 0))]
        picked = np.concatenate([self.rows(name) for name in names])
        C = self.covariance[np.ix_(picked, picked)]
        s = np.sqrt(np.diag(C))
        root = np.linalg.inv(np.linalg.cholesky(C / np.outer(s, s))) / s
        return {"past mean": self.mean[picked], "past root": root.T.ravel()}


def _shared(problem, column: int) -> list[tuple[str, int]]:
    """Return (name, index) of what belongs to the body, then of one pose."""
    body = [
        v[:, [0]] for v in problem.variables.values()
        if v.name == "theta"
        or (v.name != "x" and v.unit != IMPULSE and v.rows == v.columns == 1)
    ]  # fmt: skip
    chosen = [*body, problem.variables["x"][:, [column]]]
    return [(c.variable.name, int(i)) for c in chosen for i in c.indices[0]]


def summarise(problem, knot, hypothesis, values, data) -> Past:
    """Return the Gaussian of a problem at `values` of its unknowns.

    knot (T,): the pose of every sample; hypothesis: carries the multipliers, if any.
    """
    x, scale = problem.pack(values), problem.scale
    names, chosen = zip(*_shared(problem, -1), strict=True)
    chosen = np.array(chosen)
    K = _curvature(problem, hypothesis, x, data) + LOOSE * sp.identity(len(x))
    E = np.zeros((len(x), len(chosen)))
    E[chosen, np.arange(len(chosen))] = 1.0
    C = splu(K.tocsc()).solve(E)
    variance, ways = np.linalg.eigh((C[chosen] + C[chosen].T) / 2)
    variance = np.clip(np.abs(variance), 1 / PINNED, 1 / LOOSE)
    s = scale[chosen]
    along = (C @ (ways / variance) @ ways.T) * scale[:, None] / s
    along = {
        v.name: along[v.span].reshape(v.columns, v.rows, -1).transpose(1, 0, 2)
        for v in problem.variables.values()
    }
    covariance = (ways * variance) @ ways.T * np.outer(s, s)
    return Past(names, x[chosen], covariance, along, knot)


def _curvature(problem, hypothesis, x, data):
    """Return the scaled Hessian of the Lagrangian and of the barrier."""
    D, scale = sp.diags(problem.scale), problem.scale
    H = sum(problem.hessian(name, x, data) for name in problem.costs)
    barrier = sp.csc_matrix(H.shape)
    for name, multiplier in hypothesis.multipliers.items():
        term = problem.constraints[name]
        H = H + problem.hessian(name, x, data, multiplier)
        value = problem.value(name, x, data)
        slack = np.minimum(value - term.lower, term.upper - value).ravel()
        A = problem.jacobian(name, x, data) @ D
        length = np.asarray(A.multiply(A).sum(axis=1)).ravel()
        equal = np.ravel(term.lower == term.upper)
        stiff = _stiffness(multiplier.ravel(), slack)
        stiff[equal] = HELD / np.maximum(length[equal], SLACK)
        barrier = barrier + A.T @ sp.diags(stiff) @ A
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    pulls = {v.name: np.zeros((v.rows, v.columns)) for v in problem.variables.values()}
    pulls = problem.pack({**pulls, **hypothesis.bound_multipliers}) * scale
    stiff = _stiffness(pulls, np.minimum(x - lower, upper - x) / scale)
    return D @ H @ D + barrier + sp.diags(stiff)


def _stiffness(multiplier, slack) -> np.ndarray:
    return np.minimum(np.abs(multiplier) / np.maximum(slack, SLACK), PINNED)


def remember(problem) -> None:
    """Put the Gaussian of the past into the problem of a new action.

    Its first pose is the last one of the past; priors of what is shared are in it.
    Its parameters are `Past.settings`.
    """
    names, chosen = zip(*_shared(problem, 0), strict=True)
    for name, term in [*problem.costs.items()]:
        if term.role == "prior" and np.isin(term.unknowns, chosen).all():
            del problem.costs[name]
    d = len(chosen)
    mean = problem.parameter("past mean", np.zeros(d))
    root = problem.parameter("past root", np.eye(d).ravel())

    def past(*given):
        *c, mean, root = given
        return ca.sumsqr(ca.reshape(root, d, d) @ (ca.vertcat(*c) - mean)) / 2

    body = [problem.variables[n] for n in dict.fromkeys(names) if n != "x"]
    pose = problem.variables["x"][:, [0]]
    problem.minimize("past", past, *body, pose, mean, root, role="prior")
