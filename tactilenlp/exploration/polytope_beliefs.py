r"""The belief about a polytope before an action: a Gaussian of its vertices.

The vertices are taken where they lie now.  Twenty have sixty unknowns, most of which no
touch observes.  The gain should count only those that the planned contacts observe,
given what is known.  So the information is summed afresh from parts that are positive
semidefinite each:

prior    a ball, as in the page: v_j = m + r u_j + e_j, with any centre m, the radius r
         of the size prior, and independent e_j, SPREAD radii along u_j, STAY across it
samples  eq:obsinfo of every sample, gap and normal, through the weights that the
         nearest point gives to the vertices: of a plane where a face was touched, of an
         edge where two planes meet.  The motion since then is the estimated one, with
         the uncertainty of steps as in `push_function`: a Kalman filter backward from
         the last sample.  The precision of a contact is that of touched faces,
         however many samples it has
planes   a touched face, and the ground, is one plane: vertices on it move together,
         FLATNESS_SIGMA off it.  No gain is counted for bending a touched face
unseen   behind a face that no finger felt the body may have a corner more, though its
         corners were felt on other faces.  The middles of the largest such faces are
         vertices of the belief as well: the prior alone tells where they are

The exact information of the estimate is not used: its regulariser (`stay`) holds the
motion of vertices along the surface, and with it the size of the whole body, and the
prior ball has negative curvature where a vertex is inside.
"""

from __future__ import annotations

import numpy as np

from formulations import rigid_body
from formulations.between_actions import GAP
from formulations.polytope_quasi_static import LEG, SPREAD, STAY
from formulations.pushed_hull import LIFTED

from ..geometry.convex_hull import hull_vertices, nearest_points
from ..geometry.faces import FACE_TILT, polygons
from ..geometry.support import Standing, settling
from ..geometry.transforms import is_planar, rotation_of
from . import beliefs
from .beliefs import POSE_PRIOR_SIGMA, Belief
from .push_model import (
    MIN_STEP_SIGMA,
    SAMPLES_PER_CALL,
    STEP_SIGMA_SHARE,
    backward_filter_function,
)

FACE_SIGMA = 0.3e-3  # [m] of touched faces as estimated, besides FACE_TILT
CORRELATED_SAMPLES = 10  # [1] samples of a contact that share this error
FLATNESS_SIGMA = 0.3e-3  # [m] of a vertex from the plane of a touched face
ON_PLANE = 0.5e-3  # [m] a vertex this near to the plane of a contact lies on it
LIFT = 0.1e-3  # [m] off its face, so that an unseen corner is a vertex of the hull
VERTICES_OF_A_PLANE = 3  # [1]: as many always lie on one plane


def belief_of(estimate, shape) -> Belief:
    """Return the belief about a polytope: one Gaussian, of the best hypothesis."""
    ground = estimate.scene.ground
    centre = ground.to_ground(estimate.position[-1])
    R_go = ground.rotation @ estimate.rotation()
    vertices = estimate.vertices @ R_go.T
    points = fingers_on_body(estimate)
    if not is_planar(estimate.unknowns["x"]):  # it may lean on a finger
        turn, centre = settling(vertices, centre)
        vertices, points = vertices @ turn.T, points @ turn.T
    contacts = contacts_on_hull(estimate, vertices, points)
    unseen = unseen_corners(vertices, contacts, shape.counts)
    vertices = np.vstack([vertices, unseen])
    shape = shape.pushed(shape, vertices.size)
    before = ball_prior(vertices, shape.size_prior)
    information = before + hull_information_of_samples(
        estimate, shape, vertices, points
    )
    information += flatness_information(vertices, centre[2], contacts)
    information = after_retraction(information, vertices)
    return Belief(vertices.ravel(), information, before, 1.0, -centre[None])


def unseen_corners(vertices, contacts, counts) -> np.ndarray:
    """Return points (n, 3) [m] where a hull may have corners that no finger felt.

    contacts: of contacts_on_hull.  As many points as the next of the numbers of
    vertices, counts, has more, LIFT outside of the middles of the largest faces with no
    contact in their planes.  The face on the ground is not one of them.
    """
    more = min((c - len(vertices) for c in counts if c > len(vertices)), default=0)
    point, normal = contacts
    faces = []
    for corners, n in polygons(vertices) if more else ():
        middle = vertices[corners].mean(axis=0)
        off = np.abs(((point - middle) * normal).sum(axis=1)).min(initial=np.inf)
        if off > ON_PLANE and n[2] > -np.cos(FACE_TILT):
            arms = vertices[corners] - middle
            spanned = np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0)
            faces.append((np.linalg.norm(spanned), middle + LIFT * n))
    faces.sort(key=lambda face: -face[0])
    return np.array([corner for _, corner in faces[:more]]).reshape(-1, 3)


def standing_hull_of(belief: Belief, centre) -> Standing:
    """Return a belief as a body that stands on the ground.

    centre (3,) [m]: of mass, from the centroid, along the ground's axes.
    """
    vertices, k = belief.z.reshape(-1, 3), len(belief.z)
    slopes = np.eye(k).reshape(len(vertices), 3, k)[:, :2]
    return Standing(vertices, np.zeros(3), centre[:2], slopes, belief.covariance)


def hull_sensor_model(estimate) -> np.ndarray:
    """Return alpha [1/m], sigma [m] of a gap in contact, sigma_n [rad] of a sample."""
    share = np.sqrt(CORRELATED_SAMPLES)
    return beliefs.sensor_model(estimate, share * FACE_SIGMA, share * FACE_TILT)


def ball_prior(vertices, size) -> np.ndarray:
    """Return the prior information (3 V, 3 V) of vertices about a ball.

    size: mean and standard deviation [m] of its radius.
    """
    mean, deviation = size
    u = vertices - vertices.mean(axis=0)
    u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), mean / 100)
    V = len(u)
    C = np.zeros((V, 3, V, 3))
    for j, n in enumerate(u):
        C[j, :, j] = STAY**2 * np.eye(3)
        C[j, :, j] += ((SPREAD * mean) ** 2 - STAY**2) * np.outer(n, n)
    C = C.reshape(3 * V, 3 * V) + deviation**2 * np.outer(u, u)
    C += POSE_PRIOR_SIGMA[0] ** 2 * np.tile(np.eye(3), (V, V))
    return np.linalg.inv(C)


def fingers_on_body(estimate) -> np.ndarray:
    """Return finger positions (T, F, 3) [m] relative to the body, in its last pose."""
    ground = estimate.scene.ground
    origin = ground.to_ground(estimate.position)[:, None]
    p = ground.to_ground(estimate.seen_positions) - origin
    turn = rotation_of(estimate.quaternion)
    since = turn[-1] * turn.inv()
    since = ground.rotation @ since.as_matrix() @ ground.rotation.T
    return np.einsum("tij,tfj->tfi", since, p)


def hull_information_of_samples(estimate, shape, vertices, points) -> np.ndarray:
    """Return eq:obsinfo (3 V, 3 V) of all samples, with uncertain motion since then."""
    data = estimate.measurements
    position = estimate.scene.ground.to_ground(estimate.position)
    turn = rotation_of(estimate.quaternion)
    yaw = (turn[1:] * turn[:-1].inv()).magnitude()
    way = (np.diff(position[:, :2], axis=0) ** 2).sum(axis=1)
    way += (rigid_body.ARM * yaw) ** 2
    Q = STEP_SIGMA_SHARE**2 * way + MIN_STEP_SIGMA**2
    Q += GAP**2 * (np.diff(data.action) != 0)
    # Of the step after each sample:
    Q = np.r_[Q, 0.0][:, None] / np.r_[1, 1, rigid_body.ARM**2]
    r, k, z = points.reshape(len(points), -1), vertices.size, vertices.ravel()
    now, out = (np.zeros((3, k)), np.zeros((3, 3))), np.zeros((k, k))
    step = backward_filter_function(shape, data.fingers)
    for end in range(data.samples, 0, -SAMPLES_PER_CALL):
        back = np.arange(end - 1, end - 1 - SAMPLES_PER_CALL, -1)
        at = np.maximum(back, 0)
        here = back >= 0  # before the first sample there is no information
        M, P, E = step(
            *now, z, r[at].T, data.finger_radius, data.contact[at].T.astype(float),
            here * data.valid[at].T, here * Q[at].T, hull_sensor_model(estimate),
        )  # fmt: skip
        now = M[:, -k:], P[:, -3:]
        rows = E.full().reshape(-1, k)
        out += rows.T @ rows
    return out


def contacts_on_hull(estimate, vertices, points):
    """Return contact points [m] and normals, (n, 3) each, about the centroid."""
    data = estimate.measurements
    centre = points[data.contact]
    point = nearest_points(hull_vertices(vertices), centre)
    n = centre - point
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
    return point, n


def flatness_information(vertices, height: float, contacts) -> np.ndarray:
    """Return the information (3 V, 3 V) that touched faces and the ground are planes.

    height: [m], of the centroid above the ground; contacts: of contacts_on_hull.
    """
    V = len(vertices)
    out = np.zeros((V, 3, V, 3))
    stands = np.nonzero(vertices[:, 2] + height < LIFTED)[0]
    out[stands, 2, stands, 2] += 1 / LEG**2
    seen = set()
    for point, n in zip(*contacts, strict=True):
        on = np.nonzero((point - vertices) @ n < ON_PLANE)[0]
        if len(on) <= VERTICES_OF_A_PLANE or tuple(on) in seen:
            continue
        seen.add(tuple(on))
        A = np.c_[np.ones(len(on)), vertices[on] - point]
        bend = np.eye(len(on)) - A @ np.linalg.pinv(A, rcond=1e-2)
        part = np.einsum("ij,a,b->iajb", bend, n, n) / FLATNESS_SIGMA**2
        out[np.ix_(on, range(3), on, range(3))] += part
    return out.reshape(3 * V, 3 * V)


def after_retraction(information, vertices) -> np.ndarray:
    """Return the information after the retraction, in which the body may slip."""
    slip = np.zeros((len(vertices), 3, 3))
    slip[:, 0, 0] = slip[:, 1, 1] = GAP
    slip[:, 0, 2], slip[:, 1, 2] = -vertices[:, 1], vertices[:, 0]
    slip[:, :, 2] *= GAP / rigid_body.ARM
    slip = slip.reshape(-1, 3)
    loose = np.linalg.inv(np.linalg.inv(information) + slip @ slip.T)
    return (loose + loose.T) / 2
