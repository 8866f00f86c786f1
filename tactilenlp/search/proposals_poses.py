"""Proposals from an estimate of another class: a body on the poses that it found.

Sizes, and a place and a turn in the other body's frame, are fitted to all touches by
least squares (`body_on_poses`).  A polytope is that other body itself (`as_polytope`).
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from ..data.contact_segments import lasting_contacts
from ..data.sensor_noise import shift_in_time, shift_rotations
from ..geometry.transforms import (
    directions_in_body,
    moved_origin,
    points_in_body,
    rotvecs_back,
)
from ..problem.hypothesis import Hypothesis
from ..problem.poses import rotations_on_ground, upright_poses
from ..tracking.geometry import upright_surface
from ..tracking.tracks import GAP_SIGMA, NORMAL_SIGMA

START_TURNS = 8  # about the vertical, from which a body is fitted to poses
SMALL_BODY = 0.5  # [mean of the prior] all fingers are outside of it
BROAD = 20.0, 1.0  # [-] factors of deviations in fits to poses, in turn
PLACE = 20e-3  # [m] typical offset of its origin
TURN_OF_FIT = 0.3  # [rad] typical turn of it


def body_on_poses(job, estimate) -> Hypothesis | None:
    """Return a body of the job's class that moves as an estimate of another class does.

    None without touches.  The objective is the cost of the touches [nats], bounded as
    if some were outliers.
    """
    shape, data = job.shape, job.data
    x = upright_poses(job.scene.ground, estimate.position, estimate.quaternion)
    x = shift_in_time(data, x.T, -job.precision.latency).T
    t, f = np.nonzero(lasting_contacts(data))
    if not len(t):
        return None
    points = points_in_body(x, t, data.finger_position[t, f]).T
    normal = directions_in_body(x, t, data.normal[t, f]).T
    sigma = np.hypot(GAP_SIGMA, job.precision.position)
    sigma_n = np.hypot(NORMAL_SIGMA, job.precision.normal)
    best = _fit(shape, points, data.finger_radius[f], normal, sigma, sigma_n)
    *off, turn = best.x[shape.theta :]
    words = (f"poses of a {estimate.shape}",)
    there = moved_origin(x, off)
    there[2] += turn
    return Hypothesis(best.x[: shape.theta], there, float(best.cost), words)


def as_polytope(estimate, scene, samples: int | None = None) -> Hypothesis:
    """Return an estimate of any shape as the vertices and poses of a polytope.

    Planar poses in the ground's frame, free ones in the world where there is none; the
    body's axes are the world's at the last of so many samples.
    """
    data, by = estimate.measurements, -estimate.latency
    position = shift_in_time(data, estimate.position, by)[:samples]
    quaternion = shift_rotations(data, estimate.quaternion, by)[:samples]
    R = rotations_on_ground(scene.ground, quaternion)
    vertices = R[-1].apply(estimate.vertices)
    if scene.ground is None:
        x = np.vstack([position.T, rotvecs_back((R * R[-1].inv()).as_matrix()).T])
    else:
        vertices[:, 2] -= vertices[:, 2].min()
        x = upright_poses(scene.ground, position, quaternion)
        x[2] -= x[2, -1]
    return Hypothesis(vertices.ravel(), x, estimate.objective, (estimate.shape,))


def _fit(shape, points, radius, normal, sigma, sigma_n):
    """Return the best fit of sizes, place and turn: scipy's result of least squares.

    points (3, N): centres of fingers [m] in a frame on the ground, where the body is;
    radius (N,) [m]; normal (3, N): felt; sigma [m], sigma_n: of gaps and normals.  From
    every turn by continuation: deviations are first BROAD.
    """
    n, (mean, deviation) = shape.theta, shape.size_prior
    low, high = (np.broadcast_to(v, n) for v in shape.bounds)
    free, fits = np.full(3, np.inf), []
    arguments, (gap, _, level) = upright_surface(shape)
    each = ca.Function("surface", arguments, [gap, level]).map(len(radius))

    def residuals(z, broad):
        states = np.repeat(z[:, None], len(radius), 1)
        gap, out = map(np.asarray, each(states, points, radius[None]))
        felt = np.r_[gap[0] / sigma, ((out - normal) / sigma_n).ravel()] / broad
        return np.r_[felt, (z[:n] - mean) / deviation]

    begin = np.clip(np.broadcast_to(SMALL_BODY * np.array(mean), n), low, high)
    for turn in np.linspace(0, 2 * np.pi, START_TURNS, endpoint=False):
        z = np.r_[begin, 0.0, 0.0, turn]
        for broad in BROAD:
            fit = least_squares(
                residuals, z, args=(broad,), loss="soft_l1",
                x_scale=np.r_[np.broadcast_to(deviation, n), PLACE, PLACE, TURN_OF_FIT],
                bounds=(np.r_[low, -free], np.r_[high, free]),
            )  # fmt: skip
            z = fit.x
        fits.append(fit)
    return min(fits, key=lambda one: one.cost)
