"""Compute the information about the vertices of a hull, and which faces were touched.

The last pose of a polytope is not estimated, so that the vertices carry all of the
uncertainty: they are those of the last sample, in the frame of the world.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from ..common.validation import check_types
from ..geometry.convex_hull import centroid, fingers_in_body
from ..geometry.transforms import directions_in_body
from ..nlp.kkt import KKTSystem
from .error_budget import PRIORS, Linearisation, errors_by_name, summed
from .error_budget_terms import REACHED
from .information import Information, at_solution
from .mixture import occam_factor, one_mode
from .tangent_space import TangentSpace
from .trajectory import trajectory_variance

LEAST_DEVIATION = 1e-6  # [m] deviation of what a bound holds: a vertex on the ground
FACE_REACH = 0.5e-3  # [m] a contact point this near to a face is on it
FACE_TILT = 0.05  # [rad] as exact as touched faces come out
# [rad], deviations: a touch at most so far off is of a face
MAX_TILT, TILT_DEVIATIONS = 0.14, 3.0


def polytope_information(at: Linearisation, solution, tangent, faces) -> Information:
    """Return the information about the vertices at the last sample, world frame.

    tangent: its TangentSpace; faces: touches of each polygon of the hull.
    """
    V, turned = solution.values["theta"].T, 0.0
    if at.tilt is not None:
        turned = at.tilt.turned(V)[:, :3].reshape(-1, 2)
    response = at.response(tangent.chosen, tangent.jacobian, turned)
    at.job.deadline.check()
    floor = LEAST_DEVIATION**2 * np.eye(V.size)
    indefinite = np.linalg.eigvalsh(response.hessian)[0] < -(LEAST_DEVIATION**2)
    C, errors = response.hessian + floor, errors_by_name(response)
    covariance = summed(errors) + floor
    middle = centroid(V), _slope_of_centroid(V)
    path = trajectory_variance(at, middle)
    missing = int(np.count_nonzero(faces == 0))
    words = (f"{missing} of {len(faces)} faces never touched",) if missing else ()
    return at_solution(
        at, response, tangent, np.linalg.inv(C), errors | {"active bounds": floor},
        spread=covariance, modes=one_mode(solution.objective, covariance),
        unobserved=words, directions=np.zeros((len(C), 0)),
        indefinite=("vertices",) if indefinite else (), path=np.sqrt(path),
    )  # fmt: skip


def occam_of_hull(kkt: KKTSystem) -> float:
    """Return what the evidence loses by the vertices of a solved page [nats].

    Before the data they are as open as the page's priors and its regulariser `stay`
    leave them, about the ball where it ended.
    """
    problem, own = kkt.problem, kkt.problem.variables["theta"].span
    held = kkt.hessian(problem.costs_of(*PRIORS))[own][:, own].toarray()
    return occam_of_vertices(kkt.marginal("theta"), held)


def occam_of_vertices(covariance, held) -> float:
    r"""Return what the evidence of a hull loses by its V vertices [nats].

        log(prior volume / posterior volume) - log(V! / (V - k)!)

    k: how many vertices the data tell, a third of the directions that they do.  Each
    order in which vertices can be listed is an optimum of its own as far as the data
    tell them apart.  covariance (3 V, 3 V) by the Hessian; held (3 V, 3 V): what holds
    them before the data (PRIORS), of which they lie within REACHED at least.
    """
    values, vectors = np.linalg.eigh((held + held.T) / 2)
    prior = (vectors * np.maximum(values, 1 / REACHED**2)) @ vectors.T
    lost, directions = occam_factor(covariance, prior)
    V, k = len(values) / 3, directions / 3
    return float(lost - gammaln(V + 1) + gammaln(V - k + 1))


def tangent_space_of_hull(problem, solution, R_wg) -> TangentSpace:
    """Return the vertices at the last sample, world frame, as coordinates."""
    theta, V = problem.variables["theta"], solution.values["theta"].T
    names = tuple(f"vertex {j} {w}" for j in range(len(V)) for w in "xyz")
    turn = np.kron(np.eye(len(V)), R_wg)
    middle = R_wg @ (_slope_of_centroid(V) @ turn.T)
    maps = {
        "vertices": np.eye(V.size) - np.tile(middle, (len(V), 1)),
        "position": middle,
        "rotation": np.zeros((3, V.size)),
    }
    fixed = ("rotation: the body's axes are the world's at the last sample",)
    chosen = np.arange(theta.span.start, theta.span.stop)
    return TangentSpace(names, chosen, turn, maps, fixed)


def touched_polygons(window, vertices, faces, x, sigma: float) -> np.ndarray:
    """Return the number of touches of each face of a hull at poses x (u, T).

    faces: corners and outward normal of each, as of `geometry.faces.polygons`; sigma:
    deviation of felt normals [rad].  A touch belongs to the face whose normal is
    closest to the felt one, and to others within the error of felt normals.
    """
    facing = np.cos(min(MAX_TILT, FACE_TILT + TILT_DEVIATIONS * sigma))
    touch = window.touch
    centre = fingers_in_body(touch, x)
    n = directions_in_body(x, touch.sample, touch.normal)
    point = centre - touch.radius[:, None] * n
    alike = []  # (faces, touches): cosine to a face that the point is on
    for corners, normal in faces:
        off = (point - vertices[corners[0]]) @ normal
        alike.append(np.where(np.abs(off) < FACE_REACH, n @ normal, -1.0))
    alike = np.array(alike)
    best = np.maximum(alike.max(axis=0, initial=-1.0), np.cos(MAX_TILT))
    return np.count_nonzero((alike > facing) | (alike >= best), axis=1)


def vertex_information(estimate) -> np.ndarray:
    """Return log det of the information about each vertex (V,), the others unknown.

    In nats, of lengths in metres: what colours the vertices of the paper's figures.
    """
    check_types(estimate=(estimate, "Estimate"))
    C, V = estimate.information.covariance("vertices"), len(estimate.vertices)
    blocks = np.einsum("iaib->iab", C.reshape(V, 3, V, 3))
    return -np.linalg.slogdet(blocks + LEAST_DEVIATION**2 * np.eye(3))[1]


def _slope_of_centroid(vertices) -> np.ndarray:
    """Return how the hull's centroid follows its vertices, (3, 3 V), by differences."""
    step, slopes = 1e-6, []
    for i in range(vertices.size):
        moved = vertices.copy().ravel()
        moved[i] += step
        ahead = centroid(moved.reshape(-1, 3))
        moved[i] -= 2 * step
        slopes.append((ahead - centroid(moved.reshape(-1, 3))) / (2 * step))
    return np.array(slopes).T
