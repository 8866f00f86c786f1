"""Proposals: Gaussians of size and planar pose from which tracks start.

The first touch alone says where a box may be (`from_first_touch`), or a user's guess
does (`from_guess`).  Later, the posterior of what was solved is a Gaussian mixture
(`from_posterior`): of each hypothesis size and last pose, by the Hessian of least
motion, and how the poses before them change along.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import quasi_static
from formulations.finger import SPHERE

from ..data.contact_segments import lasting_contacts
from ..problem.fingertips import as_spheres
from ..problem.reductions import reduce
from ..tracking.geometry import geometry_of
from .hypothesis import Job
from .least_motion import WEAK_MOTION
from .local_solve import problem_for, start_values

DRAWN = 1000  # boxes that explain the first touch; 300 miss some
SIZE_SPREAD = 15e-3  # [m] deviation of drawn sides about their prior mean
SMALLEST, LARGEST = 15e-3, 90e-3  # [m] sides drawn
YAW = 0.15  # [rad] deviation of a face from the normal felt
ON_FACE = 0.7  # [-] share of draws that are touched on a face, not on an edge
EDGE_TURN = np.radians([15.0, 75.0])  # [rad] of a face from the normal at an edge
NORMAL_SAMPLES = 2  # whose normals are averaged: later ones show a body that turned
START_SIGMA = np.r_[6e-3, 6e-3, 4e-3, 3e-3, 3e-3, 0.15]  # [m, rad] of drawn boxes
# [m, rad] deviations of a posterior, at most and at least:
SIGMA_MAX = 0.02, 0.03, 0.5  # of sizes, place, yaw
SIGMA_MIN = 1e-3, 1e-3, 0.03
UNSEEN_INFORMATION = 1e-4  # [1 / scaled unknown^2] of an unobserved direction
OPEN_GAP = 3e-3  # [m] touches of one rim agree this well
BELOW_TOP = 5e-3  # [m] a side touch is at least this far below the top
TOP_TILT = 0.14  # [-] sine of the tilt (8 degrees) up to which a normal is the top's
RIM_NORMAL = 0.25  # [-] n_z of a touch of the rim, beyond three sigma of noise


def touched(data) -> bool:
    """Tell whether there is a touch, from which a search can begin."""
    return bool((data.contact & data.valid).any())


def first_onset(data) -> tuple[int, int]:
    """Return sample and finger of the first touch."""
    touches = (touch_onsets(data, action) for action in np.unique(data.action))
    return next(touch[0] for touch in touches if touch)


def first_contact(data) -> tuple[np.ndarray, np.ndarray]:
    """Return the point (3,) [m] and the normal (3,) of the first touch."""
    t, f = first_onset(data)
    rows = np.arange(t, min(t + NORMAL_SAMPLES, len(data.time)))
    rows = rows[data.contact[rows, f]]
    n = data.normal[rows, f].mean(axis=0)
    n /= max(np.linalg.norm(n), 1e-9)
    return data.finger_position[t, f] - data.finger_radius[f] * n, n


def centred(job: Job) -> tuple:
    """Return the guess (name, theta, x) of a typical box, touched in mid-face."""
    data, _ = spherical(job)
    p, n = first_contact(data)
    mean, top = job.shape.size_prior[0], np.linalg.norm(n[:2]) < TOP_TILT
    height = body_height(data, job.shape, mean)
    level = n[:2] / max(np.linalg.norm(n[:2]), 1e-9)
    place = p[:2] if top else p[:2] - mean / 2 * level
    yaw = 0.0 if top else np.arctan2(n[1], n[0])
    return "middle", np.array([mean, mean, height]), np.r_[place, yaw]


def from_first_touch(data, shape, rng, count=DRAWN):
    """Return states z (6, count) and covariances P (6, 6, count) at the first touch."""
    p, n = first_contact(data)
    mean = shape.size_prior[0]
    a, b = np.clip(rng.normal(mean, SIZE_SPREAD, (2, count)), SMALLEST, LARGEST)
    if np.linalg.norm(n[:2]) < TOP_TILT:
        yaw = rng.uniform(0, np.pi / 2, count)
        u, v = rng.uniform(-0.5, 0.5, (2, count)) * [a, b]
    else:
        on_face = rng.random(count) < ON_FACE
        turn = np.where(
            on_face, YAW * rng.normal(size=count), rng.uniform(*EDGE_TURN, count)
        )
        yaw = np.arctan2(n[1], n[0]) + turn
        along = np.where(on_face, rng.uniform(-0.5, 0.5, count), -0.5)
        u, v = a / 2, along * b
    c, s = np.cos(yaw), np.sin(yaw)
    h = np.full(count, body_height(data, shape, mean))
    z = np.array([a, b, h, p[0] - c * u + s * v, p[1] - s * u - c * v, yaw])
    return z, repeated(np.diag(START_SIGMA**2), count)


def from_guess(guess, geometry, rng):
    """Return states and covariances about a user's guess (name, theta, x)."""
    _, theta, x = guess
    sigma = START_SIGMA
    if len(theta) != 3:
        sigma = geometry.each(START_SIGMA[0], *START_SIGMA[4:])
    off = sigma[:, None] * rng.normal(size=(len(sigma), DRAWN))
    off[:, 0] = 0.0
    z = np.r_[theta, x][:, None] + off
    z[:-3] = np.maximum(z[:-3], SMALLEST / 2)
    return z, repeated(np.diag(sigma**2), DRAWN)


def from_posterior(job: Job, kept):
    """Return for each hypothesis (P, along), by the Hessian of least motion.

    P (n + 3, n + 3): covariance of theta and last pose; along (T, 3, n + 3): slopes of
    the poses in these.  The job holds the data of the hypotheses' samples.
    """
    problem, window = problem_for(job, quasi_static)
    data, scale, out = problem.data(WEAK_MOTION), problem.scale, []
    n, m = job.shape.theta, window.motion.unknowns
    theta, poses = (problem.variables[name].span for name in ("theta", "x"))
    geometry = geometry_of(job.shape)
    most, least = (geometry.each(*s) for s in (SIGMA_MAX, SIGMA_MIN))
    end = np.r_[theta, poses.stop - m : poses.stop]
    for h in kept:
        x = problem.pack(start_values(problem, window, h))
        H = sum(problem.hessian(name, x, data) for name in problem.costs).toarray()
        values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
        vectors = vectors * scale[:, None]
        C = (vectors / np.maximum(np.abs(values), UNSEEN_INFORMATION)) @ vectors[end].T
        along = np.linalg.solve(C[end], C[poses].T).T.reshape(-1, m, n + m)[window.pose]
        shrink = np.minimum(1, most / np.sqrt(np.diag(C[end])))
        P = C[end] * np.outer(shrink, shrink) + np.diag(least**2)
        out.append((P, along))
    return out


def spherical(job: Job):
    """Return data and window as if every fingertip were a sphere."""
    window = reduce(job.data, job.scene, job.shape, job.precision, job.reductions)
    return as_spheres(job.data, job.scene), replace(window, finger=SPHERE)


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


def repeated(P, count):
    """Return a covariance (k, k) for each of so many states, (k, k, count)."""
    return np.repeat(P[..., None], count, axis=2)
