"""Proposals: how a new action may continue a hypothesis; nothing is solved.

The first touch alone proposes where a body may be (`first_guesses`).  Later, the past
is a Gaussian of size and last pose, by the Hessian of least motion; its mean, its sigma
points along the least certain directions, and what a new touch contradicts
(`realignments`) are filtered through the new action (kalman_filter.py).  The poses of
the past follow the change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import quasi_static
from formulations.finger import SPHERE

from ..geometry.transforms import carried, rotate_planar
from ..problem.fingertips import as_spheres
from ..problem.reductions import reduce
from .hypothesis import Hypothesis, Job
from .kalman_filter import filtered_paths, finger_residuals, lasting_contacts
from .local_solve import problem_for, start_values

WEAK_MOTION = {"motion weight": 100.0}  # [nats/m] a third of the page's own
SIGMA_DIRECTIONS = 2  # least certain directions with sigma points
TURNED_AS_A_WHOLE = 0.3  # [rad] a larger turn moves the past as one piece
STRAIGHT_TURN = 0.1  # [-] of the process noise in yaw, for a straight push
# [m, rad] deviations of size and pose of a proposal, at most and at least:
GUESS_SIGMA_MAX = np.r_[0.02, 0.02, 0.02, 0.03, 0.03, 0.5]
GUESS_SIGMA_MIN = np.r_[1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.03]
END_UNITS = np.r_[1, 1, 1, 1, 1, 20e-3]  # [m] that a unit of size and pose counts
UNSEEN_INFORMATION = 1e-4  # [1 / scaled unknown^2] of an unobserved direction
NORMAL_SAMPLES = 5  # at the beginning of a touch, whose normals are averaged
MISALIGNED = np.radians(8)  # a normal this far off its face needs a realignment
OPEN_GAP = 3e-3  # [m] and so does a gap this wide where contact is felt
BELOW_TOP = 5e-3  # [m] a side touch is at least this far below the top
TOP_TILT = 0.14  # [-] sine of the tilt (8 degrees) up to which a normal is the top's
RIM_NORMAL = 0.25  # [-] n_z of a touch of the rim, beyond three sigma of noise


def extensions(job: Job, kept: list[Hypothesis]) -> list[Hypothesis]:
    """Return proposals of how the last action continues each hypothesis."""
    if not kept:
        return first_touches(job)
    data, window = spherical(job)
    new = np.nonzero(data.action == data.action[-1])[0]
    earlier = job.data.select(np.unique(job.data.action)[:-1])
    proposed = []
    for h, P, along in _posteriors(replace(job, data=earlier), kept):
        end = h.end
        end[2] = body_height(h.seen(data), job.shape, end[2])
        guesses = [("on", end, 1.0), ("straight", end, STRAIGHT_TURN)]
        guesses += [(f"kick {i}", end + d, 1.0) for i, d in enumerate(_sigma_points(P))]
        n = len(h.theta)
        args = (h.seen(data), window, job.shape, end[:n], end[n:], data.action[-1])
        for name, theta, x in realignments(*args):
            guesses.append((name, np.r_[theta, x], 1.0))
        proposed += [(h, along, name, z, P, turning) for name, z, turning in guesses]
    hs, alongs, names, *guesses = zip(*proposed, strict=True)
    given = data, window, job.shape
    offsets = [np.broadcast_to(h.shift, (3, data.fingers)) for h in hs]
    guesses = [np.array(g) for g in guesses]
    z, tails = filtered_paths(*given, *guesses, new, np.array(offsets))
    ends = zip(hs, alongs, names, z, tails, strict=True)
    return [_continued(*end) for end in ends]


def followed(job: Job, h: Hypothesis) -> Hypothesis:
    """Return a hypothesis whose pose a filter follows through the remaining actions."""
    data, window = spherical(job)
    new = np.arange(h.x.shape[1], data.samples)
    spread = np.diag(GUESS_SIGMA_MIN**2)[None]
    offset = np.broadcast_to(h.shift, (3, data.fingers))[None]
    given = data, window, job.shape, h.end[None], spread, np.ones(1), new, offset
    _, (tail,) = filtered_paths(*given)
    return replace(h, x=np.hstack([h.x, tail]), path=(*h.path, "followed"))


def spherical(job: Job):
    """Return data and window as if every fingertip were a sphere."""
    window = reduce(job.data, job.scene, job.shape, job.precision, job.reductions)
    return as_spheres(job.data, job.scene), replace(window, finger=SPHERE)


def _continued(h, along, name, end, tail) -> Hypothesis:
    """Return the hypothesis whose past is changed so that it ends at `end`."""
    n = len(h.theta)
    change = end - h.end
    if abs(change[-1]) > TURNED_AS_A_WHOLE:
        past = carried(h.x, h.x[:, -1], end[n:])
    else:
        past = h.x + (along @ change).T
    x = np.hstack([past, tail])
    return replace(h, theta=end[:n], x=x, objective=np.inf, path=(*h.path, name))


def first_touches(job: Job) -> list[Hypothesis]:
    """Return proposals from the first touch, at rest before it."""
    (data, window), shape = spherical(job), job.shape
    touches = (touch_onsets(data, action) for action in np.unique(data.action))
    t, f = next(touch[0] for touch in touches if touch)
    guesses = job.first or first_guesses(data, shape, t, f)
    names, theta, x = zip(*guesses, strict=True)
    z = np.tile(np.hstack([theta, x]), (2, 1))
    names = [*names, *(f"{name} straight" for name in names)]
    turning = np.repeat([1.0, STRAIGHT_TURN], len(x))
    spread = np.tile(GUESS_SIGMA_MAX, (len(z), 1))
    spread[:, shape.theta :] *= turning[:, None]
    P = spread[:, :, None] ** 2 * np.eye(len(GUESS_SIGMA_MAX))
    new = range(t, len(data.time))
    z, tails = filtered_paths(data, window, shape, z, P, turning, new)
    out = []
    for name, end, tail in zip(names, z, tails, strict=True):
        theta, x = np.split(end, [shape.theta])
        path = np.hstack([np.repeat(x[:, None], t, axis=1), tail])
        out.append(Hypothesis(theta, path, np.inf, (name,)))
    return out


def _posteriors(job: Job, kept):
    """Return (hypothesis, P, along) by the Hessian of least motion at each hypothesis.

    P (n + 3, n + 3): covariance of theta and last pose; along (T, 3, n + 3): slopes of
    the poses in these.
    """
    problem, window = problem_for(job, quasi_static)
    data, scale, out = problem.data(WEAK_MOTION), problem.scale, []
    n, m = job.shape.theta, window.motion.unknowns
    theta, poses = (problem.variables[name].span for name in ("theta", "x"))
    end = np.r_[theta, poses.stop - m : poses.stop]
    for h in kept:
        x = problem.pack(start_values(problem, window, h))
        H = sum(problem.hessian(name, x, data) for name in problem.costs).toarray()
        values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
        vectors = vectors * scale[:, None]
        C = (vectors / np.maximum(np.abs(values), UNSEEN_INFORMATION)) @ vectors[end].T
        along = np.linalg.solve(C[end], C[poses].T).T.reshape(-1, m, n + m)[window.pose]
        shrink = np.minimum(1, GUESS_SIGMA_MAX / np.sqrt(np.diag(C[end])))
        P = C[end] * np.outer(shrink, shrink) + np.diag(GUESS_SIGMA_MIN**2)
        out.append((h, P, along))
    return out


def _sigma_points(P) -> list[np.ndarray]:
    """Return changes of theta and pose by one sigma in the least certain directions."""
    values, vectors = np.linalg.eigh(P * np.outer(END_UNITS, END_UNITS))
    ways = (vectors * np.sqrt(values)).T[::-1][:SIGMA_DIRECTIONS] / END_UNITS
    return [sign * way for way in ways for sign in (1, -1)]


def touch_onsets(data, action) -> list[tuple[int, int]]:
    """Return (sample, finger) where each finger's touch begins in an action."""
    mine = (data.action == action)[:, None]
    for felt in (lasting_contacts(data) & mine, data.contact & data.valid & mine):
        if felt.any():
            found = [(int(np.argmax(felt[:, f])), f) for f in range(data.fingers)]
            return sorted((t, f) for t, f in found if felt[t, f])
    return []


def body_height(data, shape, otherwise: float) -> float:
    """Return the height [m]: of the rim if it was touched, else above all touches."""
    felt = lasting_contacts(data)
    n_z = data.normal[..., 2]
    z = data.finger_position[..., 2] - data.finger_radius * n_z
    rim = z[felt & (n_z > RIM_NORMAL)]
    if rim.size and np.median(np.abs(rim - np.median(rim))) < OPEN_GAP:  # else it tilts
        return float(np.clip(np.median(rim), *shape.bounds))
    side = z[felt & (np.abs(n_z) < TOP_TILT)]
    return (
        max(otherwise, np.quantile(side, 0.9) + BELOW_TOP) if side.size else otherwise
    )


def first_guesses(data, shape, t, f) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return (name, theta, x) that explain the first touch, of finger f at sample t."""
    n = _mean_normal(data, t, f)
    p = data.finger_position[t, f] - data.finger_radius[f] * n
    mean = shape.size_prior[0]
    theta = np.full(shape.theta, mean)
    theta[2] = body_height(data, shape, mean)
    level = np.linalg.norm(n[:2])
    if level < TOP_TILT:
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


def realignments(data, window, shape, theta, x, action):
    """Return (name, theta, x before the action) variations that meet a new side touch.

    The first touch of each finger in this action determines where a face is, and its
    normal. Where that contradicts the hypothesis, either the whole past was turned and
    shifted ("turn": to the nearest face, "edge": to the nearest edge), or the touched
    side lies further out ("grow").
    """
    out = []
    for t, f in touch_onsets(data, action):
        n = _mean_normal(data, t, f)
        level = np.linalg.norm(n[:2])
        if level < TOP_TILT:
            continue
        off = (np.arctan2(n[1], n[0]) - x[2] + np.pi / 4) % (np.pi / 2) - np.pi / 4
        face = off if abs(off) > MISALIGNED else 0.0
        edge = off - np.copysign(np.pi / 4, off)
        residuals = finger_residuals(shape, window.motion, window.finger)
        for name, turn in (("turn", face), ("edge", edge)):
            turned = x + np.r_[0, 0, turn]
            touch = (data.finger_position[t, f], data.finger_radius[f], n)
            phi = float(residuals(np.r_[theta, turned], *touch)[0])
            shift = np.r_[phi * n[:2] / level, 0]
            if turn or abs(phi) > OPEN_GAP:
                out.append((name, theta, turned + shift))
            if name == "turn" and abs(phi) > OPEN_GAP:
                grown = _grown(shape, theta, turned[2], n, phi)
                out.append(("grow", grown, turned + shift / 2))
    return out


def _mean_normal(data, t, f) -> np.ndarray:
    """Return the mean normal of the touch that begins at sample t."""
    rows = np.arange(t, min(t + NORMAL_SAMPLES, len(data.time)))
    rows = rows[data.contact[rows, f] & (data.action[rows] == data.action[t])]
    n = data.normal[rows, f].mean(axis=0)
    return n / max(np.linalg.norm(n), 1e-9)


def _grown(shape, theta, yaw, n, phi) -> np.ndarray:
    """Return theta with the side that looks along n moved out by phi."""
    side = int(np.argmax(np.abs(rotate_planar(-yaw, n[0], n[1]))))
    grown = theta.copy()
    grown[side] = np.clip(grown[side] + phi, 2 * shape.bounds[0], shape.bounds[1])
    return grown
