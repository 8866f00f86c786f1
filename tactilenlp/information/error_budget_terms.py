r"""Compute the terms of the error budget, each a covariance (k, k) by one named error.

Each function returns K^{-1} G K^{-1} for the middle G of one error; `error_budget.py`
lists which of them apply to which class of shapes and adds them up.

    by_gradient (unknowns, k), by_constraint (rows, k): columns of K^{-1}, see
    KKTSystem.sensitivity
"""

from __future__ import annotations

import numpy as np

from formulations.names import BALL, FINGER, GROUND_GAP, RESPONSE
from formulations.violation_implicit import BALANCE_SIGMA

from ..geometry.convex_hull import SIGMA_INSIDE
from ..geometry.transforms import is_planar, matrices, points_in_body, rotate_planar
from ..nlp.kkt import LEAST_CURVATURE, KKTSystem
from .linearisation import ASSUMPTION_STEP, difference, kkt_residual
from .tangent_space import known_faces, rotations

GIVEN_FRICTION_ERROR = 0.1  # [-] relative deviation of a coefficient
UNEVEN = 1.0  # [REST] deviation of a corner from the hard ground
UNTOUCHED_FACTOR = 2.0  # [position noise] of a face that only physics determines
TUMBLED = 0.1  # [size] the same where it follows from how the object tumbled
STICKING = 0.1  # [-] probability that a finger that seems to slide sticks
MOVED_ON = 0.5  # [-] probability that a body moves on that was not seen to
AHEAD = 0.3  # [-] deviation of a way that nothing has told yet
REACHED = 0.1  # [m] a body that a finger felt is at most this far from there
ANY_ROTATION = np.pi / np.sqrt(3)  # [rad] deviation of a uniformly distributed rotation
LOADED = 0.01  # [weights] a missing sample with a smaller impulse was no contact
CORRELATION_LENGTH = 1.0  # [-] on the unit sphere, between directions to one face
VERTEX_PRIORS = ("ball prior", "stay")  # costs that determine untouched vertices
REGULARISATION = 1e-9  # [-] of the covariance of g, singular where vertices coincide


def curvature_of_costs(kkt: KKTSystem, by_gradient, names) -> np.ndarray:
    """Return the covariance (k, k) if the curvature of these terms is their error."""
    return positive_semidefinite(by_gradient.T @ (kkt.hessian(names) @ by_gradient))


def missing_impulses(kkt: KKTSystem, by_constraint) -> np.ndarray:
    """Return the covariance (k, k) if hard balances miss impulses of BALANCE_SIGMA.

    A page reports how such a constraint moves by an impulse of one weight,
    "<its name>, impulse response".
    """
    problem, total = kkt.problem, np.zeros((by_constraint.shape[1],) * 2)
    for name, term in problem.constraints.items():
        if name + RESPONSE not in problem.reports:
            continue
        n, m = term.instances, term.function.rows
        response = problem.value(name + RESPONSE, kkt.x, kkt.data).reshape(n, -1, m)
        rows = by_constraint[term.span].reshape(n, m, -1)
        change = (response @ rows).reshape(-1, len(total))
        total += BALANCE_SIGMA**2 * change.T @ change
    return total


def regularisation(kkt: KKTSystem, by_gradient) -> np.ndarray:
    """Return the covariance (k, k) of K's regularisation, a weak prior."""
    scaled = by_gradient / kkt.problem.scale[:, None]
    return LEAST_CURVATURE * scaled.T @ scaled


def friction_error(kkt: KKTSystem, by_gradient, by_constraint, name: str) -> np.ndarray:
    """Return the covariance (k, k) by a coefficient of friction that was given."""
    ends, span = [], kkt.problem.parameters[name].span
    for side in (1, -1):
        data = kkt.data.copy()
        data[span] += side * ASSUMPTION_STEP * data[span]
        ends.append(kkt_residual(kkt.problem, kkt, data))
    slope = difference(by_gradient, by_constraint, ends, ASSUMPTION_STEP)
    return GIVEN_FRICTION_ERROR**2 * np.outer(slope, slope)


def uneven_ground(kkt: KKTSystem, by_constraint, window) -> np.ndarray:
    """Return the covariance (k, k) by a ground that is not the plane of a hard gap."""
    problem = kkt.problem
    slopes = problem.jacobian(GROUND_GAP, kkt.x, kkt.data)
    slopes = slopes[:, problem.variables["x"].span]
    gaps = problem.constraints[GROUND_GAP].span
    rows = window.rigid_moves(by_constraint[gaps], slopes)
    return UNEVEN**2 * rows.T @ rows


def positive_semidefinite(M, least: float = 0.0) -> np.ndarray:
    """Return a symmetric matrix without eigenvalues below the least."""
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return (vectors * np.maximum(values, least)) @ vectors.T


def stick_slip(kkt: KKTSystem, by_gradient, window, action) -> np.ndarray:
    """Return the covariance (k, k) by fingers that may stick instead of slide, SI.

    A finger that moves along a face slides on it or moves the body.  No sensor tells
    which; a solve decides for one of them, with the curvature of a rounded |v|.  Had a
    finger f stuck in action a, the body would have moved by its slip u in that action,
    and all earlier poses would be off by -u: a change e of the poses, on which the
    Hessian H of physics acts with H e.  Hence

        K^{-1} ( sum_{a, f}  STICKING  H e e' H ) K^{-1},

    zero where touches alone determine the poses.  action (T,): of every sample.
    """
    push, slip = window.push, slips(kkt, window)
    own, moves = action[push.sample], []
    for a, f in np.unique(np.stack([own, push.finger]), axis=1).T:
        rows = np.flatnonzero((own == a) & (push.finger == f))
        moves.append((push.sample[rows], slip[rows]))
    return STICKING * error_of_motions(kkt, by_gradient, window, moves)


def unseen_motion(response) -> np.ndarray:
    """Return the covariance (k, k) by bodies that move on, or stop, unseen, SI.

    While a finger that may push is not seen, motion lasts or has ended, with MOVED_ON:
    the body may have moved by what a solve leaves out; after the last touch by let_go,
    since fingers that squeeze a body make it jump; ahead of late sensors, by AHEAD.
    """
    let_go, ahead = (np.outer(k, k) for k in response.motions[1:])
    linearisation = response.linearisation
    total, window = MOVED_ON * let_go + AHEAD**2 * ahead, linearisation.window
    if len(window.unseen):
        kkt, step = linearisation.kkt, window.step
        x = linearisation.values["x"]
        ways = (x[:, step.pose] - x[:, step.before]).T
        runs = ((step.sample[k], ways[j] - ways[k]) for k, j in window.unseen_runs)
        total += MOVED_ON * error_of_motions(kkt, response.by_gradient, window, runs)
    return total


def error_of_motions(kkt: KKTSystem, by_gradient, window, moves) -> np.ndarray:
    """Return the covariance (k, k) by moves of the body that a solve left out, SI.

    moves: of each, samples (n,) and by how much the first unknowns of the pose would
    have changed on the way to them (n, u); see `stick_slip`.
    """
    problem, x = kkt.problem, kkt.problem.variables["x"]
    H, errors = kkt.hessian(problem.costs_of("physics")), []
    for samples, ways in moves:
        later = samples > window.last[:, None]  # (poses, samples)
        off = np.zeros((x.columns, x.rows))
        off[:, : ways.shape[1]] = -(later @ ways)
        e = np.zeros(problem.size)
        e[x.span] = off.ravel()
        errors.append(by_gradient.T @ (H @ e))
    errors = np.array(errors).reshape(-1, by_gradient.shape[1])
    return errors.T @ errors


def slips(kkt: KKTSystem, window) -> np.ndarray:
    """Return how far [m] each pushing finger slid over the body.

    (pushes, 2) over the ground, in planar motion; else (pushes, 3).  Where a sample
    is missing and no impulse is found, the finger did not touch: zero.
    """
    values, push, steps = kkt.problem.unpack(kkt.x), window.push, window.step
    x = values["x"]
    now, before = (x[:, k[push.step]] for k in (steps.pose, steps.before))
    if is_planar(x):
        arm = (push.p_wf_1[:, :2] - before[:2].T).T
        moved = now[:2] + np.stack(rotate_planar(now[2] - before[2], *arm))
        slip = push.p_wf[:, :2] - moved.T
    else:
        met = points_in_body(before, slice(None), push.p_wf_1[:, :3])
        met = np.einsum("nij,nj->ni", matrices(now), met)
        slip = push.p_wf[:, :3] - now[:3].T - met
    if FINGER in values and len(window.unseen):
        lam_n = values[FINGER][0, window.unseen]
        loaded = lam_n > LOADED * kkt.problem.variables[FINGER].scale[0]
        slip[window.unseen[~loaded]] = 0.0
    return slip


def shape_prior_error(kkt: KKTSystem, by_gradient) -> np.ndarray:
    """Return the covariance (k, k) by bodies that differ from the prior's ball, SI.

    Without touches the vertices lie about a sphere (m, r) and near where they started,
    which is what a page's prior says of each vertex alone.  Bodies differ from their
    ball by SIGMA_INSIDE radii, and similarly in similar directions.  With u_j the
    direction of vertex j from m,

        v_j = start_j + r SIGMA_INSIDE g_j u_j
        cov(g_i, g_j) = exp(-|u_i - u_j|^2 / 2 L^2)

    with L = CORRELATION_LENGTH.  By such errors e of its centre, the prior's Hessian H
    moves the estimate by K^{-1} H e, zero where touches determine the vertices:

        K^{-1} H cov(e) H K^{-1}
    """
    problem, values = kkt.problem, kkt.problem.unpack(kkt.x)
    V, (*middle, radius) = values["theta"].T, np.ravel(values[BALL])
    u = V - middle
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), radius * REGULARISATION)
    apart = np.linalg.norm(u[:, None] - u[None], axis=2)
    alike = np.exp(-((apart / CORRELATION_LENGTH) ** 2) / 2)
    root = np.linalg.cholesky(alike + REGULARISATION * np.eye(len(u)))
    errors = np.zeros((problem.size, len(u)))
    errors[problem.variables["theta"].span] = (
        radius * SIGMA_INSIDE * (u[:, :, None] * root[:, None]).reshape(u.size, -1)
    )
    response = by_gradient.T @ (kkt.hessian(VERTEX_PRIORS) @ errors)
    return response @ response.T


def untouched_faces(tangent, shape, faces, noise: float, grounded: bool) -> np.ndarray:
    """Return the covariance (k, k) of faces that nothing touched, SI.

    faces (axes, 2): samples that touched each; noise [m] of finger positions; grounded:
    whether a ground carries the body.

    What physics tells of them is not Gaussian: one optimum among others, and too small
    rather than too large where finger paths are noisy.  A body without opposite faces
    has no such term.
    """
    n, k = shape.theta, len(tangent.z)
    total = np.zeros((k, k))
    if not shape.faced:
        return total
    for axis, (low, high) in enumerate(known_faces(tangent, faces, grounded)):
        if low and high:
            continue
        way = np.zeros(k)
        way[axis] = 1.0
        places = k - n - rotations(n, k)
        way[n : n + places] = (int(low) - int(high)) / 2 * tangent.R[:places, axis]
        deviation = UNTOUCHED_FACTOR * noise
        if rotations(n, k) == 3:
            deviation = np.hypot(deviation, TUMBLED * tangent.z[axis])
        total += deviation**2 * np.outer(way, way)
    return total


def beyond_mixture(
    modes, linearisation, tangent, faces, profile
) -> dict[str, np.ndarray]:
    """Return the covariances (k, k) of errors that a mixture of optima leaves out.

    faces: see information_of; profile (k, k): see profile_likelihood.py.
    """
    window, noise = linearisation.window, linearisation.job.precision.position
    grounded = len(window.corner) > 0
    untouched = untouched_faces(tangent, window.shape, faces, noise, grounded)
    errors = {"untouched faces": untouched}
    if profile is not None:
        profile = profile @ tangent.jacobian.T
        errors["profile likelihood"] = profile_beyond(profile, modes.covariance)
    return errors


def profile_beyond(profile, C) -> np.ndarray:
    """Return the covariance (k, k) that the profile likelihood (k, k) has beyond C.

    Each row adds what the rows before it have not added already.
    """
    beyond = np.zeros_like(C)
    for i, off in enumerate(profile):
        more = off[i] ** 2 - max(C[i, i], 0.0) - beyond[i, i]
        if more > 0:
            beyond += more / off[i] ** 2 * np.outer(off, off)
    return beyond


def bounded_pose(C, sizes: int) -> np.ndarray:
    """Return the covariance (k, k) given that the final position lies within REACHED.

    sizes: how many of the first of k are of the shape.  Where the data leave the pose
    open, rounding errors make the matrix indefinite: negative eigenvalues count as
    large variances.
    """
    widest = np.full(len(C) - sizes, REACHED)
    widest[-rotations(sizes, len(C)) :] = ANY_ROTATION
    rest, pose, unit = slice(sizes), slice(sizes, None), np.outer(widest, widest)
    values, vectors = np.linalg.eigh(C[pose, pose] / unit)
    share = np.abs(values) / (np.abs(values) + 1)
    inverse = (vectors / (np.abs(values) + 1)) @ vectors.T / unit  # of sum with prior
    bounded, across = C.copy(), C[rest, pose] @ inverse
    bounded[pose, pose] = (vectors * share) @ vectors.T * unit
    bounded[rest, pose] = across * widest**2
    bounded[pose, rest] = bounded[rest, pose].T
    bounded[rest, rest] -= across @ C[pose, rest]
    return bounded
