"""Propose first guesses: where the object may be and how it may have moved.

Nothing is solved here to optimality.  `first_guesses` reads the first touch,
`realigned` the touches of a new action, `follow` carries size and pose through the
samples by an extended Kalman filter.  Poses are planar, x = (x, y, yaw).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from .kind import mapped

TOUCH = 0.5e-3  # [m] deviation of a touched gap while following
NORMAL = 0.15  # [rad] deviation of a measured normal while following
MOVE = np.array([2e-3, 2e-3, 0.1])  # [m, m, rad] of a touched object in one sample
TIGHT = np.r_[1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-3]  # [m, rad] of what is not corrected
BRIEF = 5  # samples: friction of 0.3 stops a body that a finger left in three
REST = np.array([1e-4, 1e-4, 5e-3])  # [m, m, rad] of one that nothing touches
PASSES = 4  # Gauss-Newton passes per sample with contact
SETTLED = 1e-5  # [m, rad] a smaller step ends the passes
STEP = np.array([8e-3, 8e-3, 0.3])  # [m, m, rad] longest step of a pass
RUN = 5  # samples of a touch whose normals are averaged
TURNED = np.radians(8)  # a normal this far off its face is worth another guess
OFF = 3e-3  # [m] and so is a gap this wide where contact is felt
BELOW = 5e-3  # [m] a side touch is at least this far below the top
FLAT = 0.14  # [-] sine of the tilt (8 degrees) up to which a normal is the top's
RIM = 0.25  # [-] n_z above which a touch tells the height (5 degrees of noise: 3 sigma)


@dataclass(frozen=True, eq=False)
class Guess:
    """What a user thinks the object is: size and pose at the first sample.

    side_lengths (3,) [m]; position (2,) or (3,) [m]; yaw [rad].
    """

    side_lengths: np.ndarray
    position: np.ndarray
    yaw: float = 0.0


@cache
def _residuals(shape, motion, finger):
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


@cache
def _corners(shape):
    theta = ca.SX.sym("theta", shape.theta)
    signs = np.array(shape.corners)
    every = np.vstack([signs, signs * [1, 1, -1]])
    points = ca.horzcat(*(shape.corner(theta, ca.DM(s)) for s in every))
    return ca.Function("corners", [theta], [points])


def body_corners(shape, theta) -> np.ndarray:
    """Return the corners of a body, body frame, (corners, 3) [m]."""
    return np.asarray(_corners(shape)(theta)).T


def corners(shape, theta, x) -> np.ndarray:
    """Return the corners of a body lying at the planar pose x, (corners, 3) [m]."""
    body = np.asarray(_corners(shape)(theta))
    c, s = np.cos(x[2]), np.sin(x[2])
    return np.stack(
        [c * body[0] - s * body[1] + x[0], s * body[0] + c * body[1] + x[1], body[2]], 1
    )


def sustained(data) -> np.ndarray:
    """Tell which contacts (T, F) have a neighbour in time: a flipped one has none."""
    felt = data.contact & data.valid
    pair = felt[1:] & felt[:-1] & (data.action[1:] == data.action[:-1])[:, None]
    none = np.zeros((1, data.fingers), bool)
    return np.vstack([none, pair]) | np.vstack([pair, none])


def onsets(data, action) -> list[tuple[int, int]]:
    """Return (sample, finger) where each finger's touch begins in an action."""
    mine = (data.action == action)[:, None]
    for felt in (sustained(data) & mine, data.contact & data.valid & mine):
        if felt.any():
            found = [(int(np.argmax(felt[:, f])), f) for f in range(data.fingers)]
            return sorted((t, f) for t, f in found if felt[t, f])
    return []


def height(data, shape, otherwise: float) -> float:
    """Return the height [m]: of the rim where it was felt, else above all touches."""
    felt = sustained(data)
    n_z = data.normal[..., 2]
    z = data.finger_position[..., 2] - data.finger_radius * n_z
    rim = z[felt & (n_z > RIM)]
    if rim.size and np.median(np.abs(rim - np.median(rim))) < OFF:  # else it tilts
        return float(np.clip(np.median(rim), *shape.bounds))
    side = z[felt & (np.abs(n_z) < FLAT)]
    return max(otherwise, np.quantile(side, 0.9) + BELOW) if side.size else otherwise


def first_guesses(data, shape, t, f) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return (name, theta, x) that explain the first touch, of finger f at sample t."""
    n = _mean_normal(data, t, f)
    p = data.finger_position[t, f] - data.finger_radius[f] * n
    mean = shape.size_prior[0]
    theta = np.full(shape.theta, mean)
    theta[2] = height(data, shape, mean)
    level = np.linalg.norm(n[:2])
    if level < FLAT:
        yaws = np.radians([0, 30, 60])
        return [(f"top {i}", theta, np.r_[p[:2], yaw]) for i, yaw in enumerate(yaws)]
    inward = -n[:2] / level
    side = np.array([-inward[1], inward[0]])
    yaw = np.arctan2(n[1], n[0])
    out = [
        (name, theta, np.r_[p[:2] + (inward / 2 + side * share) * mean, yaw])
        for name, share in (("face", 0.0), ("face left", 0.25), ("face right", -0.25))
    ]
    centre = p[:2] + inward * mean / np.sqrt(2)
    for name, turn in (("edge", 45), ("edge left", 25), ("edge right", 65)):
        out.append((name, theta, np.r_[centre, yaw + np.radians(turn)]))
    return out


def realigned(data, window, shape, theta, x, action):
    """Return (name, theta, x before the action) variations that meet a new side touch.

    The first touch of each finger in this action says where a face is and which way it
    looks.  Where that contradicts the guess, either the whole past was turned and
    shifted ("turn": to the nearest face, "edge": to the nearest edge), or the touched
    side lies further out ("grow").
    """
    out = []
    for t, f in onsets(data, action):
        n = _mean_normal(data, t, f)
        level = np.linalg.norm(n[:2])
        if level < FLAT:
            continue
        off = (np.arctan2(n[1], n[0]) - x[2] + np.pi / 4) % (np.pi / 2) - np.pi / 4
        face = off if abs(off) > TURNED else 0.0
        edge = off - np.copysign(np.pi / 4, off)
        residuals = _residuals(shape, window.motion, window.finger)
        for name, turn in (("turn", face), ("edge", edge)):
            turned = x + np.r_[0, 0, turn]
            touch = (data.finger_position[t, f], data.finger_radius[f], n)
            phi = float(residuals(np.r_[theta, turned], *touch)[0])
            shift = np.r_[phi * n[:2] / level, 0]
            if turn or abs(phi) > OFF:
                out.append((name, theta, turned + shift))
            if name == "turn" and abs(phi) > OFF:
                grown = _grown(shape, theta, turned[2], n, phi)
                out.append(("grow", grown, turned + shift / 2))
    return out


def follow(data, window, shape, z, spread, turning, samples, offsets=0.0):
    """Follow guesses z (S, n + 3) of theta and pose through `samples`, all at once.

    offsets: of the fingers (S, 3, F) [m], if these are not where they say.
    spread (S, n + 3, n + 3): how far z may be off; turning (S,) [-]: how readily the
    object turns, in TURN.  A first run corrects z by what is felt, a second one finds
    the path from there.  Returns z (S, n + 3) and the poses (S, 3, samples).
    """
    shift = np.broadcast_to(offsets, (len(z), 3, data.fingers)).swapaxes(1, 2)
    given = data, window, shape, shift
    z, _ = _filtered(*given, z, spread, turning, samples)
    tight = np.broadcast_to(np.diag(TIGHT**2), spread.shape)
    return _filtered(*given, z, tight, turning, samples)


def _filtered(data, window, shape, shift, z, spread, turning, samples):
    """Run an extended Kalman filter: the state is (theta, x before, x now).

    Touched gaps and normals are fitted, a finger that feels nothing is pushed out.
    """
    n, m = shape.theta, window.motion.unknowns
    copy = np.vstack([np.eye(n + m), np.eye(m, n + m, n)])
    mean = np.hstack([z, z[:, n:]])
    P = copy @ spread @ copy.T
    way = np.ones((len(z), m))
    way[:, -1] = turning
    sigma = window.sigma_position, window.sigma_normal
    noise = np.hypot((TOUCH, NORMAL), sigma)
    low = np.r_[np.full(n, shape.bounds[0]), np.full(2 * m, -np.inf)]
    longest = np.r_[np.full(n, STEP[0]), STEP, STEP]
    felt, path = sustained(data), []
    sliding = _sliding_on(felt, window)
    for t in samples:
        touched = felt[t].any()
        walk = way * (MOVE if touched or sliding[t] else REST)
        P[:, -m:, -m:] += walk[:, :, None] ** 2 * np.eye(m)
        prior, z = np.linalg.inv(P), mean
        for _ in range(PASSES if touched else 1):
            H, g = _pull(data, window, shape, shift, z, t, felt[t], noise)
            g += np.einsum("sij,sj->si", prior, z - mean)
            change = np.linalg.solve(prior + H, g[..., None])[..., 0]
            change /= np.maximum(1, np.abs(change / longest).max(axis=1, keepdims=True))
            z = np.maximum(z - change, low)
            if np.abs(change).max() < SETTLED:
                break
        mean, P = z, np.linalg.inv(prior + H)
        path.append(z[:, -m:])
    return mean[:, : n + m], np.stack(path, axis=2)


def _sliding_on(felt, window) -> np.ndarray:
    """Tell the samples (T,) through which an untouched body slides on, as on ice.

    On other ground it stops within BRIEF samples, and hardly moves in these.
    """
    moving = np.isin(np.arange(len(felt)), window.step.sample)
    alone = moving & ~felt.any(axis=1)
    ends = np.flatnonzero(np.diff(np.r_[False, alone, False]))
    for first, last in ends.reshape(-1, 2):
        alone[first:last] = last - first > BRIEF
    return alone


def _pull(data, window, shape, shift, z, t, felt, noise):
    """Return Hessians and gradients of what the fingers say of states z (S, n + 6)."""
    n, m = shape.theta, window.motion.unknowns
    local = np.r_[:n, n + m : n + 2 * m]
    fingers = np.nonzero(data.valid[t] & (felt | ~data.contact[t]))[0]
    S, F, size = len(z), len(fingers), n + m
    H, g = np.zeros((S, *z.shape[1:] * 2)), np.zeros_like(z)
    if F == 0:
        return H, g
    residuals = mapped(_residuals(shape, window.motion, window.finger), S * F)
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


def carried(x, old, new) -> np.ndarray:
    """Return poses x (3, T) carried by the planar motion that takes `old` to `new`."""
    turn = new[2] - old[2]
    c, s = np.cos(turn), np.sin(turn)
    a, b = x[:2] - old[:2, None]
    return np.vstack([new[0] + c * a - s * b, new[1] + s * a + c * b, x[2] + turn])


def _mean_normal(data, t, f) -> np.ndarray:
    """Return the mean normal of the touch that begins at sample t."""
    rows = np.arange(t, min(t + RUN, len(data.time)))
    rows = rows[data.contact[rows, f] & (data.action[rows] == data.action[t])]
    n = data.normal[rows, f].mean(axis=0)
    return n / max(np.linalg.norm(n), 1e-9)


def _grown(shape, theta, yaw, n, phi) -> np.ndarray:
    """Return theta with the side that looks along n moved out by phi."""
    c, s = np.cos(yaw), np.sin(yaw)
    side = int(np.argmax(np.abs([c * n[0] + s * n[1], c * n[1] - s * n[0]])))
    grown = theta.copy()
    grown[side] = np.clip(grown[side] + phi, 2 * shape.bounds[0], shape.bounds[1])
    return grown
