r"""Compare information: kinds of it other than the exact one, and what a touch gains.

gauss_newton      The Hessian of every residual without its negative part: for a sum of
                  squares with zero residuals this is J'J (Nocedal and Wright,
                  Numerical Optimization, 10.3).  The curvature of constraints is left
                  out.

paper             eq:obsinfo, with the final pose in the page's own unknowns,

    I = sum_t alpha^2 p (1 - p) grad phi grad phi' + c_t grad n Sigma_n^{-1} grad n'

                  with p = 1 / (1 + exp(-alpha phi)), by shape and the pose of each
                  sample; an earlier pose counts as the last one, since position and the
                  vector part of the quaternion move alike (dx_t/dx_{t-1} = 1).

inverse_dynamics  The same sum, earlier poses by inverted Jacobians of the dynamics.  At
                  given earlier poses x_k and its impulses solve one time step, whose
                  derivative F_k = dx_k / dx_{k-1} (at the same velocity) gives

    dx_{k-1} = F_k^{-1} (dx_k - dx_k/dtheta dtheta).

                  A pushing finger determines the pose whatever it was before: F_k is
                  nearly singular along the push, and the product of the inverses grows
                  with every sample.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag

from formulations import exploration
from formulations.names import FINGER, FINGER_OFFSET, GROUND, NORMAL_SCALE

from ..common.validation import as_floats, check_one_of, check_whole
from ..errors import OptionError, TactileError
from ..nlp.codegen import compiled
from ..nlp.kkt import LEAST_CURVATURE, KKTSystem
from ..problem.fingertips import moved


def gauss_newton(kkt: KKTSystem) -> KKTSystem:
    """Return the KKT system with the Hessian of every instance made positive."""
    problem = kkt.problem
    curvature = sp.csc_matrix((problem.size,) * 2)
    for name, term in problem.costs.items():
        size = problem.scale[term.unknowns]
        local = local_hessians(kkt, name) * size[:, :, None] * size[:, None, :]
        values, vectors = np.linalg.eigh(local)
        values = np.maximum(values, 0.0)
        local = np.einsum("iab,ib,icb->iac", vectors, values, vectors)
        curvature = curvature + scattered(kkt, name, local)
    return replace(kkt, curvature=curvature)


def paper(problem, solution, window) -> np.ndarray:
    """Return eq:obsinfo (k, k) about theta and the last pose, page's unknowns."""
    x = solution.values["x"]
    turns = [quaternion_jacobian(window.motion, x_k) for x_k in x.T]
    still = np.eye(len(x) - len(turns[-1]))
    by_last = [block_diag(still, np.linalg.pinv(J) @ turns[-1]) for J in turns]
    return sum_of_samples(problem, solution, window, np.array(by_last))


def quaternion_jacobian(motion, x) -> np.ndarray:
    """Return d(vector part of the quaternion) / d(unknowns of rotation), (m, m)."""
    if motion.name == "planar":
        return np.array([[np.cos(x[2] / 2) / 2]])
    w = ca.SX.sym("w", 3)
    angle = ca.sqrt(ca.sumsqr(w) + 1e-16)
    J = ca.Function("J", [w], [ca.jacobian(ca.sin(angle / 2) / angle * w, w)])
    return np.asarray(J(x[3:]))


def inverse_dynamics(kkt: KKTSystem, solution, window) -> np.ndarray:
    """Return eq:obsinfo (k, k) with past poses by inverted Jacobians.

    Raises TactileError where their product overflows.
    """
    by_last, by_theta = jacobians_by_last_pose(kkt, window)
    M = sum_of_samples(kkt.problem, solution, window, by_last, by_theta)
    if not np.isfinite(M).all():
        raise TactileError(
            "the product of inverted Jacobians overflows", where="inverse_dynamics",
            got="an infinite entry", expected="finite information",
            next='ask for kind="exact", or for fewer actions',
        )  # fmt: skip
    return M


def jacobians_by_last_pose(kkt: KKTSystem, window) -> tuple[np.ndarray, np.ndarray]:
    """Return d pose / d last pose (poses, u, u) and d pose / d theta (poses, u, n)."""
    u, n = window.motion.unknowns, window.shape.theta
    by_last = np.tile(np.eye(u), (window.poses, 1, 1))
    by_shape = np.zeros((window.poses, u, n))
    row = {int(k): i for i, k in enumerate(window.step.pose)}
    latest = _latest_poses(kkt, window)
    local = {name: local_hessians(kkt, name) for name in kkt.problem.terms}
    for k in range(window.poses - 1, 0, -1):
        by_last[k - 1], by_shape[k - 1] = by_last[k], by_shape[k]
        if k not in row:  # a gap between actions: the object stays
            continue
        H = sp.csc_matrix((kkt.problem.size,) * 2)
        for name, poses in latest.items():
            here = np.where((poses == k)[:, None, None], local[name], 0.0)
            if (poses == k).any():
                H = H + scattered(kkt, name, here)
        F, by_theta = _time_step(kkt, window, H, row[k])
        back = np.linalg.inv(F)
        by_last[k - 1] = back @ by_last[k]
        by_shape[k - 1] = back @ (by_shape[k] - by_theta)
    return by_last, by_shape


def _time_step(kkt: KKTSystem, window, H, s: int):
    """Return dx_k/dx_{k-1} (u, u) and dx_k/dtheta (u, n) of the step s."""
    problem, step = kkt.problem, window.step
    columns = problem.variables["x"][:, :].indices
    now = columns[step.pose[s]]
    impulses = [
        problem.variables[name][:, np.nonzero(rows.step == s)[0]].indices.ravel()
        for name, rows in ((FINGER, window.push), (GROUND, window.corner))
        if name in problem.variables
    ]
    inside = np.concatenate([now, *impulses])
    before = columns[step.before[s]], columns[step.before_2[s]]
    theta = problem.variables["theta"][:, :].indices.ravel()[: window.shape.theta]
    D = sp.diags(problem.scale)
    H, A = (D @ H @ D).tocsc(), kkt.A
    A = A[np.unique(A[:, inside].nonzero()[0])]
    bend = H[inside][:, inside] + LEAST_CURVATURE * sp.identity(len(inside))
    floor = -LEAST_CURVATURE * sp.identity(A.shape[0])
    K = sp.bmat([[bend, A[:, inside].T], [A[:, inside], floor]]).toarray()
    outside = np.concatenate([*before, theta])
    right = sp.vstack([H[inside][:, outside], A[:, outside]]).toarray()
    slopes = -np.linalg.solve(K, right)[: len(now)]
    slopes = slopes * problem.scale[now][:, None] / problem.scale[outside]
    u = len(now)
    if step.before[s] == step.before_2[s]:  # the same columns twice
        return slopes[:, :u], slopes[:, 2 * u :]
    return slopes[:, :u] + slopes[:, u : 2 * u], slopes[:, 2 * u :]


def _latest_poses(kkt: KKTSystem, window) -> dict[str, np.ndarray]:
    """Return for every term the latest pose of each instance, -1 if none."""
    problem = kkt.problem
    pose = np.full(problem.size, -1)
    x = problem.variables["x"]
    pose[x.span] = np.repeat(np.arange(x.columns), x.rows)
    for name, rows in ((FINGER, window.push), (GROUND, window.corner)):
        if name in problem.variables:
            v = problem.variables[name]
            pose[v.span] = np.repeat(window.step.pose[rows.step], v.rows)
    terms = problem.terms.items()
    return {name: pose[term.unknowns].max(axis=1) for name, term in terms}


def sum_of_samples(problem, solution, window, by_last, by_theta=None):
    """Return the sum of the samples' information (k, k), each by its own pose.

    by_last (poses, u, u): derivative of each pose by the last one; by_theta (poses, u,
    n): by the shape at a given last pose.  sigma = inf: a felt gap tells no more than
    its boolean.
    """
    theta, x, n = solution.values["theta"], solution.values["x"], window.shape.theta
    alpha = _sensor_parameter(problem, "alpha")
    sigma_n = _sensor_parameter(problem, NORMAL_SCALE)
    information = sample_information(window.shape, window.motion, window.finger)
    k, total = n + len(x), np.zeros((n + len(x), n + len(x)))
    for samples, felt in ((window.touch, 1.0), (window.free, 0.0)):
        if not (count := len(samples)):
            continue
        z = np.vstack([np.repeat(theta, count, axis=1), x[:, samples.pose]])
        p_wf = samples.p_wf
        if (offset := solution.values.get(FINGER_OFFSET)) is not None:
            p_wf = moved(p_wf, offset.T[samples.finger])
        inputs = z, p_wf.T, samples.radius[None], felt
        F = information.map(count)(*inputs, [alpha, np.inf, sigma_n]).full()
        F = F.reshape(len(F), count, -1)[:k, :, :k]
        to_last = np.tile(np.eye(k), (count, 1, 1))
        to_last[:, n:, n:] = by_last[samples.pose]
        if by_theta is not None:
            to_last[:, n:, :n] = by_theta[samples.pose]
        total += np.einsum("iab,aic,icd->bd", to_last, F, to_last, optimize=True)
    return total


@cache
def sample_information(shape, motion, finger) -> ca.Function:
    """Return (z, p_wf, rho, c, sensors) -> information of a sample (eq:obsinfo).

    About z, which is theta and the pose at that sample (dx_t/dx_T = I), and about the
    place p_wf of the finger.  c: the boolean; sensors: alpha, sigma, sigma_n.
    """
    z = ca.SX.sym("z", shape.theta + motion.unknowns)
    p_wf, rho, c = ca.SX.sym("p", finger.numbers), ca.SX.sym("rho"), ca.SX.sym("c")
    sensors, theta = ca.SX.sym("sensors", 3), z[: shape.theta]
    at = shape, theta, motion.pose(shape, theta, z[shape.theta :]), p_wf, rho
    phi, n = finger.gap(*at), finger.normal(*at)
    slopes = [ca.jacobian(v, ca.vertcat(z, p_wf)) for v in (phi, n)]
    F = exploration.sample_information(c, phi, *slopes, *ca.vertsplit(sensors))
    inputs, out = [z, p_wf, rho, c, sensors], [ca.densify(F)]
    return compiled([ca.Function("sampled", inputs, out, {"cse": True})])[0]


def _sensor_parameter(problem, name: str) -> float:
    what = "this page has no such parameter, so eq:obsinfo has no weight"
    check_one_of(name, name, problem.parameters, what, next="ask for kind='exact'")
    return float(problem.parameters[name].value[0])


def local_hessians(kkt: KKTSystem, name: str) -> np.ndarray:
    """Return the Hessian of every instance of a term, (instances, z, z), SI."""
    term = kkt.problem.terms[name]
    function = term.function
    weight = kkt.multipliers.get(name, np.ones((term.instances, function.rows)))
    (upper,) = term.evaluated("second", kkt.x, kkt.data, weight.T)
    i, j = (np.array(p, int) for p in function.hessian_sparsity.get_triplet())
    local = np.zeros((term.instances, term.unknowns.shape[1], term.unknowns.shape[1]))
    local[:, i, j] = local[:, j, i] = upper.T
    return local


def scattered(kkt: KKTSystem, name: str, local) -> sp.csc_matrix:
    """Return the sum of local matrices (instances, z, z) at their places."""
    problem = kkt.problem
    unknowns = problem.terms[name].unknowns
    rows = np.broadcast_to(unknowns[:, :, None], local.shape).ravel()
    columns = np.broadcast_to(unknowns[:, None, :], local.shape).ravel()
    return sp.csc_matrix((local.ravel(), (rows, columns)), (problem.size,) * 2)


def information_gain(known, told, asked: int | None = None) -> float:
    """Return (logdet(I + F) - logdet(I)) / 2 in nats, by two Cholesky factors.

    The expected gain of a Gaussian belief (Lindley, Ann. Math. Stat. 27, 1956).  known:
    I (k, k), positive definite; told: F (k, k), positive semidefinite; asked: how many
    of the first unknowns count, all others being marginalised.  Raises OptionError of
    other shapes, TactileError where I or I + F is not positive definite.
    """
    prior, F = (as_floats(matrix) for matrix in (known, told))
    if prior.ndim != 2 or prior.shape != F.shape or len(prior) != prior.shape[1]:
        raise OptionError(
            "wrong shape", where="information_gain",
            expected="two square matrices of one size",
            got=f"{prior.shape} and {F.shape}",
        )  # fmt: skip
    if asked is not None:
        what = f"no number of the {len(prior)} unknowns"
        check_whole("asked", asked, 0, len(prior), what=what)
    if asked is not None and asked < len(prior):  # logdet of a Schur complement
        rest = slice(asked, None)
        nuisance = information_gain(prior[rest, rest], F[rest, rest])
        return information_gain(prior, F) - nuisance
    finite = np.isfinite(prior).all() and np.isfinite(F).all()
    try:
        if not (finite and np.all(np.diag(prior) > 0)):
            raise np.linalg.LinAlgError
        scale = 1 / np.sqrt(np.diag(prior))
        prior, F = prior * np.outer(scale, scale), F * np.outer(scale, scale)
        before, after = np.linalg.cholesky(prior), np.linalg.cholesky(prior + F)
    except np.linalg.LinAlgError as bad:
        least = np.linalg.eigvalsh(prior)[0] if finite else np.nan
        raise TactileError(
            "not positive definite",
            where="information_gain",
            expected="finite numbers, I and I + F with positive eigenvalues only",
            got=f"{least:.2g} as the least one of I",
            next="give what is known a prior in physical units",
        ) from bad
    return float(np.log(np.diag(after) / np.diag(before)).sum())
