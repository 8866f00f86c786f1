"""Number of vertices of a polytope: backward elimination, model selection by evidence.

A hull of many half-spaces is fitted by the quasi-static page (vertices, poses).  The
vertex that touches need least goes, and the rest is fitted again, down to the fewest
that the shape may have.  Where each of many vertices is near its place, fits of few are
still in a wrong optimum, so that simpler hulls start fits of their own: those of few
vertices, and those of few faces.  Laplace's evidence compares all fits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import polytope_quasi_static

from ..data.contact_segments import ends_of_actions
from ..geometry.convex_hull import centroid, departure, fingers_in_body, volume
from ..geometry.simplification import (
    more_vertices,
    touch_cost,
    with_counts,
    with_fewer_faces,
    without_touch,
)
from ..local.comparison import same_body
from ..local.local_solve import page_window
from ..local.margins import LEAST_MOTION_BEHIND
from ..local.solved import BuiltPage, Solved, search_settings
from ..problem.hypothesis import Hypothesis
from .predicted_motion import with_pushes

FIRST_COUNT = 30  # vertices of the first fit of a hull, of which some are removed
ONE_BY_ONE = 10  # of so many vertices or fewer one is removed before the next fit
FEW = 8  # so few are corners where planes meet
FACES = 12, 10, 9, 8, 7, 6, 5, 4  # of hulls that start fits of FEW vertices


def likeliest_fits(job, hulls) -> list[Hypothesis]:
    """Return fits of hulls at most LEAST_MOTION_BEHIND the best, which is the first.

    Of each hull with each number of vertices that the shape may have, from many to few,
    until a fit is the same body as an earlier one with as many vertices.  Their
    objective is less the evidence: what more vertices lose of it is added.  At a
    deadline those of the bodies fitted by then, one at least.
    """
    counts, fits, least = counts_of(job.shape), [], np.inf
    known, ends = [], ends_of_actions(job.data)
    for start in (start for hull in hulls for start in starts_of(job, hull, counts)):
        if fits and job.deadline.passed("other numbers of vertices"):
            break
        if start.objective > least:
            continue
        for fit in with_fewer_vertices(job, start, counts):
            finite = np.isfinite(fit.cost)  # or it diverged
            if fit.at.theta.size // 3 in counts:
                evidence = fit.cost + fit.occam if finite else np.inf
                fits.append(replace(fit.at, objective=evidence))
                least = min(least, evidence)
            if finite and fit.cost > least:
                break  # fewer vertices do not fit better
            alike = [h for h in known if h.theta.size == fit.at.theta.size]
            if any(same_body(job.shape, fit.at, h, ends) for h in alike):
                break  # nor from here than from there
            known.append(fit.at)
            if fits and job.deadline.passed("other numbers of vertices"):
                break
    fits.sort(key=lambda h: h.rank)
    return [h for h in fits if h.objective <= fits[0].objective + LEAST_MOTION_BEHIND]


def counts_of(shape) -> list[int]:
    """Return the numbers of vertices that a polytope may have, descending."""
    return sorted(shape.counts or [shape.theta // 3], reverse=True)


def starts_of(job, hull: Hypothesis, counts) -> list[Hypothesis]:
    """Return the bodies from which fits start: simplified hulls, counts: descending.

    With FIRST_COUNT vertices, since the more there are, the fewer local optima leave
    touches unexplained; with FEW, without vertices of least volume; and of few faces.
    A hull that has FEW vertices itself is fitted with all of its own alone.
    """
    corners = hull.theta.reshape(-1, 3)
    few = [count for count in counts if count <= FEW]
    bodies = with_counts(corners, few[:1])
    if len(corners) <= FEW:
        return [replace(hull, theta=V.ravel()) for V in bodies]
    bodies = [*with_counts(corners, [max(FIRST_COUNT, counts[0])]), *bodies]
    starts = [replace(hull, theta=V.ravel()) for V in bodies]
    return [*starts, *(of_few_faces(job, hull, few) if few else [])]


def of_few_faces(job, hull: Hypothesis, few) -> list[Hypothesis]:
    """Return hulls of few faces, one with each of few numbers of vertices, if any.

    Of hulls with so many FACES, thinned to the number, the one from which fingers
    depart least.  Where it has fewer than FEW vertices its misfit is its objective: a
    fit of more that costs less is likelier.
    """
    window = job.window_until(hull.x.shape[1])
    starts: dict[int, Hypothesis] = {}
    for body in with_fewer_faces(hull.theta.reshape(-1, 3), FACES):
        for V in filter(volume, with_counts(body, few)):
            cost = misfit(window, hull.x, V)
            if len(V) not in starts or cost < starts[len(V)].objective:
                starts[len(V)] = replace(hull, theta=V.ravel(), objective=cost)
    for count in (count for count in starts if count >= FEW):
        starts[count] = replace(starts[count], objective=hull.objective)
    return [starts[count] for count in sorted(starts, reverse=True)]


def misfit(window, x, vertices) -> float:
    """Return what touches off a hull at poses x (3, T), and fingers in it, cost."""
    touch, free = window.touch, window.free
    touches, others = (fingers_in_body(fingers, x) for fingers in (touch, free))
    apart = departure(vertices, touches, touch.radius)
    within = np.minimum(departure(vertices, others, free.radius), 0.0)
    return touch_cost(np.r_[apart, within])


def with_fewer_vertices(job, start: Hypothesis, counts):
    """Yield fits of a body with fewer and fewer vertices, each from the one before.

    The vertex goes without which the body is as far from the touches as with it
    (backward elimination), down to the next of the counts, of ONE_BY_ONE or fewer one
    at a time.  counts: descending.
    """
    levels = polytope_quasi_static.STARTING
    fit, count = polished(job, start, levels), len(start.theta) // 3
    yield fit
    while np.isfinite(fit.cost) and (fewer := [c for c in counts if c < count]):
        count = fewer[0] if count > ONE_BY_ONE else count - 1
        centres = fingers_in_body(fit.window.touch, fit.at.x)
        V = without_touch(fit.at.theta.reshape(-1, 3), centres, count)
        start = replace(fit.at, theta=more_vertices(V, count).ravel())
        fit = polished(job, start, levels[1:])
        yield fit


def polished(job, body: Hypothesis, levels) -> Solved:
    """Return levels of the quasi-static page solved from a body: vertices and poses."""
    job = replace(job, page=polytope_quasi_static)
    centre = centroid(body.theta.reshape(-1, 3))[:2]
    window = with_pushes(job, page_window(job, body), body.x, centre)
    built = BuiltPage(job.build(window), window, body)
    start, settings = built.values_at(body), search_settings(job)
    solved = built.solve(job, levels, start, settings=settings)
    return replace(solved, hypothesis=body)
