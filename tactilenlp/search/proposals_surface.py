"""Proposals for any shape: bodies of random size that the first touch may have met.

The finger's centre is at the distance of its radius from the surface.  So for each
draw of theta, and of the direction in which the finger lies from the body's axis, that
point is found by bisection along a horizontal ray at the height of the finger; the
normal there and the one that was felt tell which way the body is turned.

Where the poses of another body are known that explains the touches (`on_poses`), sizes,
and a place and a turn in its frame, are fitted to all touches by least squares.  A
polytope is that other body itself (`as_polytope`).
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from ..data.contact_segments import lasting_contacts
from ..data.sensor_noise import in_time, turned_in_time
from ..geometry.transforms import (
    backward,
    directions_in_body,
    points_in_body,
    rotate_planar,
)
from ..problem.poses import rotations_on_ground, upright_poses
from ..tracking.first_touch import (
    DRAWN,
    TOP_TILT,
    YAW,
    first_contact,
    first_onset,
)
from ..tracking.geometry import geometry_of, upright_surface
from ..tracking.tracks import GAP_SIGMA, NORMAL_SIGMA
from .hypothesis import Hypothesis

SHARE = 0.75  # [prior deviations] of drawn sizes about the mean: 15 mm of a cuboid
SMALLEST, LARGEST = 1 / 3, 2.0  # [mean of the prior] sizes drawn
TRIED = 10  # draws for each that is kept, at most
SIZE_HALVINGS = 30
SLOPE = 0.3  # [-] deviation of the vertical part of a normal
SAME_HEIGHT = 2e-3  # [m] of a top and of a finger that touches it
START_TURNS = 8  # about the vertical, from which a body is fitted to poses
SMALL_BODY = 0.5  # [mean of the prior] all fingers are outside of it
BROAD = 20.0, 1.0  # [-] factors of deviations in fits to poses, in turn
PLACE = 20e-3  # [m] typical offset of its origin
SIGMA = 6e-3, 3e-3, 0.15  # [m, m, rad] of sizes, place, yaw of a draw


def from_surface(data, shape, rng):
    """Return DRAWN states z (n + 3, S) and their covariances P at the first touch."""
    geometry = geometry_of(shape)
    (t, f), (_, n) = first_onset(data), first_contact(data)
    centre, radius = data.finger_position[t, f], data.finger_radius[f]
    theta = _drawn(shape, rng, TRIED * DRAWN)
    around, top = rng.uniform(0, 2 * np.pi, theta.shape[1]), np.hypot(*n[:2]) < TOP_TILT
    if top and not shape.rolls:
        theta = _as_high(geometry, theta, centre[2] - radius)
        z, met = _under(geometry, theta, around, centre, radius, rng)
    else:
        z, met = _beside(geometry, theta, around, centre, radius)
    _, normal = geometry.contact(z, np.array([0.0, 0.0, centre[2]]), radius)
    if top:
        z[-1] = rng.uniform(0, 2 * np.pi, len(around))
    else:
        z[-1] = np.arctan2(n[1], n[0]) - np.arctan2(normal[1], normal[0])
        z[-1] += 0.0 if shape.round else YAW * rng.normal(size=len(around))
    z[-3:-1] = centre[:2, None] - rotate_planar(z[-1], *-z[-3:-1])
    if shape.round:
        z[-1] = 0.0
    likely = np.exp(-(((normal[2] - n[2]) / SLOPE) ** 2) / 2)
    weight = np.where(met, likely, 0.0) + np.finfo(float).tiny
    rows = rng.choice(len(weight), DRAWN, p=weight / weight.sum())
    P = np.diag(geometry.each(*SIGMA) ** 2)
    return z[:, rows], np.repeat(P[..., None], DRAWN, axis=2)


def on_poses(job, estimate) -> Hypothesis | None:
    """Return a body of the job's class that moves as an estimate of another class does.

    None without touches.  The objective is the cost of the touches [nats], bounded as
    if some were outliers.
    """
    shape, data = job.shape, job.data
    x = upright_poses(job.scene.ground, estimate.position, estimate.quaternion)
    x = in_time(data, x.T, -job.precision.latency).T
    t, f = np.nonzero(lasting_contacts(data))
    if not len(t):
        return None
    points = points_in_body(x, t, data.finger_position[t, f]).T
    normal = directions_in_body(x, t, data.normal[t, f]).T
    sigma = np.hypot(GAP_SIGMA, job.precision.position)
    sigma_n = np.hypot(NORMAL_SIGMA, job.precision.normal)
    best = _fitted(shape, points, data.finger_radius[f], normal, sigma, sigma_n)
    *off, turn = best.x[shape.theta :]
    place = x[:2] + rotate_planar(x[2], *np.array(off)[:, None])
    words = (f"poses of a {estimate.shape}",)
    there = np.vstack([place, x[2] + turn])
    return Hypothesis(best.x[: shape.theta], there, float(best.cost), words)


def as_polytope(estimate, scene, samples: int | None = None) -> Hypothesis:
    """Return an estimate of any shape as the vertices and poses of a polytope.

    Planar poses in the ground's frame, free ones in the world where there is none; the
    body's axes are the world's at the last of so many samples.
    """
    data, by = estimate.measurements, -estimate.latency
    position = in_time(data, estimate.position, by)[:samples]
    quaternion = turned_in_time(data, estimate.quaternion, by)[:samples]
    R = rotations_on_ground(scene.ground, quaternion)
    vertices = R[-1].apply(estimate.vertices)
    if scene.ground is None:
        x = np.vstack([position.T, backward((R * R[-1].inv()).as_matrix()).T])
    else:
        vertices[:, 2] -= vertices[:, 2].min()
        x = upright_poses(scene.ground, position, quaternion)
        x[2] -= x[2, -1]
    return Hypothesis(vertices.ravel(), x, estimate.objective, (estimate.shape,))


def _fitted(shape, points, radius, normal, sigma, sigma_n):
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
                x_scale=np.r_[np.broadcast_to(deviation, n), PLACE, PLACE, 0.3],
                bounds=(np.r_[low, -free], np.r_[high, free]),
            )  # fmt: skip
            z = fit.x
        fits.append(fit)
    return min(fits, key=lambda one: one.cost)


def _drawn(shape, rng, count: int) -> np.ndarray:
    """Return theta (n, count), drawn about the mean of the prior."""
    mean, deviation = (
        np.broadcast_to(v, shape.theta)[:, None] for v in shape.size_prior
    )
    low, high = (np.broadcast_to(v, shape.theta)[:, None] for v in shape.bounds)
    theta = mean + SHARE * deviation * rng.normal(size=(shape.theta, count))
    low, high = np.maximum(low, SMALLEST * mean), np.minimum(high, LARGEST * mean)
    return np.clip(theta, low, high)


def _as_high(geometry, theta, height: float):
    """Return theta (n, S), its entries that make a body high such that it is `height`.

    Heights are taken to be proportional to these entries.
    """
    still = np.zeros((3, theta.shape[1]))
    now, out = geometry.height(np.vstack([theta, still])), theta.copy()
    for i, row in enumerate(theta):
        more = theta.copy()
        more[i] = 1.01 * row
        if np.abs(geometry.height(np.vstack([more, still])) - now).max() > 0:
            out[i] *= height / now
    return out


def _under(geometry, theta, around, centre, radius, rng):
    """Return states with yaw 0 whose top the finger touches, as of `_beside`."""
    way = geometry.reach(np.vstack([theta, np.zeros((3, theta.shape[1]))]))
    way = way * np.sqrt(rng.random(theta.shape[1]))  # evenly over a disc
    z = np.vstack([theta, -way * np.cos(around), -way * np.sin(around), 0 * around])
    gap, n = geometry.contact(z, np.array([0.0, 0.0, centre[2]]), radius)
    return z, (np.abs(gap) < SAME_HEIGHT) & (n[2] > 1 - SLOPE)


def _beside(geometry, theta, around, centre, radius):
    """Return states (n + 3, count) with yaw 0 that the finger touches, and which do.

    Their place is relative to the finger's centre, of which the height counts.
    """
    ahead = np.stack([np.cos(around), np.sin(around)])
    point = np.array([0.0, 0.0, centre[2]])
    top = 2 * np.linalg.norm(np.abs(theta).max(axis=1)) + radius
    low, high = np.zeros(theta.shape[1]), np.full(theta.shape[1], top)

    def state(way):
        return np.vstack([theta, -way * ahead, np.zeros_like(way)])

    met = geometry.contact(state(low), point, radius)[0] < 0
    met &= geometry.contact(state(high), point, radius)[0] > 0
    for _ in range(SIZE_HALVINGS):
        middle = (low + high) / 2
        inside = geometry.contact(state(middle), point, radius)[0] < 0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return state(low), met
