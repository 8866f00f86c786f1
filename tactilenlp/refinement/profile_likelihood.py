r"""Profile likelihood of sizes and of the final position.

The optimum of a size that no touch determines, or only by a trajectory, is often a
kink: cones and sliding are not smooth, and from there the objective grows as the
distance, not as its square.  It looks sharp to a Hessian and is not.  So the page is
solved again with the size s held elsewhere, all else free, farther each time until the
objective has risen by PROFILE_RISE,

    sigma = |s - s_0| / sqrt(2 (L(s) - L(s_0))),

as of a Gaussian with the same likelihood ratio; the other sizes and the final pose
change as they do in that solve.  Where L is lower than at s_0, a better optimum is
near.  Where L levels off, sigma is the root of the second moment of exp(-L), if larger.
It is at most

    deviation sqrt((3 + n + |z|^2) / n),

the standard deviation of the prior of a size where the n - 1 others are z deviations
from their means: Student's t of 2 + n degrees of freedom (size_prior.py).  How far the
steps go, and what their rises mean, stands in profile_deviation.py.

A final pose that a body slid and turned to is determined by cones and sliding as well.
Of its coordinates the one along the ground that is known least is held elsewhere, in
both directions; both are where friction alone tells them: after a side was last felt, a
finger dragged the body from above, or it went on by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np

from formulations.size_prior import size_cost

from ..data.contact_segments import felt_sides
from ..geometry.faces import KNOWN_FACE
from ..geometry.transforms import is_planar, rotation_matrix
from ..information.tangent_space import VERTICAL, final_unknowns, prior_deviations
from ..local.levels import RANKING_TOLERANCE
from ..local.margins import PROFILE_RISE
from ..local.solved import Solved, settings_of
from ..problem.hypothesis import Hypothesis, resized
from ..solvers.solve import solve_levels
from .profile_deviation import VAGUE_SHARE, Point, Profile

FACES_DISTANCE = 0.3e-3  # [m] sigma of the distance of two touched faces
NOISE_FACTOR = 2.0  # [-] of the sigma of their means, for noisy fingers
KNOWN_POSITION = 1e-3  # [m] a larger sigma of a position needs no profile
HEIGHT = 2  # the axis of a box that is vertical where it lies as it was told
ANY_YAW = np.pi / 2 / np.sqrt(12)  # [rad] deviation of a uniform yaw of a box
# IPOPT's mu_init where a size is held elsewhere, with the optimum's multipliers: 73
# iterations in 27 solves, up to 0.6 nats above the best (105 from 1e-1 without them)
PROFILE_MU = 1e-2
PROFILE_ITERATIONS = 300  # of one such solve: a height on a plateau took 222


def profile_deviations(solved, seeks=True) -> tuple[np.ndarray, Solved | None]:
    """Return the deviations (k, k) of sizes and final pose by profile likelihood.

    Row i: a deviation of a size that no touch determines, or of a position [m], and
    what sizes [m] and the unknowns of the last pose do then; 0 where there is no
    profile.  The second result is a solve, with one of them held, that is better than
    the given one, at which the profiles end, or None; unless it seeks one, a lower
    objective counts as none higher.
    """
    shape, end = solved.job.shape, solved.at.end
    n, deviations = shape.theta, np.zeros((len(end), len(end)))
    faces = touched_ends(shape, solved)
    if faces is None:
        return deviations, None
    chosen = final_unknowns(solved.problem)
    by_gradient, _ = solved.kkt.sensitivity(chosen)
    variance = np.diag(by_gradient[chosen])
    # Not positive where the Hessian is indefinite: it tells nothing, `sigma` is inf.
    sigma = np.sqrt(np.where(variance > 0, variance, np.inf))
    along, large = [n + int(np.argmax(sigma[n : n + 2]))], KNOWN_POSITION
    carried = way_since_sides(solved)
    widest = max(shape.typical_deviation, carried)
    if carried > KNOWN_POSITION:
        along, large = [n, n + 1], VAGUE_SHARE * widest
    profiles = _profiles(solved, faces, sigma, seeks)
    for axis in along:
        if sigma[axis] < large:
            profiles.append(Profile(solved, axis, widest, None, seeks))
        else:  # the Hessian already states a large sigma
            deviations[axis] = by_gradient[chosen, axis] / sigma[axis]
    for profile in profiles:
        axis = profile.axis
        way = by_gradient[:, axis] / variance[axis] * min(sigma[axis], profile.prior)
        solve_held = partial(_solve_held, solved, chosen[axis], axis)
        deviations[axis], better = profile.deviation(solve_held, way, way[chosen])
        if better is not None:
            return deviations, better
    return deviations, None


def _profiles(solved, faces, sigma, seeks) -> list[Profile]:
    """Return the profiles of sizes and of a yaw that the Hessian may not tell.

    Of open and of noisy sizes, and of the yaw of a box that no side was felt of.
    """
    job, shape, at, profiles = solved.job, solved.job.shape, solved.at, []
    for axis, touched in enumerate(faces):
        is_open = touched.min() < KNOWN_FACE
        if is_open or sigma[axis] >= faces_sigma(job, touched):
            widest = prior_deviations(shape, at.theta)[axis]
            cost = prior_cost(shape, at, axis) if is_open else None
            profiles.append(Profile(solved, axis, widest, touched, seeks, cost))
    if shape.faced and is_planar(at.x) and faces[:2].max() < KNOWN_FACE:
        yaw = shape.theta + 2
        profiles.append(Profile(solved, yaw, ANY_YAW, None, False, np.zeros_like))
    return profiles


def way_since_sides(solved) -> float:
    """Return how far the body moved [m] after a side of it was last felt.

    In planar motion: of a body that tips or floats, touches of all faces tell where.
    """
    data, at = solved.job.data, solved.at
    if not is_planar(at.x):
        return 0.0
    last = np.flatnonzero(felt_sides(data).any(axis=1))
    since = last[-1] if len(last) else 0
    return float(np.linalg.norm(at.x[:2, -1] - at.x[:2, since]))


def touched_ends(shape, solved) -> np.ndarray | None:
    """Return how many samples touched the faces (sizes, 2) that each size is between.

    None where the last pose is held, or another face is up.  What bounds the sizes of
    classes without opposite faces is not known: no samples.
    """
    if shape.of_vertices:
        return None
    if not shape.faced:
        return np.zeros((shape.theta, 2), int)
    if rotation_matrix(solved.at.x[:, -1])[2, 2] < VERTICAL:
        return None
    faces = solved.touched
    faces[2, 0] += KNOWN_FACE * (solved.job.scene.ground is not None)
    return faces


def untouched_height_sigma(solved) -> float | None:
    """Return the sigma [m] of the height of a box whose top no finger felt, or None.

    By its profile or the Hessian, the larger one.  solved: with profiles.
    """
    shape, faces = solved.job.shape, touched_ends(solved.job.shape, solved)
    if faces is None or not shape.faced or faces[HEIGHT].min() >= KNOWN_FACE:
        return None
    chosen = final_unknowns(solved.problem)[HEIGHT : HEIGHT + 1]
    variance = solved.kkt.marginal(chosen)[0, 0]
    by_hessian = np.sqrt(variance) if variance > 0 else np.inf
    return float(max(by_hessian, abs(solved.profile[HEIGHT, HEIGHT])))


def faces_sigma(job, touched) -> float:
    """Return the sigma [m] of the distance of two faces (2,) by samples on each."""
    return max(
        FACES_DISTANCE,
        NOISE_FACTOR * job.precision.position * np.sqrt(np.sum(1 / touched)),
    )


def prior_cost(shape, at: Hypothesis, axis: int) -> Callable:
    """Return what changes (n,) [m] of one size add to the cost of the prior [nats]."""
    change, theta = ca.SX.sym("change"), ca.DM(at.theta)
    way = change * ca.DM(np.arange(shape.theta) == axis)
    cost = size_cost(shape, theta + way) - size_cost(shape, theta)
    added = ca.Function("prior", [change], [cost])
    return lambda changes: added(ca.DM(np.atleast_1d(changes)).T).full().ravel()


def _solve_held(
    solved, held: int, axis: int, step: float, start: Point, direction, touched
) -> Point | None:
    """Return the Point at which one chosen unknown is a step [m] off, or None.

    See Profile.deviation.  The start moves along the direction, or only the size does,
    where samples touched a face.  A feasible solve with a small rise is enough.  Poses
    that the page computes are unknowns here, else none is held.
    """
    problem, job, latest = solved.problem, solved.job, start.solved
    x = problem.pack(latest.solution.values) + (step - start.step) * direction
    least_sizes = np.broadcast_to(job.shape.bounds[0], job.shape.theta)
    too_small = axis < len(least_sizes) and x[held] < least_sizes[axis]
    if too_small or job.deadline.passed("profile likelihoods"):
        return None
    if touched is None:
        values = problem.unpack(x)
    else:
        changed = resized(latest.at, axis, x[held], touched)
        values = latest.solution.values | solved.built.values_at(changed)
    level = replace(
        job.page.LEVELS[-1].with_ipopt(max_iter=PROFILE_ITERATIONS),
        fixed=(np.array([held]),), eliminate=False, warm_start={"mu_init": PROFILE_MU},
    )  # fmt: skip
    guess = replace(latest.solution, values=values)
    settings = replace(settings_of(job), tolerance=RANKING_TOLERANCE)
    again = solve_levels(problem, (level,), guess, settings, solved.built.solvers)
    rise = again.objective - solved.solution.objective
    feasible = max(again.violations.values(), default=0.0) <= RANKING_TOLERANCE
    if feasible and (again.success or rise < PROFILE_RISE):
        return Point(step, rise, replace(solved, solution=again))
    return None
