"""The names of a box's axes: which is x, and which way it points.

A box is the same body under 24 names, four while it slides flat.  The convention is
`canonical_relabelling`; the page is solved again under it (`solve_in_canonical_axes`).
A page that tells the axes apart is solved from hypotheses under all names
(`under_distinct_relabellings`).
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from formulations.names import CENTRE_OF_MASS, GROUND

from ..geometry.transforms import is_planar, matrices, rotation_matrix, rotvecs
from ..information.mixture import relabellings
from ..local.local_solve import built_page, in_motion_of, warm_started
from ..local.margins import UNCHANGED
from ..local.solved import Solved
from ..problem.hypothesis import Hypothesis
from ..problem.pages import FORMULATIONS, name_of
from ..solvers.solution import evaluated

log = logging.getLogger("tactilenlp")
UNEQUAL = np.array([0.8, 1.0, 1.25])  # [-] of the mean side, where names are compared
EQUAL_SIDES = 1e-6  # [m] sides this close have no order


def canonical_relabelling(shape, h: Hypothesis, like=None) -> tuple:
    """Return the order of sizes (list), and the axes (3, 3), by which a box is named.

    At the first sample z is the axis nearest the vertical, x points within 90 degrees
    of the world's x, and side x is not shorter than side y.  like: side lengths (3,)
    and rotation (3, 3) at the first sample of an earlier estimate, whose names are kept
    instead.  Other shapes keep their axes.
    """
    if not shape.faced:
        return [*range(len(h.theta))], np.eye(3)
    R = rotation_matrix(h.x[:, 0])

    def rank(way):
        theta, axes = h.theta[way[0]], R @ way[1]
        if like is not None:
            return round(np.linalg.norm(axes * theta - like[1] * like[0]), 9)
        return -axes[2, 2], theta[1] - theta[0] > EQUAL_SIDES, axes[0, 0] < 0

    return min(relabellings(shape, upright=is_planar(h.x)), key=rank)


def in_canonical_axes(shape, h: Hypothesis, like) -> Hypothesis:
    """Return a hypothesis in the axes of the convention, or those of `like`."""
    return relabelled(h, *canonical_relabelling(shape, h, like))


def relabelled(h: Hypothesis, order, S) -> Hypothesis:
    """Return a hypothesis in other axes: an order of sizes, and axes S (3, 3)."""
    return replace(h, theta=h.theta[order], x=with_axes(h.x, S))


def with_axes(x, S) -> np.ndarray:
    """Return poses x, planar or free, of a body frame whose axes are S (3, 3)."""
    if is_planar(x):
        return x + np.array([[0], [0], [np.arctan2(S[1, 0], S[0, 0])]])
    return np.vstack([x[:3], rotvecs(matrices(x) @ S).T])


def solve_in_canonical_axes(solved, like) -> Solved:
    """Return a solve, or one of the same optimum with the axes of a box relabelled.

    like: see `canonical_relabelling`.  A page that tells the axes apart, as by a prior
    of one side, decides itself: a relabelled optimum that costs more is not taken.
    """
    job = solved.job
    order, S = canonical_relabelling(job.shape, solved.at, like)
    if np.array_equal(S, np.eye(3)) or not solved.solution.success:
        return solved
    if job.deadline.passed("the order of a box's axes"):
        return solved
    again = warm_started(job, _relabelled_solution(job.shape, solved, order, S))
    return again if again.rank <= solved.rank else solved


def under_distinct_relabellings(job, hypotheses) -> list[Hypothesis]:
    """Return hypotheses; where a page tells the axes of a box apart, under all names.

    The search takes the axes as alike.  A prior of each side, or a page of the user's,
    need not: the page is evaluated under every name, at a body of unequal sides.
    """
    one_prior = all(np.ptp(part) == 0 for part in job.shape.size_prior)
    shipped = name_of(job.page) in FORMULATIONS and one_prior
    if not (job.shape.faced and hypotheses) or shipped:
        return hypotheses
    kept, costs, best = [], [], hypotheses[0]
    for order, S in relabellings(job.shape, upright=is_planar(best.x)):
        probe = relabelled(replace(best, theta=best.theta.mean() * UNEQUAL), order, S)
        built = built_page(job, probe)
        start = built.values_at(in_motion_of(job, probe))
        cost = evaluated(built.problem, start).objective
        if all(abs(cost - other) > UNCHANGED for other in costs):
            kept.append([relabelled(h, order, S) for h in hypotheses])
            costs.append(cost)
    if len(kept) > 1:
        log.info("the page tells the axes apart: starts under %d names", len(kept))
    return [h for pair in zip(*kept, strict=True) for h in pair]


def _relabelled_solution(shape, solved, order, S) -> Solved:
    """Return a solve with other names of the axes, to start from.

    Ground contacts are listed by corner, the same ones at each step.
    """
    solution, corners = solved.solution, np.array(shape.corners)
    terms = solved.problem.constraints.values()
    of_ground = {term.name for term in terms if term.per == GROUND}
    places = [int(np.argmax(corners @ (S @ c))) for c in corners]
    rows = np.arange(len(solved.window.corner)).reshape(-1, len(corners))
    rows = rows[:, places].ravel()

    def values_relabelled(values) -> dict:
        ground = {k: values[k][:, rows] for k in (GROUND,) if k in values}
        centre = {k: S.T @ values[k] for k in (CENTRE_OF_MASS,) if k in values}
        return values | ground | centre | {"theta": values["theta"][order]}

    multipliers = {
        name: old[rows] if name in of_ground else old
        for name, old in solution.multipliers.items()
    }
    x = with_axes(solution.values["x"], S)
    solution = replace(
        solution,
        values=values_relabelled(solution.values) | {"x": x},
        bound_multipliers=values_relabelled(solution.bound_multipliers),
        multipliers=multipliers,
    )
    h = relabelled(solved.hypothesis, order, S)
    return replace(solved, hypothesis=h, solution=solution)
