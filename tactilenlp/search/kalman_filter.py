"""Extended Kalman filter of size and planar pose through contact measurements.

The state is (theta, x before, x now), with x = (x, y, yaw).  The process is a random
walk: large where the object is touched, small where it is not.  Touched gaps and
normals are measurements, each corrected by a few Gauss-Newton passes; a finger that
feels nothing pushes the body out where they overlap.  Many states run at once.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from ..nlp.term_functions import mapped
from ..problem.missing_samples import unseen_contact

GAP_SIGMA = 0.5e-3  # [m] measurement deviation of a touched gap
NORMAL_SIGMA = 0.15  # [rad] measurement deviation of a normal
# Process deviations of one sample [m, m, rad], touched and untouched:
TOUCHED_STEP = np.array([2e-3, 2e-3, 0.1])
# [m, rad] of size and first pose in the second run, which finds the path:
RESTART_SIGMA = np.r_[1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-3]
STOPPING_SAMPLES = 5  # a released body stops in three, at a friction of 0.3
UNTOUCHED_STEP = np.array([1e-4, 1e-4, 5e-3])
MAX_PASSES = 4  # Gauss-Newton passes per sample with contact
PASS_TOLERANCE = 1e-5  # [m, rad] a smaller step ends the passes
LONGEST_PASS = np.array([8e-3, 8e-3, 0.3])  # [m, m, rad] step of a pass


@cache
def finger_residuals(shape, motion, finger):
    """Return (z, p_wf, rho, n_m) -> gap, its slope; normal error, its slope."""
    z = ca.SX.sym("z", shape.theta + motion.unknowns)
    theta, x = z[: shape.theta], z[shape.theta :]
    p_wf, rho, n_m = ca.SX.sym("p", 3), ca.SX.sym("rho"), ca.SX.sym("n", 3)
    pose = motion.pose(shape, theta, x)
    phi = finger.gap(shape, theta, pose, p_wf, rho)
    off = finger.normal(shape, theta, pose, p_wf, rho) - n_m
    slopes = [ca.densify(ca.jacobian(r, z)) for r in (phi, off)]
    out = [phi, slopes[0], off, slopes[1]]
    return ca.Function("residuals", [z, p_wf, rho, n_m], out, {"cse": True})


def lasting_contacts(data) -> np.ndarray:
    """Tell which contacts (T, F) have a neighbour in time, unlike a flipped boolean."""
    felt = data.contact & data.valid
    pair = felt[1:] & felt[:-1] & (data.action[1:] == data.action[:-1])[:, None]
    none = np.zeros((1, data.fingers), bool)
    return np.vstack([none, pair]) | np.vstack([pair, none])


def filtered_paths(data, window, shape, z, spread, turning, samples, offsets=0.0):
    """Filter states z (S, n + 3) of theta and pose through `samples`, all at once.

    spread (S, n + 3, n + 3): covariance of z; turning (S,) [-]: scale of the process
    noise in yaw; offsets: of the fingers (S, 3, F) [m], where these are not known
    exactly. A first run corrects z by the measurements, a second one finds the path
    from there. Returns z (S, n + 3) and the poses (S, 3, samples).
    """
    shift = np.broadcast_to(offsets, (len(z), 3, data.fingers)).swapaxes(1, 2)
    given = data, window, shape, shift
    z, _ = _filtered(*given, z, spread, turning, samples)
    tight = np.broadcast_to(np.diag(RESTART_SIGMA**2), spread.shape)
    return _filtered(*given, z, tight, turning, samples)


def _filtered(data, window, shape, shift, z, spread, turning, samples):
    """Run the filter: the state is (theta, x before, x now).

    Touched gaps and normals are fitted; a free finger that overlaps the body pushes it
    out.
    """
    n, m = shape.theta, window.motion.unknowns
    copy = np.vstack([np.eye(n + m), np.eye(m, n + m, n)])
    mean = np.hstack([z, z[:, n:]])
    P = copy @ spread @ copy.T
    way = np.ones((len(z), m))
    way[:, -1] = turning
    sigma = window.sigma_position, window.sigma_normal
    noise = np.hypot((GAP_SIGMA, NORMAL_SIGMA), sigma)
    low = np.r_[np.full(n, shape.bounds[0]), np.full(2 * m, -np.inf)]
    longest = np.r_[np.full(n, LONGEST_PASS[0]), LONGEST_PASS, LONGEST_PASS]
    felt, hidden, path = lasting_contacts(data), unseen_contact(data), []
    sliding = _still_sliding(felt, window) | hidden.any(axis=1)
    for t in samples:
        touched = felt[t].any()
        walk = way * (TOUCHED_STEP if touched or sliding[t] else UNTOUCHED_STEP)
        P[:, -m:, -m:] += walk[:, :, None] ** 2 * np.eye(m)
        prior, z = np.linalg.inv(P), mean
        for _ in range(MAX_PASSES if touched else 1):
            sensed = felt[t], hidden[t]
            H, g = _measured(data, window, shape, shift, z, t, sensed, noise)
            g += np.einsum("sij,sj->si", prior, z - mean)
            change = np.linalg.solve(prior + H, g[..., None])[..., 0]
            change /= np.maximum(1, np.abs(change / longest).max(axis=1, keepdims=True))
            z = np.maximum(z - change, low)
            if np.abs(change).max() < PASS_TOLERANCE:
                break
        mean, P = z, np.linalg.inv(prior + H)
        path.append(z[:, -m:])
    return mean[:, : n + m], np.stack(path, axis=2)


def _still_sliding(felt, window) -> np.ndarray:
    """Tell the samples (T,) through which an untouched body slides on, as on ice.

    On other ground it stops within STOPPING_SAMPLES and hardly moves in these.
    """
    moving = np.isin(np.arange(len(felt)), window.step.sample)
    alone = moving & ~felt.any(axis=1)
    ends = np.flatnonzero(np.diff(np.r_[False, alone, False]))
    for first, last in ends.reshape(-1, 2):
        alone[first:last] = last - first > STOPPING_SAMPLES
    return alone


def _measured(data, window, shape, shift, z, t, sensed, noise):
    """Return Hessians and gradients of the measurements at states z (S, n + 6).

    sensed: which fingers felt contact (F,), which may have touched unseen (F,).
    """
    felt, hidden = sensed
    n, m = shape.theta, window.motion.unknowns
    local = np.r_[:n, n + m : n + 2 * m]
    fingers = np.nonzero(hidden | (data.valid[t] & (felt | ~data.contact[t])))[0]
    S, F, size = len(z), len(fingers), n + m
    H, g = np.zeros((S, *z.shape[1:] * 2)), np.zeros_like(z)
    if F == 0:
        return H, g
    residuals = mapped(finger_residuals(shape, window.motion, window.finger), S * F)
    now = np.tile(fingers, S)
    there = data.finger_position[t, now] + shift[:, fingers].reshape(-1, 3)
    phi, dphi, off, doff = residuals(
        np.repeat(z[:, local], F, axis=0).T, there.T,
        data.finger_radius[now][None], data.normal[t, now].T,
    )  # fmt: skip
    phi = np.asarray(phi).reshape(S, F)
    dphi = np.asarray(dphi).reshape(S, F, size)
    off = np.asarray(off).T.reshape(S, F, 3)
    doff = np.asarray(doff).reshape(3, S, F, size).transpose(1, 2, 0, 3)
    gap = (felt[fingers] | (phi < 0)) / noise[0] ** 2
    turn = felt[fingers] / noise[1] ** 2
    block = np.einsum("sf,sfi,sfj->sij", gap, dphi, dphi)
    block += np.einsum("f,sfki,sfkj->sij", turn, doff, doff)
    H[np.ix_(np.arange(S), local, local)] = block
    g[:, local] = np.einsum("sf,sf,sfi->si", gap, phi, dphi)
    g[:, local] += np.einsum("f,sfk,sfki->si", turn, off, doff)
    return H, g
