r"""Compute standard deviations of the pose at every sample.

At sample t the variance of the pose adds up

    w_0 C_t, the error budget of p_t and R_t (error_budget.py), past and future
    marginalised, with the weight of the best of the local optima (mixture.py),
    sum_m w_m d_{m,t}^2, how far the poses of the other optima are,
    what shape and final pose have besides (the covariances of other optima, untouched
    faces, profile likelihood), moved back with the rigid body: it holds in the body's
    frame.

    in planar motion, how the ground may lean, and the body on it (errors_of_ground),
    and how far fingers may have tipped it (errors_of_tipping).

A solve of the KKT system is needed for every pose.  POSES of them are computed, and
where a body is let go and felt again, between which its variance jumps; the variance is
linear between.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from formulations.ground_contact import REST
from formulations.names import GROUND
from formulations.rigid_body import ARM, LEAST_ARM

from ..geometry.transforms import is_planar, matrices
from ..problem.fingertips import touch_scales
from .error_budget import errors_by_name, summed
from .error_budget_terms import ANY_ROTATION, REACHED, UNEVEN
from .linearisation import Linearisation
from .mixture import relabelling, turn_between
from .tangent_space import pose_jacobians

LEAST_WAY, ICE = 1e-6, 0.1  # [m] rounding; [m/s^2] that brakes a body on ice
LIES = 2 * np.sin(np.pi / 8)  # [-] 45 deg: a body that leans more falls farther over
# [half widths] of the centre of pressure, from which on a body may tip: where eight of
# 180 boxes began to, it was 0.93 and more
ON_EDGE = 0.9
UP = np.array([0.0, 0.0, 1.0])
POSES = 40  # of a trajectory whose covariance is computed at least


def trajectory_variance(linearisation: Linearisation, middle, of_end=None, optima=()):
    """Return the variances (T, 6) of position [m^2] and rotation [rad^2], world frame.

    middle: the point of the body whose position is meant (3,), body frame, and how it
    moves with the unknowns of the shape (3, n).  of_end: errors of the final pose
    besides its error budget, if there are any: their covariance (k, k), and the maps
    (6, k) to position and rotation; optima: weight and LocalOptimum of others.
    """
    window, values = linearisation.window, linearisation.values
    tilt, R_wg = linearisation.tilt, linearisation.R_wg
    poses = _computed_poses(linearisation)
    theta, x = values["theta"].T.ravel(), values["x"][:, poses]
    p, R, J_p, J_R = pose_jacobians(window.shape, window.motion, theta, x)
    p, J_p = _of_point(p, R, J_p, J_R, *middle)
    problem = linearisation.kkt.problem
    jacobian, chosen = _stacked(problem, poses, R_wg @ J_p, R_wg @ J_R)
    free, by_ground = window.motion.name == "free", 0.0
    moving = np.flatnonzero(np.abs(jacobian).max(axis=1) > 0)
    variance = np.zeros(6 * len(poses))
    if free and tilt is not None:
        by_ground = linearisation.slopes_by_tilt(p).reshape(-1, 2)[moving]
    response = linearisation.response(chosen, jacobian[moving], by_ground)
    budget = summed(errors_by_name(response))
    variance[moving] = (1.0 - sum(weight for weight, _ in optima)) * np.diag(budget)
    variance = variance.reshape(-1, 6)
    if not free and tilt is not None:
        variance += np.diagonal(errors_of_ground(linearisation, p), axis1=1, axis2=2)
    if of_end is not None:
        variance += _back_from_end(*of_end, R, R_wg)
    for weight, optimum in optima:
        apart = _apart(optimum, window.last[poses], (p, R), R_wg)
        variance += weight * apart**2
    most = np.repeat([REACHED**2, ANY_ROTATION**2], 3)
    variance = np.clip(variance, 0.0, most)
    variance = np.array([np.interp(window.pose, poses, v) for v in variance.T]).T
    tipped = np.diagonal(errors_of_tipping(linearisation), axis1=1, axis2=2)
    return variance + tipped[window.pose]


def _computed_poses(linearisation: Linearisation) -> np.ndarray:
    """Return the poses whose covariance is computed."""
    window, x = linearisation.window, linearisation.kkt.problem.variables["x"]
    let_go = linearisation.motions[x.span, 1].reshape(x.columns, x.rows)
    jumps = np.flatnonzero(np.diff(let_go, axis=0).any(axis=1))
    even = np.linspace(0, window.poses - 1, POSES).round().astype(int)
    return np.unique(np.concatenate([even, jumps, jumps + 1]))


def deviations_of_path(
    linearisation: Linearisation, tangent, modes, optima, beyond
) -> np.ndarray:
    """Return the deviations (T, 6) of the pose at every sample.

    modes: of optima; beyond (k, k): what the final pose has besides their mixture.
    """
    pairs = zip(modes.weights[1:], optima[1:], strict=True)
    others = [(weight, optimum) for weight, optimum in pairs if weight]
    more = beyond + np.einsum("m,mij->ij", modes.weights[1:], modes.covariances[1:])
    maps = np.concatenate([tangent.maps["position"], tangent.maps["rotation"]])
    middle = np.zeros(3), np.zeros((3, linearisation.window.shape.theta))
    variance = trajectory_variance(linearisation, middle, (more, maps), others)
    if linearisation.tilt is None or linearisation.window.motion.name == "free":
        variance[:, 3:][:, np.isnan(tangent.maps["rotation"]).any(axis=1)] = np.nan
    return np.sqrt(variance)


def response_to_ground(linearisation: Linearisation, tangent) -> tuple:
    """Return how the coordinates z (k, 2) turn with the ground, and Information.ground.

    In planar motion z is in the ground's frame: there the latter adds what turns.
    """
    window, known = linearisation.window, linearisation.tilt is None
    p, free = linearisation.end[None], window.motion.name == "free"
    if not (free or window.shape.of_vertices):
        ground = errors_of_tipping(linearisation)[-1]
        ground += 0.0 if known else errors_of_ground(linearisation, p)[0]
        return 0.0, ground if ground.any() else None
    if known:
        return 0.0, None
    if window.shape.of_vertices:
        vertices = linearisation.slopes_by_tilt(linearisation.vertices)
        return vertices[:, :3].reshape(-1, 2), None
    pose = linearisation.slopes_by_tilt(p)[0]
    return np.vstack([np.zeros((len(tangent.z) - 6, 2)), pose]), None


def errors_of_ground(linearisation: Linearisation, points) -> np.ndarray:
    """Return covariances (n, 6, 6) of poses in planar motion, world frame.

    By the tilt of the ground's frame, and by corners that stand UNEVEN off its plane.
    points (n, 3) [m]: where the poses are, ground frame.
    """
    poses, R_wg = linearisation.slopes_by_tilt(points), linearisation.R_wg
    C = poses @ linearisation.tilt.squared @ poses.swapaxes(1, 2)
    legs = linearisation.window.supports(linearisation.values["theta"].T.ravel())
    arm = np.maximum(np.sum(legs[:, :2] ** 2) / 2, LEAST_ARM**2)
    rocks = (UNEVEN * REST) ** 2 / arm * R_wg[:, :2] @ R_wg[:, :2].T
    C[:, 3:, 3:] += rocks
    return C


def errors_of_tipping(linearisation) -> np.ndarray:
    """Return covariances (poses, 6, 6) of poses in planar motion, world frame.

    Where the ground carries a body on one edge, a finger may have tipped it about that
    edge, and noise can hide it: until it is let go, by a share s of how far the finger
    moved since over its height, up to where the body falls.  Before the data s has a
    mean square of a third; on a box the normals of touches below the top lean with it.
    """
    window, values = linearisation.window, linearisation.values
    C, number = np.zeros((window.poses, 6, 6)), len(window.step)
    carried = GROUND in values and len(window.corner)
    if window.motion.name == "free" or not carried:
        return C
    loads, theta = values[GROUND][0].reshape(number, -1), values["theta"].T.ravel()
    corners = window.supports(theta)[: loads.shape[1]]
    half = np.maximum(np.abs(corners[:, :2]).max(axis=0), LEAST_ARM)
    total = np.maximum(loads.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    pressure = loads @ corners[:, :2] / total / half
    action = linearisation.job.data.action[window.step.sample]
    first = np.flatnonzero(np.diff(action, prepend=-1))
    for steps in np.split(np.arange(number), first[1:]):
        on_edge = np.abs(pressure[steps]).max(axis=1) > ON_EDGE
        if on_edge.any():
            begin = steps[int(np.argmax(on_edge))]
            axis = int(np.argmax(np.abs(pressure[begin])))
            over = np.sign(pressure[begin, axis]) * np.eye(3)[axis], half[axis]
            _add_tip(C, linearisation, steps[steps >= begin], over, -corners[0, 2])
    return C


def _add_tip(C, linearisation, steps, over, height: float) -> None:
    """Add to covariances C that a body may tip over an edge in some steps of an action.

    over: where the edge is from the body's middle, body frame, and how far [m]; height
    [m]: of the middle.
    """
    window, (side, half), R_wg = linearisation.window, over, linearisation.R_wg
    push = window.push.pick(np.setdiff1d(np.arange(len(window.push)), window.unfelt))
    way = np.linalg.norm((push.p_wf - push.p_wf_1)[:, :3], axis=1)
    turn = way / np.maximum(push.p_wf[:, 2], push.radius)
    kkt = linearisation.kkt
    _, sigma = touch_scales(kkt.problem, kkt.data) or (np.inf, np.inf)
    tip, told, off, moved = 0.0, 3.0, 0.0, []
    for k in steps:
        now = push.step == k
        if not now.any():
            break  # it was let go
        pose, sample = window.step.pose[k], window.step.sample[k]
        tip = min(tip + turn[now].max(), np.arctan2(half, height))
        g = Rotation.from_euler("z", linearisation.values["x"][-1, pose]).apply(side)
        rise = half * UP + (height - push.p_wf[now, 2].max()) * g
        moved.append((pose, tip * np.r_[R_wg @ rise, R_wg @ np.cross(UP, g)]))
        touch = window.touch.pick(window.touch.sample == sample)
        side_felt = window.shape.faced & (touch.p_wf[:, 2] < 2 * height)
        leans = -tip * (touch.normal @ g) * side_felt
        told += np.sum(leans**2) / sigma**2
        off += leans @ touch.normal[:, 2] / sigma**2
    for pose, d in moved:
        C[pose] += ((off / told) ** 2 + 1 / told) * np.outer(d, d)


def _of_point(p, R, J_p, J_R, middle, slope):
    """Return positions (s, 3) and Jacobians (s, 3, k) of a point of the body."""
    arm = R @ middle
    J_p = J_p - np.cross(arm[:, None], J_R.swapaxes(1, 2)).swapaxes(1, 2)
    J_p[:, :, : slope.shape[1]] += R @ slope
    return p + arm, J_p


def _stacked(problem, poses, position, rotation):
    """Return the Jacobian (6 s, k) of all poses, and the unknowns (k,) it is by."""
    theta, x = problem.variables["theta"].span, problem.variables["x"]
    n, u = theta.stop - theta.start, x.rows
    columns = x.span.start + poses[:, None] * u + np.arange(u)
    chosen = np.r_[theta.start : theta.stop, columns.ravel()]
    by_theta, by_pose = np.split(np.hstack([position, rotation]), [n], axis=2)
    return np.hstack([by_theta.reshape(-1, n), block_diag(*by_pose)]), chosen


def _back_from_end(covariance, maps, R, R_wg) -> np.ndarray:
    """Return variances (s, 6) of final errors that hold in the body's frame."""
    turn = R_wg @ R @ R[-1].T @ R_wg.T  # from the final orientation, world frame
    halves = np.split(np.nan_to_num(maps), 2)
    J = np.concatenate([turn @ half for half in halves], axis=1)
    return np.einsum("sik,kl,sil->si", J, covariance, J)


def _apart(optimum, samples, reference, R_wg) -> np.ndarray:
    """Return by how much (s, 6) another optimum is off at samples (s,), world frame.

    reference: positions (s, 3) and rotations (s, 3, 3).  The body's axes are relabelled
    so that the last rotation is the nearest.
    """
    values, window = optimum.solution.values, optimum.window
    shape = window.shape
    theta, x = values["theta"].T.ravel(), values["x"][:, window.pose[samples]]
    p, R, *_ = pose_jacobians(shape, window.motion, theta, x)
    p_0, R_0 = reference
    _, S = relabelling(shape, R[-1], R_0[-1])
    return np.hstack([(p - p_0) @ R_wg.T, turn_between(shape, R @ S, R_0) @ R_wg.T])


def moved_between(x, window) -> tuple[np.ndarray, np.ndarray]:
    """Return ways (n,) [m] between actions, and how far the body would move on.

    By another step as the last one, until friction stops it, or until a tilted body
    lies; x (unknowns, poses) of a planar or free path in a window.
    """
    gap = window.gap
    last = _ways(x, gap.before, gap.before_2)
    slid = (last / gap.dt) ** 2 / (2 * max(window.braking, ICE))
    on = np.maximum.reduce([last, slid, _falls(x, gap)])
    return np.maximum(_ways(x, gap.pose, gap.before), LEAST_WAY), on


def _falls(x, gap) -> np.ndarray:
    """Return how far (n,) [m] the centre moves where a tilted body falls flat.

    By the change of its tilt times its height; a body that turns by more than LIES
    between actions did not stand tilted.
    """
    if is_planar(x):
        return np.zeros(len(gap))
    upright = matrices(x)[:, 2]  # the vertical in the body's axes
    turn = np.linalg.norm(upright[gap.pose] - upright[gap.before], axis=1)
    return x[2, gap.before] * turn * (turn < LIES)


def moved_farther(x, window, least: float) -> bool:
    """Tell whether a body moved between two actions by more [m] than it moves on."""
    way, on = moved_between(x, window)
    return bool((way > least + on).any())


def _ways(x, to, before) -> np.ndarray:
    """Return the ways (n,) [m] between poses of x (3 or 6, poses), as of the page."""
    if is_planar(x):
        x = np.vstack([x[:2], np.zeros((3, x.shape[1])), x[2]])
    R, off = matrices(x), x[:3, to] - x[:3, before]
    turn = ((R[to] - R[before]) ** 2).sum(axis=(1, 2)) / 2
    return np.sqrt((off**2).sum(axis=0) + ARM**2 * turn)
