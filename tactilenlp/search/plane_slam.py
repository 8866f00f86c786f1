"""Poses of a polytope and the supporting planes of its touched faces, action by action.

Simultaneous localisation and mapping with several hypotheses: touches whose normals
stay constant in the body's frame, along a predicted path, are contact segments, each a
plane; segments that turn out to be one face become one plane (`polytope_planes` solves
for poses and planes).  Where a body may have gone in an action is predicted by
quasi-static pushing at the contacts that were felt, for drawn centres of mass.  Poses
are planar, in the frame of the ground.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations import polytope_planes

from ..data.contact_segments import NOISE_SIGMAS, contact_segments
from ..geometry.convex_hull import centre_of_shape
from ..geometry.transforms import directions_in_body, moved_origin, rotate_planar
from ..local.solved import search_settings
from ..problem.hypothesis import ranked
from ..problem.planes_window import felt_points, of_new_action, planes_window
from ..solvers.solve import solve_levels
from .predicted_motion import CENTRE, predicted_paths, with_motion, with_pushes

# Chosen on the first actions of six explored polytopes and on seven shared recordings:
HYPOTHESES = 2  # continued after an action, at most
PLANES_BEHIND = 6.0  # [nats] of these behind the best, at most
AGREED = 2  # paths that lead to the best optimum: no others are tried
TURN = 0.05  # [rad] by which paths differ
# [HYPOTHESES, AGREED, 1 / TURN] where the trajectory is doubtful: four of ten explored
# polytopes end 14 to 80 nats lower, with four times as many no lower
DOUBTFUL_PATHS = 2
FACE_ANGLE = 0.03  # [rad] normals of one face agree this well
FACE_OFFSET = 0.2e-3  # [m] and its offsets


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

    @property
    def rank(self) -> float:
        """The objective to sort by."""
        return ranked(self.objective)


def poses_of_new_action(job, faces: Faces) -> np.ndarray:
    """Return the poses x (3, T) of one more action, those of its past held."""
    samples, before = job.data.samples, faces.x[:, 0]
    best = extensions(job, job.window_until(samples), faces, samples)[0]
    # Back from the centre that was drawn to the body's origin:
    back = rotate_planar(-before[2], *(before - best.x[:, 0])[:2])
    return moved_origin(best.x, back)


def extensions(job, window, faces: Faces, samples: int) -> list[Faces]:
    """Return planes and poses of one more action, those of its past held, best first.

    They are solved from predicted paths, until AGREED of these lead to the best
    optimum.  Returned are optima whose turns differ.
    """
    fits, turn = [], TURN / job.search.drawn
    for path in predicted_paths(job, window, faces, samples):
        if fits and job.deadline.passed("other paths of an action"):
            break
        fits.append(_extension(job, window, faces, path))
        best = min(fits, key=lambda fit: fit.objective)
        alike = sum(turn_alike(fit, best, turn) for fit in fits)
        if alike == AGREED * job.search.drawn:
            break
    return of_distinct_turns(fits, turn)


def _extension(job, window, faces: Faces, path) -> Faces:
    """Return planes and poses of one more action from a predicted path."""
    faces = with_origin(faces, path.off)
    start = continued_faces(window, faces, path.x)
    window = with_motion(window, np.diff(path.x, axis=1, prepend=path.x[:, :1]))
    new = of_new_action(planes_window(window, start), faces.x, len(faces.b))
    problem = replace(job, page=polytope_planes).build(new)
    plane = problem.variables["plane"]
    held = plane.first + np.arange(plane.rows * len(faces.b))
    levels = [replace(level, fixed=(held,)) for level in polytope_planes.LEVELS]
    fit = faces_from(new, start, solution_from(job, problem, new, start, levels))
    return replace(fit, objective=faces.objective + fit.objective + path.cost)


def of_distinct_turns(fits, turn: float) -> list[Faces]:
    """Return fits of the same samples, best first, that turn by `turn` [rad] apart."""
    kept = []
    for fit in sorted(fits, key=lambda fit: fit.rank):
        if not any(turn_alike(fit, other, turn) for other in kept):
            kept.append(fit)
    return kept


def turn_alike(fit: Faces, other: Faces, turn: float) -> bool:
    """Tell whether two bodies turn alike, up to `turn` [rad], as of the last pose."""
    off = fit.x[2] - other.x[2]
    return bool(np.abs(off - off[-1]).max() < turn)


def solution_from(job, problem, window, faces: Faces, levels):
    """Return what the levels of the page find from `faces`."""
    start = {"x": faces.x[:, window.last], "plane": np.vstack([faces.n.T, faces.b])}
    return solve_levels(problem, levels, start, search_settings(job))


def solved_faces(job, window, faces: Faces, levels) -> Faces:
    """Return the planes and poses that the page finds from `faces`."""
    window = with_pushes(job, planes_window(window, faces), faces.x)
    problem = replace(job, page=polytope_planes).build(window)
    return faces_from(window, faces, solution_from(job, problem, window, faces, levels))


def faces_from(window, faces: Faces, solution) -> Faces:
    """Return planes and poses of a solution of the page that started from `faces`."""
    m, b = solution.values["plane"][:3].T, solution.values["plane"][3]
    n = m / np.linalg.norm(m, axis=1, keepdims=True)
    x = solution.values["x"][:, window.pose]
    return replace(faces, n=n, b=b, x=x, objective=solution.objective)


def merged_faces(window, faces: Faces) -> Faces:
    """Return the planes with those of one face merged."""
    n, b, plane = faces.n, faces.b, faces.plane
    point = felt_points(window.touch, faces.x, n[plane])
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


def extended_faces(job, kept: list[Faces], samples: int) -> list[Faces]:
    """Return planes and poses for the first `samples` samples of a job, the best first.

    kept: those of the actions before, each of which is continued; none: from the first
    touch.  At most HYPOTHESES whose turns differ, at most PLANES_BEHIND the best.
    """
    window = job.window_until(samples)
    if kept:
        starts = [x for one in kept for x in extensions(job, window, one, samples)]
        starts = [merged_faces(window, start) for start in best_of(job, starts)]
        ways = [(start, 0.0) for start in starts]
    else:
        ways = [
            (Faces(*as_measured(window, window.touch, path.x), path.x), path.cost)
            for path in predicted_paths(job, window, None, samples)
        ]
    fits = []
    for start, cost in ways:
        if fits and job.deadline.passed("other paths of an action"):
            break
        fit = solved_faces(job, window, start, polytope_planes.LEVELS)
        fits.append(replace(fit, objective=fit.objective + cost))
    joined = [_joined(job, window, fit) for fit in best_of(job, fits)]
    return sorted(joined, key=lambda fit: fit.rank)


def best_of(job, fits) -> list[Faces]:
    """Return the best HYPOTHESES whose turns differ, at most PLANES_BEHIND the best."""
    drawn = job.search.drawn
    best = of_distinct_turns(fits, TURN / drawn)[: HYPOTHESES * drawn]
    return [fit for fit in best if fit.objective <= best[0].objective + PLANES_BEHIND]


def _joined(job, window, fitted: Faces) -> Faces:
    """Return the planes with those of one face joined, the body's origin centred."""
    joined = merged_faces(window, fitted)
    if joined is not fitted:
        fitted = solved_faces(job, window, joined, polytope_planes.LEVELS[1:])
    return centred(window, fitted, job.shape.size_prior, job.scene.ground is not None)


def continued_faces(window, faces: Faces, x) -> Faces:
    """Return the planes with those of a new action as measured, of a path x (3, T)."""
    touch, before = window.touch, faces.x.shape[1]
    new = touch.sample >= before
    own, n, b = as_measured(window, touch.pick(new), x)
    plane = np.zeros(len(touch), int)
    plane[~new], plane[new] = faces.plane, len(faces.b) + own
    return replace(
        faces, plane=plane, n=np.vstack([faces.n, n]), b=np.r_[faces.b, b], x=x
    )


def as_measured(window, touch, x) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the planes of touches at poses x, one for each segment: plane, n, b."""
    normal = directions_in_body(x, touch.sample, touch.normal)
    plane = contact_segments(replace(touch, normal=normal), window.sigma_normal)
    count = np.bincount(plane)
    n = np.stack([np.bincount(plane, normal[:, k]) for k in range(3)], 1)
    n = n / np.linalg.norm(n, axis=1, keepdims=True)
    point = felt_points(touch, x, n[plane])
    b = np.bincount(plane, (point * n[plane]).sum(axis=1)) / count
    return plane, n, b


def with_origin(faces: Faces, d) -> Faces:
    """Return the same body with its origin at d (2,) [m] of its frame."""
    b = faces.b - faces.n[:, :2] @ d
    return replace(faces, x=moved_origin(faces.x, d), b=b)


def centred(window, faces: Faces, size, ground) -> Faces:
    """Return the same motion with the body's origin below its likely centre of mass.

    The product of two Gaussian densities: about the centre for which its motion was
    predicted, the origin so far, and about that of its shape.  How far these are apart
    is part of the objective.  Without a ground no motion is predicted.
    """
    mean, P = centre_of_shape(*touched_halfspaces(window, faces), size, ground)
    if not ground:
        return with_origin(faces, mean)
    predicted = (CENTRE * size[0]) ** 2 * np.eye(2)
    weighted = np.linalg.solve(predicted + P, mean)
    faces = replace(faces, objective=faces.objective + mean @ weighted / 2)
    return with_origin(faces, predicted @ weighted)


def touched_halfspaces(window, faces: Faces) -> tuple[np.ndarray, np.ndarray]:
    """Return the half-spaces (planes, 4) that hold all touched points, and these."""
    n = faces.n
    points = felt_points(window.touch, faces.x, n[faces.plane])
    return np.c_[n, np.maximum(faces.b, (points @ n.T).max(axis=0))], points
