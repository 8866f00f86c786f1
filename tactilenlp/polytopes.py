"""Search for a convex polytope, and show a page what it needs of one.

Planes and poses first, action by action (planes.py), then a body carved out of the
planes (carving.py), then its vertices polished with least motion: a hypothesis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import polytope_quasi_static

from .carving import carved
from .errors import NoContactError, SceneError
from .hull import filled, outer
from .hull_window import indexed, standing, without_clear
from .hypothesis import Hypothesis
from .interrupt import interruptible
from .nlp import Problem
from .planes import Faces, extended, seen
from .progress import progress
from .reduce import reduce
from .runs import credible
from .solve import SolverOptions, solve_levels

TOLERANCE = 1e-4
CREEPING = {  # IPOPT stops where kinks of the surface let it creep on and on
    "acceptable_tol": 0.5,  # [nats / mm]
    "acceptable_obj_change_tol": 1e-4,  # [relative] over as many iterations
    "acceptable_iter": 5,
    "acceptable_compl_inf_tol": 1e-2,
    "acceptable_constr_viol_tol": 1e-4,
}
CLOSED = "closed"  # the path of a body with no faces but those that were felt
LONGEST = 20.0  # [s] of one solve
ENOUGH = 40  # iterations of a level that only starts another page


def is_polytope(shape) -> bool:
    """Tell whether a shape is a hull of vertices."""
    return shape.name == "polytope"


def check(scene) -> None:
    """Raise SceneError unless the fingertips are round."""
    if scene.finger_length > 0:
        raise SceneError(
            "a polytope is estimated with round fingertips only",
            where="finger_length", got=scene.finger_length, expected="0",
        )  # fmt: skip


def window_of(job, guess=None, resting=None):
    """Return the window that a page reads, and the shape as the page takes it.

    guess: theta and x, where a page starts.  resting: theta as which a hull carries its
    weight where it rests, by default that of the guess.
    """
    known = job.scene, job.shape, job.precision, job.reductions
    if guess is None or not is_polytope(job.shape):
        return reduce(job.data, *known, guess=guess, cuts=job.cuts), job.shape
    theta, x = guess
    vertices = np.reshape(theta, (-1, 3))
    shape = standing(job.shape, vertices)
    known = job.scene, shape, job.precision, job.reductions
    window = reduce(job.data, *known, guess=guess, cuts=job.cuts)
    if job.reductions.far:
        window = without_clear(window, vertices, x)
    resting = vertices if resting is None else np.reshape(resting, (-1, 3))
    ground = job.scene.ground is not None
    return indexed(window, shape, vertices, x, ground, resting), shape


def reseeded(h: Hypothesis) -> Hypothesis:
    """Return a hull whose invisible vertices, those inside of it, are moved onto it."""
    vertices = h.theta.reshape(-1, 3)
    onto = filled(outer(vertices), len(vertices))
    return replace(h, theta=onto.ravel())


def search(job, kept, so_far=None) -> list[Hypothesis]:
    """Return the hypothesis that explains all actions of a job, with least motion.

    And one of a body that has no faces but those that were felt, if they close one.
    kept: a hypothesis of the first actions, if any, with any number of vertices.
    so_far: a list in which Ctrl-C leaves that of the actions done by then.
    """
    job = replace(job, data=backed(job.data, job.precision.normal))
    faces = [resumed(job, kept[0])] if kept else []
    try:
        with interruptible():
            for last in progress(_ends(job.data), "search"):
                if not kept or last > kept[0].x.shape[1]:
                    faces[:] = [extended(job, faces[0] if faces else None, last)]
            return [polished(job, body) for body in bodies_of(job, faces[0])]
    except KeyboardInterrupt:
        if so_far is not None:
            so_far[:] = [bodies_of(job, one)[0] for one in faces]
        raise


def _ends(data) -> list[int]:
    """Return the samples up to each action, from the first in which one is felt."""
    ends = [
        int(np.nonzero(data.action == a)[0][-1]) + 1 for a in np.unique(data.action)
    ]
    return [last for last in ends if (data.contact & data.valid)[:last].any()]


def bodies_of(job, faces: Faces) -> list[Hypothesis]:
    """Return the body that planes of the first samples carve out, where they saw it.

    And one without any face that nothing felt, where planes and ground close it.
    """
    data = job.data.select(np.unique(job.data.action[: faces.x.shape[1]]))
    window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
    ground = job.scene.ground is not None
    given = window, faces, job.shape.size_prior, job.shape.theta // 3, ground
    found = {("planes",): carved(*given)}
    if ground:
        found["planes", CLOSED] = carved(*given, ball=False)
    return [
        Hypothesis(V.ravel(), faces.x, faces.objective, path, faces.iterations)
        for path, V in found.items() if V is not None
    ]  # fmt: skip


def polished(job, body: Hypothesis) -> Hypothesis:
    """Return the carved body with vertices and poses that fit what was felt."""
    window, shape = window_of(job, (body.theta, body.x))
    problem = Problem(kinds=job.kinds_of(polytope_quasi_static, window))
    polytope_quasi_static.build(problem, window, job.scene, shape)
    options = SolverOptions(tolerance=TOLERANCE, time_limit=LONGEST)
    start = {"theta": body.theta.reshape(-1, 3).T, "x": body.x[:, window.last]}
    levels = [k.with_ipopt(max_iter=ENOUGH) for k in polytope_quasi_static.LEVELS]
    s = solve_levels(problem, levels, start, options)
    theta, x = s.values["theta"].T.ravel(), s.values["x"][:, window.pose]
    iterations = body.iterations + s.iterations
    return Hypothesis(theta, x, s.objective, body.path, iterations)


def backed(data, sigma: float):
    """Return the data less what stands alone; NoContactError where nothing is left."""
    left = credible(data, sigma)
    if (left.contact & left.valid).any():
        return left
    raise NoContactError(
        "no touch is backed by its neighbours",
        where="normal",
        got=f"{int((data.contact & data.valid).sum())} touches, none like another",
        expected="a finger that feels about one normal for two samples or more",
        next="check the frame of the normals, or record a touch that lasts",
    )


def resumed(job, h: Hypothesis) -> Faces:
    """Return the planes that the touches of the first actions have on a known body."""
    data = job.data.select(np.unique(job.data.action[: h.x.shape[1]]))
    window = reduce(data, job.scene, job.shape, job.precision, job.reductions)
    return seen(window, h.theta.reshape(-1, 3), h.x)
