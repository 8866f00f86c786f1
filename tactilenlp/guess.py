"""Propose first guesses: where the object may be and how it may have moved.

Nothing is solved here to optimality.  `first_guesses` reads the first contact,
`follow` carries a pose through the samples of an action by least motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from formulations.rigid_body import PLANAR

TOUCH = 0.5e-3  # [m] deviation of a touched gap while following
NORMAL = 0.15  # [rad] deviation of a measured normal while following
MOVE = 2e-3  # [m] typical way of the object in one sample
TURN = 0.1  # [rad] typical turn of the object in one sample
SIDE = 0.7  # [-] a normal with |n_z| below this belongs to a side face
PASSES = 4  # Gauss-Newton passes per sample


@dataclass(frozen=True, eq=False)
class Guess:
    """Shape and planar poses to start from: theta (n,) [m], x (3, knots) [m, m, rad]."""

    theta: np.ndarray
    x: np.ndarray


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


def first_guesses(data, shape, motion=PLANAR) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (theta, x) pairs that explain the first contact, most likely first."""
    contact = data.contact & data.valid
    t, f = np.argwhere(contact)[0]
    run = contact[t : t + 5, f] & (data.action[t : t + 5] == data.action[t])
    n = data.normal[t : t + 5, f][run].mean(axis=0)
    n /= np.linalg.norm(n)
    p = data.finger_position[t, f] - data.finger_radius[f] * n
    mean = shape.size_prior[0]
    theta = np.full(shape.theta, mean)
    if abs(n[2]) > SIDE:
        theta[2] = max(p[2], shape.bounds[0])
        return [(theta, np.array([p[0], p[1], yaw])) for yaw in np.radians([0, 30, 60])]
    yaw = np.arctan2(n[1], n[0])
    theta[2] = max(mean, p[2] + 5e-3)
    inward = -n[:2] / np.linalg.norm(n[:2])
    side = np.array([-inward[1], inward[0]])
    face = [
        np.r_[p[:2] + inward * mean / 2 + side * offset * mean, yaw]
        for offset in (0.0, 0.25, -0.25)
    ]
    edge = np.r_[p[:2] + inward * mean / np.sqrt(2), yaw + np.pi / 4]
    return [(theta, x) for x in [*face, edge]]


def follow(data, window, shape, theta, x, samples) -> np.ndarray:
    """Return the poses (unknowns, len(samples)) that least motion from x passes.

    Each sample's pose fits the touched gaps and normals and is not entered by a finger
    that feels nothing, at the least weighted motion from the pose before.
    """
    residuals = _residuals(shape, window.motion, window.finger)
    weight = np.r_[[1 / MOVE] * 2, 1 / TURN] ** 2
    if window.motion is not PLANAR:
        weight = np.r_[[1 / MOVE] * 3, [1 / TURN] * 3] ** 2
    path = []
    for t in samples:
        before = x
        active = np.nonzero(data.valid[t])[0]
        for _ in range(PASSES if data.contact[t].any() else 2):
            H, g = np.diag(weight), weight * (x - before)
            for f in active:
                phi, dphi, off, doff = (
                    np.asarray(o)
                    for o in residuals(
                        theta, x, data.finger_position[t, f], data.finger_radius[f],
                        data.normal[t, f],
                    )
                )
                phi = float(phi[0, 0])
                if data.contact[t, f]:
                    H = H + dphi.T @ dphi / TOUCH**2 + doff.T @ doff / NORMAL**2
                    g = g + (dphi.T * phi / TOUCH**2 + doff.T @ off / NORMAL**2).ravel()
                elif phi < 0:
                    H = H + dphi.T @ dphi / TOUCH**2
                    g = g + dphi.ravel() * phi / TOUCH**2
            step = np.linalg.solve(H, g)
            x = x - step
            if np.abs(step).max() < 1e-5:
                break
        path.append(x)
    return np.array(path).T


def realigned(data, window, shape, theta, x, action) -> list[tuple]:
    """Return (name, theta, x before the first sample) variations that meet a new touch.

    The first side contact of each finger in this action says where a face is and which
    way it looks.  Where the guess says otherwise, either the whole past was turned
    ("turn", nearest face; "edge", nearest edge) and shifted, or the touched side lies
    further out ("grow").
    """
    residuals = _residuals(shape, window.motion, window.finger)
    out = []
    for f in range(data.fingers):
        hits = np.nonzero(data.contact[:, f] & (data.action == action))[0]
        if not len(hits):
            continue
        run = hits[hits < hits[0] + 5]
        n = data.normal[run, f].mean(axis=0)
        if np.hypot(*n[:2]) < SIDE:
            continue
        t, angle = hits[0], np.arctan2(n[1], n[0])
        p, rho = data.finger_position[t, f], data.finger_radius[f]
        off = (angle - x[2] + np.pi / 4) % (np.pi / 2) - np.pi / 4
        edge = off - np.copysign(np.pi / 4, off)
        for name, turn in (("turn", off), ("edge", edge)):
            if abs(turn) < np.radians(8) and name == "turn":
                turn = 0.0
            turned = x + np.r_[0, 0, turn]
            phi = float(residuals(theta, turned, p, rho, n)[0])
            shift = phi * n[:2] / np.linalg.norm(n[:2])
            if name == "edge" or turn or abs(phi) > 3e-3:
                out.append((name, theta, turned + np.r_[shift, 0]))
            if name == "turn" and abs(phi) > 3e-3:
                side = int(np.argmax(np.abs(_in_body(n, turned[2])[:2])))
                grown = theta.copy()
                grown[side] = max(grown[side] + phi, 2 * shape.bounds[0])
                out.append(("grow", grown, turned + np.r_[shift / 2, 0]))
    return out


def _in_body(n, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * n[0] + s * n[1], -s * n[0] + c * n[1], n[2]])


def moved_along(x, old, new):
    """Return poses x (3, T) carried by the rigid motion that takes `old` to `new`."""
    turn = new[2] - old[2]
    c, s = np.cos(turn), np.sin(turn)
    arm = x[:2] - old[:2, None]
    return np.vstack([
        new[0] + c * arm[0] - s * arm[1], new[1] + s * arm[0] + c * arm[1], x[2] + turn
    ])
