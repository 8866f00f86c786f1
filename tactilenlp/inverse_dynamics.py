r"""Past poses from the last one by inverted Jacobians of the dynamics, for comparison.

One sample's part of the programme, x_k and its impulses at given earlier poses, is a
time step; its derivative F_k = dx_k / dx_{k-1} (at the same velocity) is inverted to
carry what an early sample felt to the last pose,

    dx_{k-1} = F_k^{-1} (dx_k - dx_k/dtheta dtheta).

A finger that pushes decides where the object is, whatever it was before: F_k is nearly
singular along the push, and the product of inverses grows with every sample.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .curvature import Curvature
from .gauss_newton import local_hessians, scattered
from .paper_information import chained
from .saddle import LOOSE


def inverse_dynamics(curvature: Curvature, solution, window, shape) -> np.ndarray:
    """Return eq:obsinfo (k, k) with past poses by inverted Jacobians."""
    link, theta = links(curvature, window, shape)
    return chained(curvature.problem, solution, window, shape, link, theta)


def links(curvature: Curvature, window, shape) -> tuple[np.ndarray, np.ndarray]:
    """Return how each pose follows the last (poses, u, u), and the shape (.., u, n)."""
    u, n = window.motion.unknowns, shape.theta
    link = np.tile(np.eye(u), (window.poses, 1, 1))
    theta = np.zeros((window.poses, u, n))
    row = {int(k): i for i, k in enumerate(window.step.pose)}
    latest = _latest_knots(curvature, window)
    local = {name: local_hessians(curvature, name) for name in curvature.hessians}
    for k in range(window.poses - 1, 0, -1):
        link[k - 1], theta[k - 1] = link[k], theta[k]
        if k not in row:  # a gap between actions: the object stays
            continue
        H = sp.csc_matrix((curvature.problem.size,) * 2)
        for name, poses in latest.items():
            here = np.where((poses == k)[:, None, None], local[name], 0.0)
            if (poses == k).any():
                H = H + scattered(curvature, name, here)
        F, by_theta = _time_step(curvature, window, shape, H, row[k])
        back = np.linalg.inv(F)
        link[k - 1] = back @ link[k]
        theta[k - 1] = back @ (theta[k] - by_theta)
    return link, theta


def _time_step(curvature: Curvature, window, shape, H, s: int):
    """Return dx_k/dx_{k-1} (u, u) and dx_k/dtheta (u, n) of the step s."""
    problem, step = curvature.problem, window.step
    columns = problem.variables["x"][:, :].indices
    now = columns[step.pose[s]]
    impulses = [
        problem.variables[name][:, np.nonzero(rows.step == s)[0]].indices.ravel()
        for name, rows in (("finger", window.push), ("ground", window.corner))
        if name in problem.variables
    ]
    inside = np.concatenate([now, *impulses])
    before = columns[step.before[s]], columns[step.before_2[s]]
    given = problem.variables["theta"][:, :].indices.ravel()[: shape.theta]
    D = sp.diags(problem.scale)
    H, A = (D @ H @ D).tocsc(), curvature.A
    A = A[np.unique(A[:, inside].nonzero()[0])]
    K = sp.bmat(
        [
            [H[inside][:, inside] + LOOSE * sp.identity(len(inside)), A[:, inside].T],
            [A[:, inside], -LOOSE * sp.identity(A.shape[0])],
        ]
    ).toarray()
    outside = np.concatenate([*before, given])
    right = sp.vstack([H[inside][:, outside], A[:, outside]]).toarray()
    moved = -np.linalg.solve(K, right)[: len(now)]
    moved = moved * problem.scale[now][:, None] / problem.scale[outside]
    u = len(now)
    if step.before[s] == step.before_2[s]:  # the same columns twice
        return moved[:, :u], moved[:, 2 * u :]
    return moved[:, :u] + moved[:, u : 2 * u], moved[:, 2 * u :]


def _latest_knots(curvature: Curvature, window) -> dict[str, np.ndarray]:
    """Return for every term the latest pose of each instance, -1 if none."""
    problem = curvature.problem
    pose = np.full(problem.size, -1)
    x = problem.variables["x"]
    pose[x.span] = np.repeat(np.arange(x.columns), x.rows)
    for name, rows in (("finger", window.push), ("ground", window.corner)):
        if name in problem.variables:
            v = problem.variables[name]
            pose[v.span] = np.repeat(window.step.pose[rows.step], v.rows)
    terms = curvature.hessians
    return {name: pose[problem.terms[name].unknowns].max(axis=1) for name in terms}
