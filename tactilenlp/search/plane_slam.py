"""Poses of a polytope and the supporting planes of its touched faces, action by action.

Simultaneous localisation and mapping: touches whose normals stay constant are contact
segments, each a plane; segments that turn out to be one face become one plane
(`polytope_planes` solves for poses and planes).  Poses are planar, in the frame of the
ground.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations import polytope_planes

from ..data.contact_segments import NOISE_SIGMAS, contact_segments, samples_until
from ..geometry.convex_hull import (
    CENTRE_HEIGHT,
    FLOATING_HEIGHT,
    Ball,
    centroid,
    fingers_in_body,
    fitted_ball,
    vertices_behind,
)
from ..geometry.transforms import directions_in_body, rotate_planar
from ..problem.reductions import reduce
from ..problem.window import Rows, Window
from ..solvers.solve import solve_levels
from .solved import search_settings

FREE_REACH = 15e-3  # [m] free fingers further from a contact point are left out
FACE_ANGLE = 0.03  # [rad] normals of one face agree this well
FACE_OFFSET = 0.2e-3  # [m] and its offsets


@dataclass(frozen=True, eq=False)
class Pairs(Rows):
    """Touches and planes that they lie behind."""

    touch: np.ndarray
    plane: np.ndarray


@dataclass(frozen=True, eq=False)
class Outside(Rows):
    """Touches whose contact point is outside a free finger at p_wf; pose: its index."""

    touch: np.ndarray
    pose: np.ndarray
    p_wf: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True, eq=False)
class PlanesWindow(Window):
    """A window, and which touch lies on which plane.

    plane: (touches,) of each touch; planes: how many; slip (n, 2): successive touches
    of a finger; link (m, 2): their planes, where they are not one already; lower,
    upper: (3, poses) bounds that hold the last pose.
    """

    plane: np.ndarray = None
    planes: int = 0
    slip: np.ndarray = None
    link: np.ndarray = None
    behind: Pairs = None
    outside: Outside = None
    lower: np.ndarray = None
    upper: np.ndarray = None


@dataclass(frozen=True, eq=False)
class Faces:
    """Planes seen so far: of each touch (touches,), n (planes, 3) outward, b (planes,).

    x (3, T): poses of the body, the last one as in the world.
    """

    plane: np.ndarray
    n: np.ndarray
    b: np.ndarray
    x: np.ndarray
    objective: float = np.inf
    iterations: int = 0


def contact_points(touch, x, n) -> np.ndarray:
    """Return contact points (touches, 3) [m] in the body frame at poses x (3, T).

    n (touches, 3): normals in that frame.
    """
    return fingers_in_body(touch, x) - touch.radius[:, None] * n


def planes_window(window, faces: Faces) -> PlanesWindow:
    """Return the window with the pairs of touches, planes and free fingers."""
    plane, touch = faces.plane, window.touch
    order = np.lexsort((touch.sample, touch.finger))
    near = touch.sample[order[1:]] - touch.sample[order[:-1]] == 1
    near &= touch.finger[order[1:]] == touch.finger[order[:-1]]
    slip = np.stack([order[1:], order[:-1]], 1)[near]
    link = np.unique(np.sort(plane[slip], axis=1), axis=0)
    link = link[link[:, 0] != link[:, 1]]
    same = near & (plane[order[1:]] == plane[order[:-1]])
    ends = order[~(np.r_[False, same] & np.r_[same, False])]
    i, j = np.meshgrid(ends, np.arange(len(faces.b)), indexing="ij")
    other = plane[i] != j
    point = contact_points(touch, faces.x, faces.n[plane])
    free = window.free
    centre = fingers_in_body(free, faces.x)
    apart = np.linalg.norm(point[ends][:, None] - centre[None], axis=2)
    a, f = np.nonzero(apart < free.radius + FREE_REACH)
    lower, upper = window.holding(faces.x, [-1])
    return PlanesWindow(
        **vars(window), plane=plane, planes=len(faces.b), slip=slip, link=link,
        behind=Pairs(i[other], j[other]),
        outside=Outside(ends[a], free.pose[f], free.p_wf[f], free.radius[f]),
        lower=lower, upper=upper,
    )  # fmt: skip


def of_new_action(window: PlanesWindow, x, planes: int) -> PlanesWindow:
    """Return what a new action adds to the pairs of a past with poses x (3, T)."""
    past, touch = x.shape[1], window.touch
    new, first = touch.sample >= past, window.pose[past]
    behind, outside = window.behind, window.outside
    lower, upper = window.holding(x, slice(first))
    return replace(
        window, lower=lower, upper=upper,
        slip=window.slip[new[window.slip].any(axis=1)],
        link=window.link[(window.link >= planes).any(axis=1)],
        behind=behind.pick(new[behind.touch] | (behind.plane >= planes)),
        outside=outside.pick(new[outside.touch] | (outside.pose >= first)),
        **window.of_later_steps(past),
    )  # fmt: skip


def poses_of_new_action(job, faces: Faces) -> np.ndarray:
    """Return the poses x (3, T) of one more action, those of its past held."""
    window = reduce(job.data, job.scene, job.shape, job.precision, job.reductions)
    start, planes = continued_faces(window, faces, job.data.samples), len(faces.b)
    window = of_new_action(planes_window(window, start), faces.x, planes)
    problem = replace(job, page=polytope_planes).build(window)
    plane = problem.variables["plane"]
    held = plane.first + np.arange(plane.rows * planes)
    levels = [replace(level, fixed=(held,)) for level in polytope_planes.LEVELS]
    s = solution_from(job, problem, window, start, levels)
    return s.values["x"][:, window.pose]


def solution_from(job, problem, window, faces: Faces, levels):
    """Return what the levels of the page find from `faces`."""
    start = {"x": faces.x[:, window.last], "plane": np.vstack([faces.n.T, faces.b])}
    return solve_levels(problem, levels, start, search_settings(job))


def solved_faces(job, window, faces: Faces, levels) -> Faces:
    """Return the planes and poses that the page finds from `faces`."""
    window = planes_window(window, faces)
    problem = replace(job, page=polytope_planes).build(window)
    s = solution_from(job, problem, window, faces, levels)
    m, b = s.values["plane"][:3].T, s.values["plane"][3]
    n = m / np.linalg.norm(m, axis=1, keepdims=True)
    x = s.values["x"][:, window.pose]
    iterations = faces.iterations + s.iterations
    return replace(faces, n=n, b=b, x=x, objective=s.objective, iterations=iterations)


def merged_faces(window, faces: Faces) -> Faces:
    """Return the planes with those of one face merged."""
    n, b, plane = faces.n, faces.b, faces.plane
    point = contact_points(window.touch, faces.x, n[plane])
    label = np.arange(len(b))
    off = np.abs(point @ n.T - b)  # (touches, planes)
    worst = np.array([off[plane == i].max(axis=0) for i in label])
    agree = np.maximum(worst, worst.T) < np.hypot(FACE_OFFSET, window.sigma_position)
    count = np.bincount(plane, minlength=len(b))
    doubt = NOISE_SIGMAS * window.sigma_normal * np.sqrt(1 / count + 1 / count[:, None])
    agree &= n @ n.T > np.cos(np.minimum(np.hypot(FACE_ANGLE, doubt), np.pi / 2))
    for i, j in zip(*np.nonzero(np.triu(agree, 1)), strict=True):
        if agree[np.ix_(label == label[i], label == label[j])].all():
            label[label == label[j]] = label[i]
    kept, label = np.unique(label, return_inverse=True)
    if len(kept) == len(b):
        return faces
    count = count.astype(float)
    weight = np.bincount(label, count)
    mean = np.stack([np.bincount(label, count * n[:, k]) for k in range(3)], 1)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    b = np.bincount(label, count * b) / weight
    return replace(faces, plane=label[plane], n=mean, b=b)


def extended_faces(job, faces: Faces | None, samples: int) -> Faces:
    """Return the planes and poses for the first `samples` samples of a job."""
    data = samples_until(job.data, samples)
    window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
    start = (
        first_faces(window, samples, job.shape.size_prior[0])
        if faces is None
        else continued_faces(window, faces, samples)
    )
    fitted = solved_faces(job, window, start, polytope_planes.LEVELS)
    joined = merged_faces(window, fitted)
    if joined is not fitted:
        fitted = solved_faces(job, window, joined, polytope_planes.LEVELS[1:])
    return centred(window, fitted, job.shape.size_prior, job.scene.ground is not None)


def first_faces(window, samples: int, size: float) -> Faces:
    """Return the planes of the first touches as measured, the body at rest.

    It is behind the first touch by a typical size [m].
    """
    x, touch = np.zeros((3, samples)), window.touch
    behind = (touch.radius[0] + size) * touch.normal[0, :2]
    x[:2] = (touch.p_wf[0, :2] - behind)[:, None]
    return Faces(*as_measured(window, touch, x), x)


def continued_faces(window, faces: Faces, samples: int) -> Faces:
    """Return the planes with those of a new action as measured, the body at rest."""
    touch, before = window.touch, faces.x.shape[1]
    x = np.hstack([faces.x, np.repeat(faces.x[:, -1:], samples - before, axis=1)])
    new = touch.sample >= before
    own, n, b = as_measured(window, touch.pick(new), x)
    plane = np.zeros(len(touch), int)
    plane[~new], plane[new] = faces.plane, len(faces.b) + own
    return replace(
        faces, plane=plane, n=np.vstack([faces.n, n]), b=np.r_[faces.b, b], x=x
    )


def as_measured(window, touch, x) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the planes of touches at poses x, one for each segment: plane, n, b."""
    plane = contact_segments(touch, window.sigma_normal)
    normal = directions_in_body(x, touch.sample, touch.normal)
    count = np.bincount(plane)
    n = np.stack([np.bincount(plane, normal[:, k]) for k in range(3)], 1)
    n = n / np.linalg.norm(n, axis=1, keepdims=True)
    point = contact_points(touch, x, n[plane])
    b = np.bincount(plane, (point * n[plane]).sum(axis=1)) / count
    return plane, n, b


def centred(window, faces: Faces, size, ground) -> Faces:
    """Return the same motion with the body's origin below its centroid."""
    planes, points = touched_halfspaces(window, faces)
    unseen = unseen_halfspaces(points, unseen_ball(points, size, ground), ground)
    shift = centroid(vertices_behind(np.vstack([planes, unseen])))[:2]
    x = faces.x.copy()
    x[:2] += rotate_planar(x[2], *shift)
    return replace(faces, x=x, b=faces.b - faces.n[:, :2] @ shift)


def touched_halfspaces(window, faces: Faces) -> tuple[np.ndarray, np.ndarray]:
    """Return the half-spaces (planes, 4) that hold all touched points, and these."""
    n = faces.n
    points = contact_points(window.touch, faces.x, n[faces.plane])
    return np.c_[n, np.maximum(faces.b, (points @ n.T).max(axis=0))], points


def unseen_halfspaces(points, ball: Ball, ground) -> np.ndarray:
    """Return half-spaces (n, 4) of the untouched side: a ball, and the ground if any.

    points (k, 3) [m]: where the body was touched.
    """
    caps = ball.caps(points)
    return np.vstack([[[0, 0, -1, 0]], caps]) if ground else caps


def unseen_ball(points, size, ground) -> Ball:
    """Return the ball that stands for the untouched side of the body."""
    return fitted_ball(points, size, CENTRE_HEIGHT if ground else FLOATING_HEIGHT)
