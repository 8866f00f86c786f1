"""Initialisation of a polytope: a polytope from half-spaces, fitted with least motion.

`search_polytope` finds poses and supporting planes action by action (plane_slam.py),
intersects the half-spaces behind the planes, between the touches and every free finger,
above the ground and within a ball for the untouched side, and fits vertices and poses
by the quasi-static page.  Of several numbers of vertices Laplace's evidence chooses:
corners that no touch asks for go (`likeliest`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import polytope_quasi_static

from ..common.interrupt import interruptible
from ..common.progress import progress
from ..data.contact_segments import samples_until, without_outliers
from ..errors import NoContactError, SceneError, TactileError
from ..geometry.convex_hull import (
    Ball,
    filled,
    fingers_in_body,
    hull_vertices,
    merged,
    nearest,
    thinned,
    vertices_behind,
)
from ..problem.reductions import Reductions, reduce
from .hypothesis import CLOSED, Hypothesis
from .local_solve import built_page
from .margins import DECISIVE
from .plane_slam import (
    Faces,
    extended_faces,
    merged_faces,
    touched_halfspaces,
    unseen_ball,
    unseen_halfspaces,
)
from .solved import Solved, search_settings

MAX_CUTS = 30  # half-spaces from free fingers, at most
PENETRATION = 0.1e-3  # [m] a free finger may overlap the body so far
BODIES_SOLVED = 2  # by the page, of those whose evidence is much the same
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
    return hull_vertices(merged(corners))


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


def nearest_in_hull(points, centre) -> np.ndarray:
    """Return the points of the hull of `points` nearest to each centre (n, 3)."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[-1] < 1e-4:
        apart = np.linalg.norm(points[None] - centre[:, None], axis=2)
        return points[np.argmin(apart, axis=1)]
    return nearest(hull_vertices(points), centre)


def check_round_fingertips(scene) -> None:
    """Raise SceneError unless the fingertips are round."""
    if scene.finger_length > 0:
        raise SceneError(
            "a polytope is estimated with round fingertips only",
            where="finger_length", got=scene.finger_length, expected="0",
        )  # fmt: skip


def search_polytope(job, kept: list) -> list[Hypothesis]:
    """Return the hypothesis that explains all actions of a job, with least motion.

    And one of a body whose every face was touched, where planes and ground close one.
    kept: a hypothesis of the first actions, if any, with any number of vertices; when
    Ctrl-C interrupts, it holds that of the actions done.
    At a deadline the body stays where it is after the actions done.
    Raises NoContactError where no touch is credible.
    """
    job = with_credible_touches(job)
    faces, action = [faces_of(job, kept[0])] if kept else [], job.data.action
    ends = np.searchsorted(action, np.unique(action), side="right").tolist()
    ends = [last for last in ends if job.data.contact[:last].any()]
    try:
        with interruptible():
            for i, last in enumerate(progress(ends, "search")):
                if faces and last <= faces[0].x.shape[1]:
                    continue
                if faces and job.deadline.passed(f"a search from action {i + 1} on"):
                    break
                faces[:] = [extended_faces(job, faces[0] if faces else None, last)]
            return _fitted(job, faces[0])
    except KeyboardInterrupt:
        kept[:] = [bodies_from(job, one)[0] for one in faces]
        raise


def _fitted(job, faces: Faces) -> list[Hypothesis]:
    """Return the bodies of planes, fitted if there is time; they stay at the end."""
    samples = job.data.samples
    part = replace(job, data=samples_until(job.data, faces.x.shape[1]))
    if job.deadline.passed("a fit of the first polytope"):
        bodies = bodies_from(job, faces)
    else:
        bodies = fitted_bodies(part, bodies_from(job, faces, job.shape.counts))
    rest = [np.repeat(h.x[:, -1:], samples - h.x.shape[1], axis=1) for h in bodies]
    return [
        replace(h, x=np.hstack([h.x, stays]))
        for h, stays in zip(bodies, rest, strict=True)
    ]


def fitted_bodies(job, bodies) -> list[Hypothesis]:
    """Return the bodies fitted; of several numbers of vertices those of most evidence.

    These are the best one and others that are at most DECISIVE behind: the page decides
    between them.
    """
    if not job.shape.counts:
        return [polished(job, body).at for body in bodies]
    return [fit.at for fit in likeliest(job, bodies)[:BODIES_SOLVED]]


def likeliest(job, bodies) -> list[Solved]:
    """Return fits of bodies at most DECISIVE behind in evidence, the best first.

    bodies: of one hull the one of most vertices first.  At a deadline those of the
    bodies fitted by then, one at least.
    """
    fits, costs = [], {}  # the latter by path, of the last number of vertices
    for body in bodies:
        least = min((lost for lost, _ in fits), default=np.inf)
        if costs.get(body.path, -np.inf) >= least:  # fewer vertices do not fit better
            continue
        if fits and job.deadline.passed("other numbers of vertices"):
            break
        fit = polished(job, body)
        fitted = np.isfinite(fit.cost)  # else it diverged
        fits.append((fit.cost + fit.occam if fitted else np.inf, fit))
        costs[body.path] = fit.cost if fitted else -np.inf
    fits.sort(key=lambda pair: np.round(pair[0], 3))
    return [fit for lost, fit in fits if lost <= fits[0][0] + DECISIVE]


def has_likely_count(job, h: Hypothesis) -> bool:
    """Tell whether evidence asks for no other number of vertices than a hypothesis has.

    job: of its samples.  By the planes that touches have on it.
    """
    if not job.shape.counts or job.deadline.passed("other numbers of vertices"):
        return True
    job = with_credible_touches(replace(job, reductions=Reductions()))
    try:
        bodies = bodies_from(job, faces_of(job, h), job.shape.counts)
    except TactileError:  # planes of touches that noise moved close no body
        return True
    return any(fit.at.theta.size == h.theta.size for fit in likeliest(job, bodies))


def bodies_from(job, faces: Faces, counts=()) -> list[Hypothesis]:
    """Return the bodies of the planes seen so far, as hypotheses.

    One is bounded by a ball on its untouched side; a second one has touched faces only,
    where planes and ground close it.  counts: numbers of vertices, each of which they
    have; by default that of the shape.
    """
    data = samples_until(job.data, faces.x.shape[1])
    window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
    ground = job.scene.ground is not None
    arguments = window, faces, job.shape.size_prior, ground
    hulls = {("planes",): corners_behind_planes(*arguments)}
    if ground:
        hulls["planes", CLOSED] = corners_behind_planes(*arguments, ball=False)
    counts = sorted(counts or [job.shape.theta // 3], reverse=True)
    return [
        Hypothesis(V.ravel(), faces.x, faces.objective, path, faces.iterations)
        for path, corners in hulls.items() if corners is not None
        for V in with_counts(corners, counts)
    ]  # fmt: skip


def with_counts(corners, counts) -> list[np.ndarray]:
    """Return the hull of corners (n, 3) as so many vertices each; counts: descending.

    Vertices that add least volume go one after another, so that a hull of fewer is
    made of the one before.  No count is taken that a smaller one has room for.
    """
    enough = min((count for count in counts if count >= len(corners)), default=np.inf)
    hulls = []
    for count in (count for count in counts if count <= enough):
        corners = thinned(corners, count)
        hulls.append(filled(corners, count))
    return hulls


def polished(job, body: Hypothesis) -> Solved:
    """Return the quasi-static page solved from a body: vertices and poses fitted."""
    job = replace(job, page=polytope_quasi_static)
    built, levels = built_page(job, body), polytope_quasi_static.STARTING
    start, settings = built.values_at(body), search_settings(job)
    solved = built.solved(job, levels, start, settings=settings)
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


def faces_of(job, h: Hypothesis) -> Faces:
    """Return the planes that the touches of the first actions have on a known body."""
    data = samples_until(job.data, h.x.shape[1])
    window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
    centre = fingers_in_body(window.touch, h.x)
    point = nearest(h.theta.reshape(-1, 3), centre)
    n = centre - point
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    b, plane = (n * point).sum(axis=1), np.arange(len(n))
    return merged_faces(window, Faces(plane, n, b, h.x))
