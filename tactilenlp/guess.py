"""Propose first guesses: where the object may be and how it may have moved.

Nothing is solved here to optimality.  `first_guesses` reads the first touch, `realigned`
the first side touch of a new action, `follow` carries a pose through the samples by
least motion.  Poses are planar, x = (x, y, yaw).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from .reduce import SIDE

TOUCH = 0.5e-3  # [m] deviation of a touched gap while following
NORMAL = 0.15  # [rad] deviation of a measured normal while following
MOVE = 2e-3  # [m] typical way of the object in one sample
TURN = 0.1  # [rad] typical turn of the object in one sample
PASSES = 4  # Gauss-Newton passes per sample with contact
SETTLED = 1e-5  # [m, rad] a smaller step ends the passes
RUN = 5  # samples of a touch whose normals are averaged
TURNED = np.radians(8)  # a normal this far off its face is worth another guess
OFF = 3e-3  # [m] and so is a gap this wide where contact is felt
BELOW = 5e-3  # [m] a side touch is at least this far below the top


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
    """Return (theta, x, p_wf, rho, n_m) -> gap, its slope; normal error, its slope."""
    theta, x = ca.SX.sym("theta", shape.theta), ca.SX.sym("x", motion.unknowns)
    p_wf, rho, n_m = ca.SX.sym("p", 3), ca.SX.sym("rho"), ca.SX.sym("n", 3)
    pose = motion.pose(shape, theta, x)
    phi = finger.gap(shape, theta, pose, p_wf, rho)
    off = finger.normal(shape, theta, pose, p_wf, rho) - n_m
    out = [phi, ca.jacobian(phi, x), off, ca.jacobian(off, x)]
    return ca.Function("residuals", [theta, x, p_wf, rho, n_m], out, {"cse": True})


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


def first_guesses(data, shape) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return (name, theta, x) that explain the first touch, most likely first."""
    t, f = np.argwhere(data.contact & data.valid)[0]
    n = _mean_normal(data, t, f)
    p = data.finger_position[t, f] - data.finger_radius[f] * n
    mean = shape.size_prior[0]
    theta = np.full(shape.theta, mean)
    if abs(n[2]) > SIDE:
        theta[2] = max(p[2], shape.bounds[0])
        yaws = np.radians([0, 30, 60])
        return [(f"top {i}", theta, np.r_[p[:2], yaw]) for i, yaw in enumerate(yaws)]
    theta[2] = max(mean, p[2] + BELOW)
    inward = -n[:2] / np.linalg.norm(n[:2])
    side = np.array([-inward[1], inward[0]])
    yaw = np.arctan2(n[1], n[0])
    out = [
        (name, theta, np.r_[p[:2] + (inward / 2 + side * share) * mean, yaw])
        for name, share in (("face", 0.0), ("face left", 0.25), ("face right", -0.25))
    ]
    centre = p[:2] + inward * mean / np.sqrt(2)
    return [*out, ("edge", theta, np.r_[centre, yaw + np.pi / 4])]


def realigned(data, window, shape, theta, x, action):
    """Return (name, theta, x before the action) variations that meet a new side touch.

    The first side touch of each finger in this action says where a face is and which
    way it looks.  Where that contradicts the guess, either the whole past was turned
    and shifted ("turn": to the nearest face, "edge": to the nearest edge), or the
    touched side lies further out ("grow").
    """
    out = []
    for f in range(data.fingers):
        touched = data.contact[:, f] & data.valid[:, f] & (data.action == action)
        if not touched.any():
            continue
        t = int(np.argmax(touched))
        n = _mean_normal(data, t, f)
        if abs(n[2]) > SIDE:
            continue
        off = (np.arctan2(n[1], n[0]) - x[2] + np.pi / 4) % (np.pi / 2) - np.pi / 4
        face = off if abs(off) > TURNED else 0.0
        edge = off - np.copysign(np.pi / 4, off)
        for name, turn in (("turn", face), ("edge", edge)):
            turned = x + np.r_[0, 0, turn]
            args = (data.finger_position[t, f], data.finger_radius[f], n)
            phi = float(_residuals(shape, window.motion, window.finger)(theta, turned, *args)[0])
            shift = np.r_[phi * n[:2] / np.linalg.norm(n[:2]), 0]
            if turn or abs(phi) > OFF:
                out.append((name, theta, turned + shift))
            if name == "turn" and abs(phi) > OFF:
                grown = _grown(shape, theta, turned[2], n, phi)
                out.append(("grow", grown, turned + shift / 2))
    return out


def follow(data, window, shape, theta, x, samples) -> np.ndarray:
    """Return the planar poses (3, len(samples)) that least motion from x passes.

    Each pose fits the touched gaps and normals of its sample, and is not entered by a
    finger that feels nothing, at the least weighted motion from the pose before.
    """
    weight = np.array([1 / MOVE, 1 / MOVE, 1 / TURN]) ** 2
    path = []
    for t in samples:
        before = x
        passes = PASSES if (data.contact[t] & data.valid[t]).any() else 1
        for _ in range(passes):
            H, g = _pull(data, window, shape, theta, x, t)
            g = g + weight * (x - before)
            change = np.linalg.solve(H + np.diag(weight), g)
            x = x - change
            if np.abs(change).max() < SETTLED:
                break
        path.append(x)
    return np.array(path).T


def _pull(data, window, shape, theta, x, t):
    """Return Hessian and gradient of what the fingers say about the pose at sample t."""
    residuals = _residuals(shape, window.motion, window.finger)
    H, g = np.zeros((3, 3)), np.zeros(3)
    for f in np.nonzero(data.valid[t])[0]:
        phi, dphi, off, doff = (
            np.asarray(o)
            for o in residuals(
                theta, x, data.finger_position[t, f], data.finger_radius[f],
                data.normal[t, f],
            )
        )  # fmt: skip
        if data.contact[t, f] or phi[0, 0] < 0:
            H += dphi.T @ dphi / TOUCH**2
            g += (dphi.T @ phi).ravel() / TOUCH**2
        if data.contact[t, f]:
            H += doff.T @ doff / NORMAL**2
            g += (doff.T @ off).ravel() / NORMAL**2
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
