"""Initialisation of a polytope: a polytope from half-spaces, fitted with least motion.

`search_polytope` finds poses and supporting planes action by action (plane_slam.py),
intersects the half-spaces behind the planes, between the touches and every free finger,
above the ground and within a ball for the untouched side, and fits vertices and poses
by the quasi-static page, with each number of vertices (vertex_number.py).  Fits of most
evidence start the page with impulses.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..common.interrupt import interruptible
from ..common.progress import progress
from ..data.contact_segments import (
    ends_of_actions,
    samples_until,
    without_outliers,
)
from ..errors import NoContactError, TactileError
from ..geometry.convex_hull import (
    Ball,
    fingers_in_body,
    hull_vertices,
    merge_points,
    nearest_in_hull,
    nearest_points,
    unseen_ball,
    unseen_halfspaces,
    vertices_behind,
)
from ..geometry.simplification import with_counts
from ..local.comparison import distinct
from ..problem.hypothesis import UNSEARCHED, Hypothesis, ranked
from ..problem.job import Job
from ..problem.reductions import Reductions
from .plane_slam import (
    Faces,
    extended_faces,
    merged_faces,
    touched_halfspaces,
)
from .soft_fingertips import as_of_rigid_fingertips, compliances_of
from .vertex_number import counts_of, likeliest_fits

MAX_CUTS = 30  # half-spaces from free fingers, at most
PENETRATION = 0.1e-3  # [m] a free finger may overlap the body so far
# Bodies that the page solves, of those at most LEAST_MOTION_BEHIND the best.  Rigid
# fingertips begin as soft ones: three bodies so lead farther than five did otherwise.
RIGID_BODIES, SOFT_BODIES = 3, 5
CUBE_CORNER = 3**0.5  # [radii] of a cube's corners about the ball within it


def _cut(halfspaces, cuts) -> np.ndarray:
    """Return the vertices behind half-spaces, after the deepest cuts by free fingers.

    A cut that leaves no body is the last one, and is not made.
    """
    corners = vertices_behind(halfspaces)
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


def closing_halfspaces(planes, points, ball: Ball) -> np.ndarray | None:
    """Return the half-spaces (n, 4) that bound a body without a ball, if they do.

    They do where no corner of planes and ground is CUBE_CORNER radii from the ball's
    centre or farther: a sharp corner that no finger felt does not need another face.
    """
    wide = replace(ball, radius=2 * CUBE_CORNER * ball.radius)
    halfspaces = np.vstack([planes, unseen_halfspaces(points, wide, True)])
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

    At most RIGID_BODIES, or SOFT_BODIES, of most evidence first: the page decides.
    kept: a hypothesis of the first actions, if any, with any number of vertices;
    keep(hypotheses): is called with that of the actions done by Ctrl-C.
    At a deadline the body stays where it is after the actions done.
    Raises NoContactError where no touch is credible.
    """
    job = with_credible_touches(job)
    ways = []
    known = kept[0].compliance if kept else None
    for compliance, cost in compliances_of(job, known).items():
        rigid = as_of_rigid_fingertips(job, compliance)
        faces = [planes_on_body(rigid, kept[0])] if kept else []
        ways.append(Searched(rigid, faces, cost))
    ends = (1 + ends_of_actions(job.data)).tolist()
    ends = [last for last in ends if job.data.contact[:last].any()]
    try:
        with interruptible():
            for i, last in enumerate(progress(ends, "search")):
                faces = ways[0].faces
                if faces and last <= faces[0].x.shape[1]:
                    continue
                if faces and job.deadline.passed(f"{UNSEARCHED} {i + 1} on"):
                    break
                ways = [way.extended(last) for way in ways]
                ways.sort(key=lambda way: way.rank)
                if faces:  # the better half
                    ways = ways[: (len(ways) + 1) // 2]
            return _fitted(ways[0].job, ways[0].faces)
    except KeyboardInterrupt:
        keep([unfitted(job, one) for one in ways[0].faces[:1]])
        raise


class Searched(NamedTuple):
    """A search of planes, with fingertips of one compliance.

    job: of its data as of rigid fingertips; faces: those found, best first; cost
    [nats]: the prior of the compliance.
    """

    job: Job
    faces: list[Faces]
    cost: float

    @property
    def rank(self) -> float:
        """The objective to sort by."""
        return ranked(self.cost + self.faces[0].objective)

    def extended(self, samples: int) -> Searched:
        """Return the search for the first samples."""
        return self._replace(faces=extended_faces(self.job, self.faces, samples))


def _fitted(job, several: list[Faces]) -> list[Hypothesis]:
    """Return the bodies of planes, fitted if there is time; they stay at the end."""
    samples = job.data.samples
    part = replace(job, data=samples_until(job.data, several[0].x.shape[1]))
    if job.deadline.passed("a fit of the first polytope"):
        bodies = [unfitted(job, several[0])]
    else:
        hulls = [hull for faces in several for hull in hulls_from(job, faces)]
        count = RIGID_BODIES if job.reductions.rigid else SOFT_BODIES
        bodies = of_distinct_bodies(part, likeliest_fits(part, hulls))[:count]
    rest = [np.repeat(h.x[:, -1:], samples - h.x.shape[1], axis=1) for h in bodies]
    return [
        replace(h, x=np.hstack([h.x, stays]))
        for h, stays in zip(bodies, rest, strict=True)
    ]


def of_distinct_bodies(job, fits) -> list[Hypothesis]:
    """Return fits, the best first, of which no two with as many vertices are one body.

    At the end of any action; a closed one stands for both.
    """
    ends = ends_of_actions(job.data)
    chosen = []
    for count in sorted({h.theta.size for h in fits}):
        alike = [h for h in fits if h.theta.size == count]
        chosen += distinct(
            job.shape, alike, len(alike), np.inf, ends,
            key=lambda h: (not h.closed, h.rank),
        )  # fmt: skip
    return sorted(chosen, key=lambda h: h.rank)


def has_likely_count(job, h: Hypothesis) -> bool:
    """Tell whether evidence asks for no other number of vertices than a hypothesis has.

    That is, whether fits with as many are among the likeliest, by the planes that
    touches have on it.  job: of its samples.
    """
    if not job.shape.counts or job.deadline.passed("other numbers of vertices"):
        return True
    job = with_credible_touches(replace(job, reductions=Reductions()))
    job = as_of_rigid_fingertips(job, h.compliance)
    try:
        hulls = hulls_from(job, planes_on_body(job, h))
    except TactileError:  # planes of touches that noise moved close no body
        return True
    return any(fit.theta.size == h.theta.size for fit in likeliest_fits(job, hulls))


def hulls_from(job, faces: Faces) -> list[Hypothesis]:
    """Return the hulls of the planes seen so far, as hypotheses with many vertices.

    One is bounded by a ball on its untouched side; a second one has touched faces only,
    where planes and ground close it.
    """
    window = job.window_until(faces.x.shape[1])
    ground = job.scene.ground is not None
    planes, points = touched_halfspaces(window, faces)
    cuts = separating_halfspaces(window, faces, points)
    ball = unseen_ball(points, job.shape.size_prior, ground)
    unseen = unseen_halfspaces(points, ball, ground)
    theta = _cut(np.vstack([planes, unseen]), cuts).ravel()
    hull = Hypothesis(theta, faces.x, faces.objective, ("planes",))
    closing = closing_halfspaces(planes, points, ball) if ground else None
    if closing is None:
        return [hull]
    theta, path = _cut(closing, cuts).ravel(), (*hull.path, "closed")
    return [hull, replace(hull, theta=theta, path=path, closed=True)]


def unfitted(job, faces: Faces) -> Hypothesis:
    """Return the hull of the planes seen so far with as many vertices as asked for."""
    hull, *_ = hulls_from(job, faces)
    count = counts_of(job.shape)[0]
    (V,) = with_counts(hull.theta.reshape(-1, 3), [count])
    return replace(hull, theta=V.ravel())


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
    window = job.window_until(h.x.shape[1])
    centre = fingers_in_body(window.touch, h.x)
    point = nearest_points(h.theta.reshape(-1, 3), centre)
    n = centre - point
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    b, plane = (n * point).sum(axis=1), np.arange(len(n))
    return merged_faces(window, Faces(plane, n, b, h.x, objective=0.0))
