"""The deviation of one unknown by its profile, as in profile_likelihood.py.

A profile is a function of a step [m]: the solve with one unknown held so far off its
optimum, all else free, or None.  Here it is chosen how far the steps go, and what
deviation the rises of the objective mean.
"""

from __future__ import annotations

import numpy as np

from ..information.measurement_noise import KNOWN_FACE
from ..information.tangent_space import LEAST_SIGMA
from ..search.margins import BETTER_OPTIMUM, ONE_SIGMA, PROFILE_RISE

VAGUE_SHARE = 0.3  # [prior deviations] a larger sigma of a size needs no profile
FIRST_STEP = 0.5e-3  # [m] at least
MAX_STEP_GROWTH = 10.0  # [-] from step to step
# [-] at least, once a straight line would have ended: else 30 more solves on a plateau
PLATEAU_GROWTH = 1.5
TAIL_GROWTH = 2.0  # [-] behind the rise: far solves are slow (109 iterations, 216 at 4)
ENDED = 0.99  # [-] of the rise, or of the prior's deviation, at which a profile ends
POSTERIOR_NODES = 1000  # of the integral over a narrow optimum and a wide plateau


def deviation_along(
    elsewhere, best, prior, axis, direction, off, touched, seeks=True, cost=None
):
    """Return by how much sizes and final pose are off (k,) where one of them is.

    elsewhere(axis, direction, touched): a profile, called with growing steps; best:
    the solve at the optimum; prior [m]: the most that it may be off; direction, off:
    what all unknowns, and sizes and final pose (k,), do by the Hessian where it is off
    by a deviation, SI; touched (2,): samples on both faces of a size, None of a pose;
    seeks: whether a lower objective ends the profile; cost(change [m]) of a size that a
    touch leaves open: what the prior adds [nats]. The Hessian's deviation is kept where
    it is large, where there is no profile, and of an untouched size or a pose where it
    is the larger one. And a better solve, or None.
    A larger body is the flatter side: what lies behind a touched face contradicts no
    finger. A smaller one is solved where a larger one gives no result; of a pose both
    directions are solved, and the wider one counts.
    """
    hessian_sigma = max(off[axis], LEAST_SIGMA)
    off = off * min(1.0, prior / hessian_sigma)
    is_open, widest = touched is None or touched.min() < KNOWN_FACE, None
    rise = PROFILE_RISE / 2 if touched is None else PROFILE_RISE
    for way in (1, -1):
        behind = touched if is_open and way > 0 else None
        there = elsewhere(axis, way * direction / hessian_sigma, behind)
        least_sigma = abs((off if widest is None else widest)[axis])
        # Where a Gaussian costs twice as much; most cost half as much.
        first = min(np.sqrt(4 * rise) * hessian_sigma, VAGUE_SHARE * prior)
        first = min(max(first, FIRST_STEP), prior)
        arguments = best, axis, first, least_sigma, prior, rise, seeks
        prior_added = None if cost is None else (lambda step, way=way: cost(way * step))
        one_side, better = _profile_one_side(there, *arguments, prior_added)
        if better is not None:
            return off, better
        both = [d for d in (widest, one_side) if d is not None]
        widest = max(both, key=lambda d: abs(d[axis]), default=None)
        if widest is not None and touched is not None:
            break
    if widest is None or (is_open and abs(widest[axis]) <= abs(off[axis])):
        return off, None
    return widest, None


def _profile_one_side(
    there, best, axis, step, least_sigma, prior, target_rise, seeks, cost
):
    """Return the widest deviation (k,) in one direction, or None; and a better optimum.

    there(step): the solve with that one held so far off [m], or None;
    least_sigma [m]: from the other direction or the Hessian; target_rise [nats]: at
    which the profile ends; it also ends beyond the distance at which that rise leaves a
    large deviation; cost(step): of the prior, of an open size.
    """
    widest, points, least_growth = None, [(0.0, 0.0)], 1.0
    farthest = VAGUE_SHARE * prior * np.sqrt(2 * target_rise)
    while (least_sigma if widest is None else abs(widest[axis])) < VAGUE_SHARE * prior:
        moved = there(step)
        if moved is None:
            break
        price = moved.solution.objective - best.solution.objective
        if price < -BETTER_OPTIMUM and seeks:
            return None, moved
        points.append((step, max(price, 0.0)))
        deviation = min(step / np.sqrt(2 * max(price, ONE_SIGMA)), prior)
        if widest is None or deviation > abs(widest[axis]):
            widest = (moved.at.end - best.at.end) * deviation / step
        if price >= ENDED * target_rise or step >= farthest:
            break
        growth = max(least_growth, target_rise / max(price, ONE_SIGMA))
        step = min(step * min(MAX_STEP_GROWTH, growth), farthest)
        least_growth = PLATEAU_GROWTH if price > ONE_SIGMA else 1.0
    if cost is not None:
        vague = VAGUE_SHARE * prior <= least_sigma < ENDED * prior  # by the Hessian
        least = least_sigma if vague else 0.0
        arguments = best, axis, widest, points, least, prior, target_rise, cost
        widest = _open_deviation(there, *arguments)
    return widest, None


def _open_deviation(there, best, axis, widest, points, least, prior, target_rise, cost):
    """Return the deviation (k,) of an open size, or None; widest: by its profile.

    Solves farther off tell whether the rise levels off, until no plateau at the last
    rise would widen the deviation, and, at a deviation of the prior, whether a large
    one by the Hessian, least [m], 0 if there is none, is larger.  points: see
    `_of_posterior`.
    """
    arguments = cost, prior, target_rise
    (step, price), ended = points[-1], points[-1][1] >= ENDED * target_rise
    while step < prior and price < 2 * target_rise and (least or ended):
        plateau = _of_posterior([*points, (prior, price)], *arguments)
        if not least and plateau <= abs(widest[axis]):
            break
        step = prior if least else min(TAIL_GROWTH * step, prior)
        if (moved := there(step)) is None:
            break
        price = max(moved.solution.objective - best.solution.objective, 0.0)
        points = [*points, (step, price)]
        widest = (moved.at.end - best.at.end) * least / prior if least else widest
    if widest is None or price >= 2 * target_rise:
        return widest
    deviation = min(_of_posterior(points, *arguments), prior)
    return widest * max(1.0, deviation / abs(widest[axis]))


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
    rest = rises[-2:] - cost(steps[-2:])
    slope = max(0.0, (rest[1] - rest[0]) / (steps[-1] - steps[-2]))
    rise[behind] += slope * (d[behind] - steps[-1])
    rise[behind] += cost(d[behind]) - cost(steps[-1])
    density = np.exp(-rise)
    return float(np.sqrt((density * d**2).sum() / density.sum()))
