"""Proposals: Gaussians of size and planar pose from which tracks start.

The first touch alone says where a box may be (tracking/first_touch.py), or a user's
guess does (`from_guess`).  Later, the posterior of what was solved is a Gaussian
mixture (`from_posterior`): of each hypothesis size and last pose, by the Hessian of
least motion, and how the poses before them change along.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import quasi_static

from ..problem.fingertips import as_spheres
from ..tracking.first_touch import (
    DRAWN,
    SMALLEST,
    START_SIGMA,
    TOP_TILT,
    body_height,
    first_contact,
)
from ..tracking.geometry import geometry_of
from .hypothesis import Job
from .least_motion import WEAK_MOTION
from .local_solve import problem_at, start_values

# [m, rad] deviations of a posterior, at most and at least:
SIGMA_MAX = 0.02, 0.03, 0.5  # of sizes, place, yaw
SIGMA_MIN = 1e-3, 1e-3, 0.03
UNSEEN_INFORMATION = 1e-4  # [1 / scaled unknown^2] of an unobserved direction


def centred(job: Job) -> tuple:
    """Return the guess (name, theta, x) of a typical box, touched in mid-face."""
    data = as_spheres(job.data, job.scene)
    p, n = first_contact(data)
    mean, top = job.shape.typical_size, np.linalg.norm(n[:2]) < TOP_TILT
    height = body_height(data, job.shape, mean, job.precision.normal)
    level = n[:2] / max(np.linalg.norm(n[:2]), 1e-9)
    place = p[:2] if top else p[:2] - mean / 2 * level
    yaw = 0.0 if top else np.arctan2(n[1], n[0])
    return "middle", np.array([mean, mean, height]), np.r_[place, yaw]


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
    return z, np.repeat(np.diag(sigma**2)[..., None], DRAWN, axis=2)


def from_posterior(job: Job, kept):
    """Return for each hypothesis (P, along), by the Hessian of least motion.

    P (n + 3, n + 3): covariance of theta and last pose; along (T, 3, n + 3): slopes of
    the poses in these.  The job holds the data of the hypotheses' samples.
    """
    problem, window, _ = problem_at(replace(job, page=quasi_static))
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
