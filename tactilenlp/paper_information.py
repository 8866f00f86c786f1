r"""Information as the paper approximates it (eq:obsinfo), for comparison.

    I = sum_t alpha^2 p (1 - p) grad phi grad phi' + c_t grad n Sigma_n^{-1} grad n'

with p = 1 / (1 + exp(-alpha phi)), by shape and the pose of each sample; a past pose
counts as the last one: position and the vector part of the quaternion move alike
(dx_t/dx_{t-1} = 1).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from .errors import OptionError


def paper(problem, solution, window, shape) -> np.ndarray:
    """Return eq:obsinfo (k, k) about theta and the last pose, in the page's chart."""
    x = solution.values["x"]
    last = half_turns(window.motion, x[:, -1])
    link = []
    for k in range(x.shape[1]):
        same = np.eye(len(x))
        turn = np.linalg.pinv(half_turns(window.motion, x[:, k])) @ last
        same[len(x) - len(turn) :, len(x) - len(turn) :] = turn
        link.append(same)
    return chained(problem, solution, window, shape, np.array(link))


def chained(problem, solution, window, shape, link, theta=None) -> np.ndarray:
    """Return the sum of the samples' information (k, k), each by its own pose's link.

    link (poses, u, u): how each pose follows the last one; theta (poses, u, n): how it
    follows the shape at a given last pose.
    """
    n, u = shape.theta, len(solution.values["x"])
    alpha, sigma = (_value(problem, name) for name in ("alpha", "normal scale"))
    M = np.zeros((n + u, n + u))
    for samples, felt in ((window.touch, True), (window.free, False)):
        if not len(samples):
            continue
        phi, by_phi, by_normal = _slopes(solution, window, shape, samples)
        to_last = np.zeros((len(samples), n + u, n + u))
        to_last[:, :n, :n] = np.eye(n)
        to_last[:, n:, n:] = link[samples.pose]
        if theta is not None:
            to_last[:, n:, :n] = theta[samples.pose]
        p = 1 / (1 + np.exp(-np.clip(alpha * phi, -500, 500)))
        J = np.einsum("ij,ijk->ik", by_phi, to_last)
        M += np.einsum("i,ij,ik->jk", alpha**2 * p * (1 - p), J, J)
        if felt:
            J = np.einsum("iaj,ijk->iak", by_normal, to_last)
            M += np.einsum("iaj,iak->jk", J, J) / sigma**2
    return M


def half_turns(motion, x) -> np.ndarray:
    """Return d(vector part of the quaternion) / d(entries of x that turn), (m, m)."""
    if motion.name == "planar":
        return np.array([[np.cos(x[2] / 2) / 2]])
    w = ca.SX.sym("w", 3)
    angle = ca.sqrt(ca.sumsqr(w) + 1e-16)
    J = ca.Function("J", [w], [ca.jacobian(ca.sin(angle / 2) / angle * w, w)])
    return np.asarray(J(x[3:]))


def _slopes(solution, window, shape, samples):
    """Return phi (i,), its gradient (i, k) and the normal's (i, 3, k) by (theta, x)."""
    values, motion, finger = solution.values, window.motion, window.finger
    z = ca.SX.sym("z", shape.theta + motion.unknowns)
    p_wf, rho = ca.SX.sym("p", samples.p_wf.shape[1]), ca.SX.sym("rho")
    theta, x = z[: shape.theta], z[shape.theta :]
    pose = motion.pose(shape, theta, x)
    phi = finger.gap(shape, theta, pose, p_wf, rho)
    normal = finger.normal(shape, theta, pose, p_wf, rho)
    out = [phi, ca.densify(ca.jacobian(phi, z)), ca.densify(ca.jacobian(normal, z))]
    count = len(samples)
    at = np.vstack([np.repeat(values["theta"], count, 1), values["x"][:, samples.pose]])
    found = ca.Function("slopes", [z, p_wf, rho], out).map(count)(
        at, samples.p_wf.T, samples.radius[None]
    )
    phi, by_phi, by_normal = (np.asarray(f) for f in found)
    k = len(at)
    by_normal = by_normal.reshape(3, count, k).transpose(1, 0, 2)
    return phi.ravel(), by_phi.reshape(count, k), by_normal


def _value(problem, name: str) -> float:
    if name not in problem.parameters:
        raise OptionError(
            "this page has no such parameter, so eq:obsinfo has no weight",
            where=name, expected=f"one of {[*problem.parameters]}",
            next="ask for kind='exact'",
        )  # fmt: skip
    return float(problem.parameters[name].value[0])
