r"""How far a size may be off at the price of four nats: the profile of the objective.

The optimum of a size that touch leaves open, or tells by way of a path, is often a
kink: cones and sliding are not smooth, and from there the objective grows as the
distance, not as its square.  It looks sharp to a Hessian and is not.  So the page is
solved again with the size s held elsewhere, all else free, farther each time until it
costs PRICE,

    sigma = |s - s_0| / sqrt(2 (L(s) - L(s_0))),

as of a Gaussian with the same likelihood ratio; the other sizes and the final pose go
along as they do on that way.  Where L is lower than at s_0, a better optimum is near.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from formulations.rigid_body import PLANAR

from .hypothesis import Hypothesis
from .information import ENOUGH, TINY
from .rivals import final_covariance, resized
from .solve import solve_levels
from .solving import settings_of
from .trial import OPEN, ROUGH, started

PRICE = 4.0  # [nats] nearly three deviations of a Gaussian
TOLD = 0.3e-3  # [m] two faces that fingers felt tell their distance this well
TWICE = 2.0  # [deviations] or, of noisy fingers, so much worse than their mean at most
CLAIMED = 0.3  # [prior deviations] a size less certain than this claims little
FIRST = 3.0  # [deviations by the Hessian] of the first step: 4.5 nats of a Gaussian
NEAR = 0.5e-3  # [m] the first step is this far at least
GROWTH = 10.0  # [-] of a step at most
LEAST = 0.1  # [nats] a price below this is as good as none
WARM = 1e-3  # IPOPT's first mu where a size is held elsewhere
PATIENCE = 3  # times OPEN iterations, after which a place is given up
GAIN = 0.1  # [nats] a better optimum is better by this at least


def profiled(job, page, solved, options) -> tuple[np.ndarray, Hypothesis | None]:
    """Return by how much sizes and final pose are off (n, k) where each size is.

    Row i: a deviation of size i [m] that touch leaves open, and what sizes [m],
    position [m] and yaw [rad] do then; 0 of other sizes.  And a hypothesis that is
    better than the solved one: None, unless one was met.
    """
    n = job.shape.theta
    profile = np.zeros((n, n + PLANAR.unknowns))
    if not (job.reductions.planar and getattr(job.shape, "symmetries", ())):
        return profile, None  # not a body whose unknowns are its sides, lying flat
    C, faces = final_covariance(solved), solved.touched
    faces[2, 0] += ENOUGH  # the ground touches the lowest one
    known = np.sqrt(np.maximum(np.diag(C)[:n], 0.0))
    for axis, touched in enumerate(faces):
        if touched.min() >= ENOUGH and known[axis] < told(job, touched):
            continue
        sharp = C[axis] / max(known[axis], TINY)
        given = axis, sharp, touched
        profile[axis], better = _deviation(job, page, solved, options, *given)
        if better is not None:
            return profile, better
    return profile, None


def told(job, touched) -> float:
    """Return how well two faces (2,) felt so many times tell their distance [m]."""
    return max(TOLD, TWICE * job.precision.position * np.sqrt(np.sum(1 / touched)))


def _deviation(job, page, solved, options, axis: int, off: np.ndarray, touched):
    """Return by how much sizes and final pose are off (k,) where the size is.

    off (k,): by the Hessian, which may claim too much.  And a better hypothesis, or
    None.  A larger body is the flatter side: what lies behind a felt face contradicts
    no finger.  A smaller one is asked for where a larger one says nothing.
    """
    prior, shared = job.shape.size_prior[1], {}
    first, here = max(FIRST * off[axis], NEAR), _final(solved.at)
    off = off * min(1.0, prior / max(off[axis], TINY))
    for way in (1, -1):
        step, answered = first, False
        while abs(off[axis]) < CLAIMED * prior:
            given = axis, way * step, touched, shared
            there = _elsewhere(job, page, solved, options, *given)
            if there is None:
                break
            price, answered = there.objective - solved.at.objective, True
            if price < -GAIN:
                return off, there
            found = min(step / np.sqrt(2 * max(price, LEAST)), prior)
            if found > abs(off[axis]):
                off = (_final(there) - here) * found / step
            if price >= PRICE:
                break
            step *= min(GROWTH, 1.5 * PRICE / max(price, LEAST))
        if answered:
            break
    return off, None


def _final(hypothesis) -> np.ndarray:
    """Return sizes and final pose of a hypothesis (k,)."""
    return np.r_[hypothesis.theta, hypothesis.x[:, -1]]


def _elsewhere(job, page, solved, options, axis, change, touched, shared):
    """Return the hypothesis of one size held elsewhere, None where none was found.

    One that is feasible is enough: the least price is no more than its price.
    """
    size = solved.at.theta[axis] + change
    if size < job.shape.bounds[0] or time.monotonic() > job.deadline:
        return None
    moved = resized(solved.at, axis, size, touched)
    place = started(solved.problem, solved.window, moved)
    start = replace(solved.solution, values=solved.solution.values | place)
    held = solved.problem.variables["theta"].span.start + axis
    changed = {"warm": WARM, "fixed": (np.array([held]),), "iterations": OPEN}
    level = replace(page.LEVELS[-1], **changed)
    settings = replace(settings_of(job, options), tolerance=ROUGH)
    for _ in range(PATIENCE):
        start = solve_levels(solved.problem, (level,), start, settings, shared)
        if max(start.violations.values(), default=0.0) <= ROUGH:
            return replace(solved, solution=start).at
    return None
