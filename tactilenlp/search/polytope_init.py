"""Initialisation of a polytope: a polytope from half-spaces, fitted with least motion.

`search_polytope` finds poses and supporting planes action by action (plane_slam.py),
intersects the half-spaces behind the planes, between the touches and every free finger,
above the ground and within a ball for the untouched side, and fits vertices and poses
by the quasi-static page.  Vertices that no touch asks for are removed one after the
other; fits of most evidence (Laplace) start the page with impulses (`likeliest`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import polytope_quasi_static

from ..common.interrupt import interruptible
from ..common.progress import progress
from ..data.contact_segments import samples_until, without_outliers
from ..errors import NoContactError, TactileError
from ..geometry.convex_hull import (
    CORNER,
    MOST_OF_TOUCH,
    Ball,
    departure,
    fingers_in_body,
    hull_vertices,
    merge_points,
    more_vertices,
    nearest_in_hull,
    nearest_points,
    unseen_ball,
    unseen_halfspaces,
    vertices_behind,
    with_counts,
    with_fewer_faces,
    without_touch,
)
from ..local.hypothesis import Hypothesis
from ..local.local_solve import built_page
from ..local.margins import LEAST_MOTION_BEHIND
from ..local.solved import Solved, search_settings
from ..problem.reductions import Reductions, reduce
from .plane_slam import (
    Faces,
    extended_faces,
    merged_faces,
    touched_halfspaces,
    with_pushes,
)

MAX_CUTS = 30  # half-spaces from free fingers, at most
PENETRATION = 0.1e-3  # [m] a free finger may overlap the body so far
FIRST_COUNT = 30  # vertices of the first fit of a hull, of which some are removed
FACES = 12, 10, 9, 8, 7, 6, 5, 4  # of hulls of which vertices are removed
ONE_BY_ONE = 10  # of fewer vertices one is removed before the next fit
FEW = 8  # so few are corners where planes meet
BODIES_SOLVED = 6  # by the page, of those at most LEAST_MOTION_BEHIND the best
CUBE_CORNER = 3**0.5  # [radii] of a cube's corners about the ball within it


def corners_behind_planes(window, faces: Faces, size, ground=True, ball=True):
    """Return the vertices (n, 3) [m] of the intersection of half-spaces.

    ground: whether there is one, at z = 0; ball: whether a ball bounds the untouched
    side. Without one, None unless planes and ground close the body.
    """
    planes, points = touched_halfspaces(window, faces)
    fitted = unseen_ball(points, size, ground)
    if ball:
        halfspaces = np.vstack([planes, unseen_halfspaces(points, fitted, ground)])
    elif (halfspaces := closing_halfspaces(planes, points, fitted, ground)) is None:
        return None
    corners = vertices_behind(halfspaces)
    cuts = separating_halfspaces(window, faces, points)
    for _ in range(MAX_CUTS):
        deep = (corners @ cuts[:, :3].T).max(axis=0, initial=-np.inf) - cuts[:, 3]
        if not len(cuts) or deep.max() < PENETRATION:
            break
        halfspaces = np.vstack([halfspaces, cuts[[np.argmax(deep)]]])
        try:
            corners = vertices_behind(halfspaces)
        except TactileError:
            break
    return hull_vertices(merge_points(corners))


def closing_halfspaces(planes, points, ball: Ball, ground) -> np.ndarray | None:
    """Return the half-spaces (n, 4) that bound a body without a ball, if they do.

    They do where no corner of planes and ground is CUBE_CORNER radii from the ball's
    centre or farther: a sharp corner that no finger felt does not need another face.
    """
    wide = replace(ball, radius=2 * CUBE_CORNER * ball.radius)
    halfspaces = np.vstack([planes, unseen_halfspaces(points, wide, ground)])
    far = np.linalg.norm(vertices_behind(halfspaces) - ball.centre, axis=1).max()
    return halfspaces if far < CUBE_CORNER * ball.radius else None


def separating_halfspaces(window, faces: Faces, points) -> np.ndarray:
    """Return half-spaces (n, 4) between the touched points and every free finger."""
    centre = fingers_in_body(window.free, faces.x)
    if not len(centre):
        return np.zeros((0, 4))
    away = centre - nearest_in_hull(points, centre)
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    b = (centre * away).sum(axis=1) - window.free.radius
    return np.c_[away, np.maximum(b, (points @ away.T).max(axis=0))]


def search_polytope(job, kept, keep=lambda _: None) -> list[Hypothesis]:
    """Return hypotheses that explain all actions of a job, with least motion.

    At most BODIES_SOLVED, those of most evidence first: the page decides between them.
    kept: a hypothesis of the first actions, if any, with any number of vertices;
    keep(hypotheses): is called with that of the actions done by Ctrl-C.
    At a deadline the body stays where it is after the actions done.
    Raises NoContactError where no touch is credible.
    """
    job = with_credible_touches(job)
    faces, action = [planes_on_body(job, kept[0])] if kept else [], job.data.action
    ends = np.searchsorted(action, np.unique(action), side="right").tolist()
    ends = [last for last in ends if job.data.contact[:last].any()]
    try:
        with interruptible():
            for i, last in enumerate(progress(ends, "search")):
                if faces and last <= faces[0].x.shape[1]:
                    continue
                if faces and job.deadline.passed(f"a search from action {i + 1} on"):
                    break
                faces = extended_faces(job, faces, last)
            return _fitted(job, faces)
    except KeyboardInterrupt:
        keep([unfitted(job, one) for one in faces[:1]])
        raise


def _fitted(job, several: list[Faces]) -> list[Hypothesis]:
    """Return the bodies of planes, fitted if there is time; they stay at the end."""
    samples = job.data.samples
    part = replace(job, data=samples_until(job.data, several[0].x.shape[1]))
    if job.deadline.passed("a fit of the first polytope"):
        bodies = [unfitted(job, several[0])]
    else:
        hulls = [hull for faces in several for hull in hulls_from(job, faces)]
        bodies = likeliest(part, hulls)[:BODIES_SOLVED]
    rest = [np.repeat(h.x[:, -1:], samples - h.x.shape[1], axis=1) for h in bodies]
    return [
        replace(h, x=np.hstack([h.x, stays]))
        for h, stays in zip(bodies, rest, strict=True)
    ]


def likeliest(job, hulls) -> list[Hypothesis]:
    """Return fits of hulls at most LEAST_MOTION_BEHIND the best, which is the first.

    Of each hull with each number of vertices that the shape may have, from many to few.
    Their objective is less the evidence: what more vertices lose of it is added.
    At a deadline those of the bodies fitted by then, one at least.
    """
    fits, least, counts = [], np.inf, counts_of(job.shape)
    for start in (start for hull in hulls for start in starts_of(job, hull, counts)):
        for fit in with_fewer_vertices(job, start, counts):
            if not np.isfinite(fit.cost):  # it diverged
                fits.append(replace(fit.at, objective=np.inf))
                break
            fits.append(replace(fit.at, objective=fit.cost + fit.occam))
            least = min(least, fits[-1].objective)
            if fit.cost > least or job.deadline.passed("other numbers of vertices"):
                break  # fewer vertices do not fit better
    fits.sort(key=lambda h: h.rank)
    return [h for h in fits if h.objective <= fits[0].objective + LEAST_MOTION_BEHIND]


def counts_of(shape) -> list[int]:
    """Return the numbers of vertices that a polytope may have, descending."""
    return sorted(shape.counts or [shape.theta // 3], reverse=True)


def starts_of(job, hull: Hypothesis, counts) -> list[Hypothesis]:
    """Return the bodies from whose fits vertices are removed, counts: descending.

    With FIRST_COUNT vertices, since the more there are, the fewer local optima leave
    touches unexplained; with FEW, without vertices of least volume; and with each
    smaller count, without faces of least volume: of hulls of so many FACES, thinned to
    the count, the one from which fingers depart least.
    """
    corners = hull.theta.reshape(-1, 3)
    few, bodies = [count for count in counts if count <= FEW], []
    if len(corners) > FEW:
        bodies += with_counts(corners, [max(FIRST_COUNT, counts[0])])
    bodies += with_counts(corners, few[:1])
    if len(corners) > FEW and few:
        data = samples_until(job.data, hull.x.shape[1])
        window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
        thinned = with_fewer_faces(corners, FACES)
        thinned = [V for body in thinned for V in with_counts(body, few)]
        for count in few:
            some = [V for V in thinned if len(V) == count]
            bodies += [min(some, key=lambda V: misfit(window, hull.x, V))][: len(some)]
    return [replace(hull, theta=V.ravel()) for V in bodies]


def misfit(window, x, vertices) -> float:
    """Return what fingers on a hull at poses x (3, T), and free ones in it, cost."""
    touch, free = window.touch, window.free
    touches, others = (fingers_in_body(fingers, x) for fingers in (touch, free))
    apart = departure(vertices, touches, touch.radius)
    within = np.minimum(departure(vertices, others, free.radius), 0.0)
    squared = np.r_[apart, within] ** 2 / (2 * CORNER**2)
    return np.minimum(squared, MOST_OF_TOUCH).sum()


def with_fewer_vertices(job, start: Hypothesis, counts):
    """Yield fits of a body with each of the counts, each fit from the one before.

    The vertex goes without which the body is as far from the touches as with it
    (backward elimination): of few vertices one at a time.  counts: descending.
    """
    levels = polytope_quasi_static.STARTING
    fit, count = polished(job, start, levels), len(start.theta) // 3
    while True:
        if count in counts:
            yield fit
        fewer = [c for c in counts if c < count]
        if not (fewer and np.isfinite(fit.cost)):
            return
        count = fewer[0] if count > ONE_BY_ONE else count - 1
        centres = fingers_in_body(fit.window.touch, fit.at.x)
        V = without_touch(fit.at.theta.reshape(-1, 3), centres, count)
        start = replace(fit.at, theta=more_vertices(V, count).ravel())
        fit = polished(job, start, levels[1:])


def has_likely_count(job, h: Hypothesis) -> bool:
    """Tell whether evidence asks for no other number of vertices than a hypothesis has.

    That is, whether fits with as many are among the likeliest, by the planes that
    touches have on it.  job: of its samples.
    """
    if not job.shape.counts or job.deadline.passed("other numbers of vertices"):
        return True
    job = with_credible_touches(replace(job, reductions=Reductions()))
    try:
        hulls = hulls_from(job, planes_on_body(job, h))
    except TactileError:  # planes of touches that noise moved close no body
        return True
    return any(fit.theta.size == h.theta.size for fit in likeliest(job, hulls))


def hulls_from(job, faces: Faces) -> list[Hypothesis]:
    """Return the hulls of the planes seen so far, as hypotheses with many vertices.

    One is bounded by a ball on its untouched side; a second one has touched faces only,
    where planes and ground close it.
    """
    data = samples_until(job.data, faces.x.shape[1])
    window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
    ground = job.scene.ground is not None
    arguments = window, faces, job.shape.size_prior, ground
    theta = corners_behind_planes(*arguments).ravel()
    cost, iterations = faces.objective, faces.iterations
    hull = Hypothesis(theta, faces.x, cost, ("planes",), iterations)
    corners = corners_behind_planes(*arguments, ball=False) if ground else None
    if corners is None:
        return [hull]
    path = *hull.path, "closed"
    return [hull, replace(hull, theta=corners.ravel(), path=path, closed=True)]


def unfitted(job, faces: Faces) -> Hypothesis:
    """Return the hull of the planes seen so far with as many vertices as asked for."""
    hull, *_ = hulls_from(job, faces)
    count = counts_of(job.shape)[0]
    (V,) = with_counts(hull.theta.reshape(-1, 3), [count])
    return replace(hull, theta=V.ravel())


def polished(job, body: Hypothesis, levels) -> Solved:
    """Return levels of the quasi-static page solved from a body: vertices and poses."""
    job = replace(job, page=polytope_quasi_static)
    built = built_page(job, body)
    window = with_pushes(job, built.window, body.x)
    built = replace(built, problem=job.build(window), window=window)
    start, settings = built.values_at(body), search_settings(job)
    solved = built.solve(job, levels, start, settings=settings)
    iterations = body.iterations + solved.solution.iterations
    return replace(solved, hypothesis=replace(body, iterations=iterations))


def with_credible_touches(job):
    """Return the job without touches that no neighbour confirms.

    Raises NoContactError where none is left.
    """
    data = without_outliers(job.data, job.precision.normal)
    if data.contact.any():
        return replace(job, data=data)
    raise NoContactError(
        "no touch is confirmed by its neighbours",
        where="normal",
        got=f"{int(job.data.contact.sum())} touches, none like another",
        expected="a finger that feels about one normal for two samples or more",
        next="check the frame of the normals, or record a touch that lasts",
    )


def planes_on_body(job, h: Hypothesis) -> Faces:
    """Return the planes that the touches of the first actions have on a known body."""
    data = samples_until(job.data, h.x.shape[1])
    window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
    centre = fingers_in_body(window.touch, h.x)
    point = nearest_points(h.theta.reshape(-1, 3), centre)
    n = centre - point
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    b, plane = (n * point).sum(axis=1), np.arange(len(n))
    return merged_faces(window, Faces(plane, n, b, h.x, objective=0.0))
