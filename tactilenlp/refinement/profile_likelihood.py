r"""Profile likelihood of sizes and of the final position.

The optimum of a size that no touch determines, or only by way of a path, is often a
kink: cones and sliding are not smooth, and from there the objective grows as the
distance, not as its square.  It looks sharp to a Hessian and is not.  So the page is
solved again with the size s held elsewhere, all else free, farther each time until the
objective has risen by PROFILE_RISE,

    sigma = |s - s_0| / sqrt(2 (L(s) - L(s_0))),

as of a Gaussian with the same likelihood ratio; the other sizes and the final pose
change as they do in that solve.  Where L is lower than at s_0, a better optimum is
near.  Where L levels off, sigma is the root of the second moment of exp(-L), if larger.
It is at most

    sigma sqrt(1 + |z|^2 / (3 + n)),

the deviation of the Gaussian that the prior is at n sizes z from its mean: the weight
of Student's t in least squares (size_prior.py).

A final pose that a body slid and turned to is determined by cones and sliding as well.
Of its coordinates the one along the ground that is known least is held elsewhere, in
both directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np

from formulations.sensing import FREEDOM
from formulations.size_prior import size_cost

from ..geometry.transforms import is_planar
from ..information.error_budget_terms import VERTICAL
from ..information.information import LEAST_SIGMA
from ..information.measurement_noise import KNOWN_FACE
from ..information.tangent_space import final_unknowns
from ..nlp.kkt import kkt_system_of
from ..search.hypothesis import Hypothesis, resized, rotation_at
from ..search.local_solve import RANKING_TOLERANCE, settings_of, start_values
from ..search.margins import BETTER_OPTIMUM, ONE_SIGMA, PROFILE_RISE
from ..solvers.solve import solve_levels

FACES_DISTANCE = 0.3e-3  # [m] sigma of the distance of two touched faces
NOISE_FACTOR = 2.0  # [-] of the sigma of their means, for noisy fingers
VAGUE_SHARE = 0.3  # [prior deviations] a larger sigma of a size needs no profile
KNOWN_POSITION = 1e-3  # [m] a larger sigma of a position needs no profile
FIRST_STEP = 0.5e-3  # [m] at least
MAX_STEP_GROWTH = 10.0  # [-] from step to step
# [-] at least, once a straight line would have ended: else 30 more solves on a plateau
PLATEAU_GROWTH = 1.5
ANY_YAW = np.pi / 2 / np.sqrt(12)  # [rad] deviation of a uniform yaw of a box
ENDED = 0.99  # [-] of the rise, or of the prior's deviation, at which a profile ends
POSTERIOR_NODES = 1000  # of the integral over a narrow optimum and a wide plateau
# IPOPT's mu_init where a size is held elsewhere, with the optimum's multipliers: 73
# iterations in 27 solves, up to 0.6 nats above the best (105 from 1e-1 without them)
PROFILE_MU = 1e-2
PROFILE_ITERATIONS = 300  # of one such solve: a height on a plateau took 222


def profiled(job, solved, seeks=True) -> tuple[np.ndarray, Hypothesis | None]:
    """Return the deviations (k, k) of sizes and final pose by profile likelihood.

    Row i: a deviation of a size that no touch determines, or of a position [m], and
    what sizes [m] and the unknowns of the last pose do then; 0 where there is no
    profile. And a hypothesis that is better than the solved one, at which the profiles
    end, or None; unless it seeks one, a lower objective counts as none higher.
    """
    n, end = job.shape.theta, solved.at.end
    profile = np.zeros((len(end), len(end)))
    faces = touched_ends(job.shape, solved)
    if faces is None:
        return profile, None
    chosen = final_unknowns(solved.problem)
    by_gradient, _ = kkt_system_of(solved.problem, solved.solution).sensitivity(chosen)
    variance = np.diag(by_gradient[chosen])
    # Not positive where the Hessian is indefinite: it tells nothing, `known` is inf.
    known = np.sqrt(np.where(variance > 0, variance, np.inf))
    least = n + int(np.argmax(known[n : n + 2]))
    if known[least] >= KNOWN_POSITION:  # the Hessian already states a large sigma
        profile[least] = by_gradient[chosen, least] / known[least]
    elsewhere = partial(_constrained, job, solved, {}, chosen)
    for axis, widest, *how in _asked(job, solved, faces, known, least, seeks):
        way = by_gradient[:, axis] / variance[axis] * min(known[axis], widest)
        given = solved.at, widest, axis, way, way[chosen], *how
        profile[axis], better = deviation_along(elsewhere, *given)
        if better is not None:
            return profile, better
    return profile, None


def _asked(job, solved, faces, known, least, seeks) -> list[tuple]:
    """Return what is profiled, each with the arguments of `deviation_along`.

    Axis, prior, touched, seeks and cost: of open and of noisy sizes, of the position
    `least`, if the Hessian claims it, and of the yaw of a box that no side was felt of.
    """
    shape, at, found = job.shape, solved.at, []
    for axis, touched in enumerate(faces):
        is_open = touched.min() < KNOWN_FACE
        if is_open or known[axis] >= faces_sigma(job, touched):
            widest = prior_deviations(shape, at.theta)[axis]
            cost = prior_cost(shape, at, axis) if is_open else None
            found.append((axis, widest, touched, seeks, cost))
    if known[least] < KNOWN_POSITION:
        found.append((least, shape.typical_deviation, None, seeks, None))
    if shape.is_box and is_planar(at.x) and faces[:2].max() < KNOWN_FACE:
        found.append((shape.theta + 2, ANY_YAW, None, False, np.zeros_like))
    return found


def touched_ends(shape, solved) -> np.ndarray | None:
    """Return how many samples touched the faces (sizes, 2) that each size is between.

    None where theta is no sizes, or another face of a box is up.  What bounds the sizes
    of other classes is not known: no samples.
    """
    if shape.parameters != "sizes":
        return None
    if not shape.is_box:
        return np.zeros((shape.theta, 2), int)
    if not shape.symmetries or rotation_at(solved.at, -1)[2, 2] < VERTICAL:
        return None
    faces = solved.touched
    faces[2, 0] += KNOWN_FACE * (solved.job.scene.ground is not None)
    return faces


def faces_sigma(job, touched) -> float:
    """Return the sigma [m] of the distance of two faces (2,) by samples on each."""
    return max(
        FACES_DISTANCE,
        NOISE_FACTOR * job.precision.position * np.sqrt(np.sum(1 / touched)),
    )


def prior_deviations(shape, theta) -> np.ndarray:
    """Return the deviations (n,) of the prior at sizes theta (n,), as of a Gaussian."""
    mean, deviation = (np.broadcast_to(v, shape.theta) for v in shape.size_prior)
    square = np.sum(((theta - mean) / deviation) ** 2)
    return deviation * np.sqrt(1 + square / (FREEDOM + shape.theta))


def prior_cost(shape, at: Hypothesis, axis: int) -> Callable:
    """Return what changes (n,) [m] of one size add to the cost of the prior [nats]."""
    change, theta = ca.SX.sym("change"), ca.DM(at.theta)
    way = change * ca.DM(np.arange(shape.theta) == axis)
    cost = size_cost(shape, theta + way) - size_cost(shape, theta)
    added = ca.Function("prior", [change], [cost])
    return lambda changes: added(ca.DM(np.atleast_1d(changes)).T).full().ravel()


def deviation_along(
    elsewhere, at, prior, axis, direction, off, touched, seeks=True, cost=None
):
    """Return by how much sizes and final pose are off (k,) where one of them is.

    elsewhere(axis, direction, touched, step): the hypothesis `at` with that one held
    `step` off, or None. prior [m]: the most that it may be off; direction, off: what
    all unknowns, and sizes and final pose (k,), do by the Hessian where it is off by a
    deviation, SI; touched (2,): samples on both faces of a size, None of a pose; seeks:
    whether a lower objective ends the profile; cost(change [m]) of a size that a touch
    leaves open: what the prior adds [nats]. The Hessian's deviation is kept where it is
    large, where there is no profile, and of an untouched size or a pose where it is the
    larger one. And a better hypothesis, or None.
    A larger body is the flatter side: what lies behind a touched face contradicts no
    finger. A smaller one is solved where a larger one gives no result; of a pose both
    directions are solved, and the wider one counts.
    """
    known = max(off[axis], LEAST_SIGMA)
    off = off * min(1.0, prior / known)
    is_open, widest = touched is None or touched.min() < KNOWN_FACE, None
    rise = PROFILE_RISE / 2 if touched is None else PROFILE_RISE
    for way in (1, -1):
        behind = touched if is_open and way > 0 else None
        there = partial(elsewhere, axis, way * direction / known, behind)
        sigma_so_far = abs((off if widest is None else widest)[axis])
        # Where a Gaussian costs twice as much; most cost half as much.
        first = min(np.sqrt(4 * rise) * known, VAGUE_SHARE * prior)
        first = min(max(first, FIRST_STEP), prior)
        given = at, axis, first, sigma_so_far, prior, rise, seeks
        prior_added = None if cost is None else (lambda step, way=way: cost(way * step))
        found, better = _profile_one_side(there, *given, prior_added)
        if better is not None:
            return off, better
        both = [d for d in (widest, found) if d is not None]
        widest = max(both, key=lambda d: abs(d[axis]), default=None)
        if widest is not None and touched is not None:
            break
    if widest is None or (is_open and abs(widest[axis]) <= abs(off[axis])):
        return off, None
    return widest, None


def _profile_one_side(
    there, at, axis, step, sigma_so_far, prior, target_rise, seeks, cost
):
    """Return the widest deviation (k,) in one direction, or None; and a better optimum.

    there(step): the hypothesis with that one held so far off [m], or None;
    sigma_so_far [m]: from the other direction or the Hessian; target_rise [nats]: at
    which the profile ends; it also ends beyond the distance at which that rise leaves a
    large deviation; cost(step): of the prior, of an open size.
    """
    found, points, least_growth = None, [(0.0, 0.0)], 1.0
    farthest = VAGUE_SHARE * prior * np.sqrt(2 * target_rise)
    while (sigma_so_far if found is None else abs(found[axis])) < VAGUE_SHARE * prior:
        moved = there(step)
        if moved is None:
            break
        price = moved.objective - at.objective
        if price < -BETTER_OPTIMUM and seeks:
            return None, moved
        points.append((step, max(price, 0.0)))
        deviation = min(step / np.sqrt(2 * max(price, ONE_SIGMA)), prior)
        if found is None or deviation > abs(found[axis]):
            found = (moved.end - at.end) * deviation / step
        if price >= ENDED * target_rise or step >= farthest:
            break
        growth = max(least_growth, target_rise / max(price, ONE_SIGMA))
        step = min(step * min(MAX_STEP_GROWTH, growth), farthest)
        least_growth = PLATEAU_GROWTH if price > ONE_SIGMA else 1.0
    if cost is not None:
        vague = VAGUE_SHARE * prior <= sigma_so_far < ENDED * prior  # by the Hessian
        least = sigma_so_far if vague else 0.0
        given = at, axis, found, points, least, prior, target_rise, cost
        found = _open_deviation(there, *given)
    return found, None


def _open_deviation(there, at, axis, found, points, least, prior, target_rise, cost):
    """Return the deviation (k,) of an open size, or None; found: by its profile.

    One more solve, a deviation of the prior off, tells whether the rise levels off,
    unless no plateau at the last rise would widen it, and whether a large deviation by
    the Hessian, least [m], 0 if there is none, is larger.  points: see `_of_posterior`.
    """
    price, given = points[-1][1], (cost, prior, target_rise)
    plateau = _of_posterior([*points, (prior, price)], *given)
    ended = price >= ENDED * target_rise and plateau > abs(found[axis])
    if (least or ended) and (moved := there(prior)) is not None:
        points = [*points, (prior, max(moved.objective - at.objective, 0.0))]
        found = (moved.end - at.end) * least / prior if least else found
    if found is None or points[-1][1] >= 2 * target_rise:
        return found
    deviation = min(_of_posterior(points, *given), prior)
    return found * max(1.0, deviation / abs(found[axis]))


def _of_posterior(points, cost, prior, target_rise) -> float:
    """Return the root of the second moment [m] of exp(-rise), a posterior density.

    A plateau a few nats above a narrow optimum can have most of its mass.  points:
    steps [m] and rises [nats] of some solves.  Between them the root of the rise is a
    straight line, as of a Gaussian; behind the last one what is not the prior's,
    cost(step), rises as before.
    """
    steps, rises = np.array(points).T
    d = np.linspace(0, prior * np.sqrt(2 * target_rise), POSTERIOR_NODES)
    rise, behind = np.interp(d, steps, np.sqrt(rises)) ** 2, d > steps[-1]
    told = rises[-2:] - cost(steps[-2:])
    slope = max(0.0, (told[1] - told[0]) / (steps[-1] - steps[-2]))
    rise[behind] += slope * (d[behind] - steps[-1])
    rise[behind] += cost(d[behind]) - cost(steps[-1])
    density = np.exp(-rise)
    return float(np.sqrt((density * d**2).sum() / density.sum()))


def _constrained(job, solved, shared, chosen, axis, direction, touched, step):
    """Return the hypothesis of one of the chosen unknowns held `step` [m] off, or None.

    direction: the response of all unknowns to it by the Hessian; shared: keeps solvers.
    The start moves all unknowns along, or, with the samples on both faces of a size
    (touched), only that size. A feasible solve with a small rise is enough.
    """
    problem, held = solved.problem, chosen[axis]
    x = problem.pack(solved.solution.values) + step * direction
    low = np.broadcast_to(job.shape.bounds[0], job.shape.theta)
    too_small = axis < len(low) and x[held] < low[axis]
    if too_small or job.deadline.passed("profile likelihoods"):
        return None
    values = problem.unpack(x)
    if touched is not None:
        moved = resized(solved.at, axis, x[held], touched)
        values = solved.solution.values | start_values(problem, solved.window, moved)
    level = replace(job.page.LEVELS[-1], fixed=(np.array([held]),))
    level = level.with_ipopt(max_iter=PROFILE_ITERATIONS)
    level = replace(level, warm_start={"mu_init": PROFILE_MU})
    start = replace(solved.solution, values=values)
    settings = replace(settings_of(job), tolerance=RANKING_TOLERANCE)
    found = solve_levels(problem, (level,), start, settings, shared)
    cheap = found.objective < solved.solution.objective + PROFILE_RISE
    if max(found.violations.values(), default=0.0) > RANKING_TOLERANCE:
        return None
    return replace(solved, solution=found).at if found.success or cheap else None
