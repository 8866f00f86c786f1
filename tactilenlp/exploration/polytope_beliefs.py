r"""What is believed of a hull before an action: its vertices where they lie now.

Twenty vertices have sixty directions, and no touch ever tells of most of them.  The
gain counts those only that the planned touches would tell of, given what is known of
them; so what is known is put together afresh, each part positive semidefinite:

before   a ball, as in the page: v_j = m + r u_j + e_j, of which the centre m is
         anywhere, the radius r as the size prior has it, and the e_j are independent,
         SPREAD radii along u_j and STAY across it
felt     eq:obsinfo of every sample, gap and normal, through the weights that the
         nearest point gives to the vertices: of a plane where a face was felt, of an
         edge where two planes meet.  The body's way since is that of the estimate, its
         steps uncertain as in `pushed`: a Kalman filter backward from the last sample.
         A touch is as exact as touched faces come out, however many samples it has
flat     a face that was felt, and the ground, is one plane: vertices on it move
         together, FLAT off it.  What only bends a felt face is no news to hope for

The exact information of the estimate is not used here: it holds what slides along the
surface by a regulariser (`stay`), the size of the whole body with it, and the ball's
pull curves down where a vertex is inside.
"""

from __future__ import annotations

import numpy as np

from formulations import rigid_body
from formulations.between_actions import GAP
from formulations.polytope_quasi_static import LEG, SPREAD, STAY

from ..geometry.convex_hull import hull_vertices, nearest
from ..geometry.transforms import rotation_of
from ..information.polytope_information import FACE_TILT
from ..problem.polytope_window import LIFTED
from ..problem.reductions import ARM
from .beliefs import VAGUE, Belief, steepness
from .push_model import LEAST_SPREAD, REMEMBERED, SHARE, remembered

TOUCH = 0.3e-3  # [m] as exact as touched faces come out, beside TILT
ALIKE = 10  # samples of a touch, which share that error
FLAT = 0.3e-3  # [m] deviation of a vertex from the plane of a felt face
ON = 0.5e-3  # [m] a vertex this near to the plane of a touch lies on it
FEW = 3  # vertices always lie on one plane


def hull_believed(estimate, shape) -> list[Belief]:
    """Return what is believed of a hull: one hypothesis."""
    ground = estimate.scene.ground
    centre = ground.to_ground(estimate.position[-1])
    R_go = ground.rotation @ estimate.rotation()
    vertices = estimate.vertices @ R_go.T
    before = ball(vertices, shape.size_prior)
    points = fingers_then(estimate)
    known = before + felt(estimate, shape, vertices, points)
    known += flat(vertices, centre[2], contacts(estimate, vertices, points))
    known = loosened(known, vertices)
    return [Belief(vertices.ravel(), known, before, 1.0, -centre[None])]


def hull_sensors(estimate) -> np.ndarray:
    """Return alpha [1/m], sigma [m] of a felt gap, sigma_n [rad] of one sample."""
    p, n = estimate.precision["position"], estimate.precision["normal"]
    sigma, sigma_n = np.sqrt(ALIKE) * TOUCH, np.sqrt(ALIKE) * FACE_TILT
    return np.array([steepness(p), np.hypot(sigma, p), np.hypot(sigma_n, n)])


def ball(vertices, size) -> np.ndarray:
    """Return the information (3 V, 3 V) before any touch of vertices about a ball.

    size: mean and deviation [m] of its radius.
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
    C += VAGUE[0] ** 2 * np.tile(np.eye(3), (V, V))
    return np.linalg.inv(C)


def fingers_then(estimate) -> np.ndarray:
    """Return where the fingers were on the body as it lies now (T, F, 3), about it."""
    ground = estimate.scene.ground
    origin = ground.to_ground(estimate.position)[:, None]
    p = ground.to_ground(estimate.seen_positions) - origin
    turn = rotation_of(estimate.quaternion)
    since = turn[-1] * turn.inv()
    since = ground.rotation @ since.as_matrix() @ ground.rotation.T
    return np.einsum("tij,tfj->tfi", since, p)


def felt(estimate, shape, vertices, points) -> np.ndarray:
    """Return eq:obsinfo of all samples (3 V, 3 V), the way since then being unsure."""
    data = estimate.measurements
    position = estimate.scene.ground.to_ground(estimate.position)
    turn = rotation_of(estimate.quaternion)
    yaw = (turn[1:] * turn[:-1].inv()).magnitude()
    way = (np.diff(position[:, :2], axis=0) ** 2).sum(axis=1) + (ARM * yaw) ** 2
    Q = SHARE**2 * way + LEAST_SPREAD**2 + GAP**2 * (np.diff(data.action) != 0)
    Q = np.r_[Q, 0.0][:, None] / np.r_[1, 1, ARM**2]  # of the step after each sample
    r, k, z = points.reshape(len(points), -1), vertices.size, vertices.ravel()
    now, out = (np.zeros((3, k)), np.zeros((3, 3))), np.zeros((k, k))
    step = remembered(shape, data.fingers)
    for end in range(data.samples, 0, -REMEMBERED):
        back = np.arange(end - 1, end - 1 - REMEMBERED, -1)
        here, at = back >= 0, np.maximum(back, 0)  # before the first: says nothing
        M, P, E = step(
            *now, z, r[at].T, data.finger_radius, data.contact[at].T.astype(float),
            here * data.valid[at].T, here * Q[at].T, hull_sensors(estimate),
        )  # fmt: skip
        now = M[:, -k:], P[:, -3:]
        rows = E.full().reshape(-1, k)
        out += rows.T @ rows
    return out


def contacts(estimate, vertices, points):
    """Return where the body was felt and along what, (n, 3) each, about the centre."""
    data = estimate.measurements
    centre = points[data.contact & data.valid]
    point = nearest(hull_vertices(vertices), centre)
    n = centre - point
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
    return point, n


def flat(vertices, height: float, felt) -> np.ndarray:
    """Return the information (3 V, 3 V) that felt faces and the ground are planes.

    height [m]: of the centre above the ground.
    """
    V = len(vertices)
    out = np.zeros((V, 3, V, 3))
    stands = np.nonzero(vertices[:, 2] + height < LIFTED)[0]
    out[stands, 2, stands, 2] += 1 / LEG**2
    seen = set()
    for point, n in zip(*felt, strict=True):
        on = np.nonzero((point - vertices) @ n < ON)[0]
        if len(on) <= FEW or tuple(on) in seen:
            continue
        seen.add(tuple(on))
        A = np.c_[np.ones(len(on)), vertices[on] - point]
        bend = np.eye(len(on)) - A @ np.linalg.pinv(A, rcond=1e-2)
        part = np.einsum("ij,a,b->iajb", bend, n, n) / FLAT**2
        out[np.ix_(on, range(3), on, range(3))] += part
    return out.reshape(3 * V, 3 * V)


def loosened(information, vertices) -> np.ndarray:
    """Return the information once the fingers have gone: the body may slip a little."""
    slip = np.zeros((len(vertices), 3, 3))
    slip[:, 0, 0] = slip[:, 1, 1] = GAP
    slip[:, 0, 2], slip[:, 1, 2] = -vertices[:, 1], vertices[:, 0]
    slip[:, :, 2] *= GAP / rigid_body.ARM
    slip = slip.reshape(-1, 3)
    loose = np.linalg.inv(np.linalg.inv(information) + slip @ slip.T)
    return (loose + loose.T) / 2
