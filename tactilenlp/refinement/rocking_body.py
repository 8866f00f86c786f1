r"""Model selection between planar and free motion of a body that rocks.

A planar optimum is close where a body tilts little.  Where touches still cost too much
from there, the page is solved again, through its rough levels, from the tilts u (2,)
[rad] about the horizontal axes that the felt normals tell:

    min   sum_touches  |n(u) - n_m|^2 / (2 sigma^2)
        + sum_steps    |u_k - u_{k-1}|^2 / (2 TILT_CHANGE^2)      over u_k

with sizes, place and yaw held, u = 0 as an action begins, and all residuals rounded to
absolute values, as touches may be wrong.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix, eye, kron, vstack
from scipy.spatial.transform import Rotation

from formulations.quasi_static import NORMAL
from formulations.rigid_body import rotation

from ..certificates.outliers import with_ideal_fingertips
from ..geometry.tipping import planar_to_free
from ..geometry.transforms import rotvecs
from ..local.levels import held_briefly
from ..local.local_solve import freed_to_tilt, solved_from
from ..local.solved import Solved, best_first
from ..problem.hypothesis import Hypothesis
from ..problem.poses import body_corners
from .nested_models import fix_needless, gain_of, misfit_of, needed_gain

log = logging.getLogger("tactilenlp")
TILT_CHANGE = 0.05  # [rad] deviation of the change of tilt in a sample: 1.5 rad/s
AS_IT_BEGINS = 1e-3  # [TILT_CHANGE] deviation of the tilt as an action begins


def solve_tilted(best: Solved) -> Solved:
    """Return the page in free motion where evidence favours it, or the flat solve."""
    job = best.job
    if not (job.fixes("planar") and best.solution.success):
        return best
    touches = misfit_of(best)
    needed = needed_gain(touches.spread)
    if touches.excess < needed or job.deadline.passed("tilt"):
        return best
    free = job.with_reductions(planar=False)
    tilted = freed_to_tilt(free, best)
    guess_levels = job.contract.rough
    if guess_levels and not explains_touches(tilted):
        levels = [held_briefly(guess_levels[0]), *guess_levels[1:]]
        again = solved_from(free, tilted_by_normals(best), levels=levels)
        tilted = best_first([tilted, again])[0]
    gain = gain_of(best, tilted)
    if gain < needed:
        return best
    log.info("the body rocks: the objective falls by %.1f nats", gain)
    return fix_needless(replace(tilted, declined=best.declined))


def explains_touches(solved: Solved) -> bool:
    """Tell whether touches cost no more than in a good fit.

    A solve from the rough levels takes seconds, and no tilt explains noise.
    """
    touches = misfit_of(solved)
    return solved.solution.success and touches.excess <= touches.limit


def tilted_by_normals(flat: Solved) -> Hypothesis:
    """Return a planar optimum in free motion, tilted as the felt normals tell.

    Its lowest corner stays on the ground.  A polytope is returned unchanged.
    """
    shape = flat.job.shape
    if shape.of_vertices:
        return flat.at
    theta, window = flat.at.theta, with_ideal_fingertips(flat)
    x = planar_to_free(theta, flat.solution.values["x"], shape)
    tilt = felt_tilts(shape, theta, x, window)
    turns = Rotation.from_rotvec(np.vstack([tilt, 0 * tilt[:1]]).T)
    turns = turns * Rotation.from_rotvec(x[3:].T)
    corners = turns.as_matrix() @ body_corners(shape, theta).T
    x[2] = -corners[:, 2].min(axis=1)
    x[3:] = rotvecs(turns.as_matrix()).T
    return replace(flat.at, x=x[:, window.pose])


def felt_tilts(shape, theta, x, window) -> np.ndarray:
    """Return the tilts (2, poses) [rad] of planar poses x, as free ones (6, poses)."""
    touch, step, poses = window.touch, window.step, window.poses
    sigma, rests = np.hypot(NORMAL, window.sigma_normal), np.r_[0, window.gap.pose]
    normals, slopes = normals_and_slopes(shape, window.finger, touch.p_wf.shape)
    arguments = np.repeat(theta[:, None], len(touch), 1), x[:, touch.pose]
    fingers = touch.p_wf.T, touch.radius[None]
    kept = eye(poses, format="csr")
    changes = vstack([kept[step.pose] - kept[step.before], kept[rests] / AS_IT_BEGINS])
    change = kron(eye(2), changes / TILT_CHANGE, format="csr")
    k, axis = np.indices((len(touch), 2)).reshape(2, -1)
    rows, columns = 3 * k + np.arange(3)[:, None], axis * poses + touch.pose[k]
    columns = np.broadcast_to(columns, rows.shape)

    def residuals(u):
        at = u.reshape(2, poses)[:, touch.pose]
        off = np.asarray(normals(*arguments, at, *fingers)) - touch.normal.T
        return np.r_[change @ u, off.T.ravel() / sigma]

    def jacobian(u):
        at = u.reshape(2, poses)[:, touch.pose]
        each = np.asarray(slopes(*arguments, at, *fingers)) / sigma
        places = (each.ravel(), (rows.ravel(), columns.ravel()))
        return vstack([change, csr_matrix(places, (3 * len(touch), 2 * poses))])

    # Unscaled, the rows of tilts as actions begin take 1800 steps instead of 11.
    fit = least_squares(
        residuals, np.zeros(2 * poses), jacobian, loss="soft_l1", x_scale="jac"
    )
    return fit.x.reshape(2, poses)


def normals_and_slopes(shape, finger, of) -> tuple:
    """Return functions of the normals (3, touches) of tilted poses, and their slopes.

    theta, flat pose x (6,), tilt (2,), finger and radius -> normal, slopes (3, 2).
    of: touches, numbers of a finger's pose.
    """
    touches, size = of
    theta, x, u = ca.SX.sym("theta", shape.theta), ca.SX.sym("x", 6), ca.SX.sym("u", 2)
    p_wf, rho = ca.SX.sym("p_wf", size), ca.SX.sym("rho")
    pose = x[:3], rotation(ca.vertcat(u, 0)) @ rotation(x[3:])
    n = finger.normal(shape, theta, pose, p_wf, rho)
    arguments = [theta, x, u, p_wf, rho]
    return tuple(
        ca.Function("normals", arguments, [ca.densify(value)]).map(touches)
        for value in (n, ca.jacobian(n, u))
    )
