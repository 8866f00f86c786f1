"""Guess how a new action continues a hypothesis; nothing is solved to optimality.

The past is a Gaussian of size and last pose: it says how far a guess may change what
was known, and how the poses of the past follow.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations import quasi_static
from formulations.finger import SPHERE

from . import guess as guessing
from .fingertip import as_spheres
from .hypothesis import Hypothesis, Job
from .reduce import reduce
from .trial import posed, started

WEAK = {"motion weight": 100.0}  # [nats/m] a third of the page's: guesses stay put
KICKS = 2  # directions in which a hypothesis is least certain, tried both ways
FLIPPED = 0.3  # [rad] a turn beyond this carries the past along as one piece
STRAIGHT = 0.1  # [-] how readily an object turns that is pushed straight on
SPREAD = np.r_[0.02, 0.02, 0.02, 0.03, 0.03, 0.5]  # [m, rad] of guesses, at most
LEAST = np.r_[1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.03]  # [m, rad] of guesses, at least
ARM = np.r_[1, 1, 1, 1, 1, 20e-3]  # [m] makes a length of a turn
LOOSE = 1e-4  # [1 / scaled unknown^2] of a direction that nothing sees


def extensions(job: Job, kept: list[Hypothesis]) -> list[Hypothesis]:
    """Return unsolved hypotheses: guesses of how the last action continues each one."""
    if not kept:
        return first_touches(job)
    data, window = spherical(job)
    new = np.nonzero(data.action == data.action[-1])[0]
    earlier = job.data.select(np.unique(job.data.action)[:-1])
    proposed = []
    for h, P, along in _posteriors(replace(job, data=earlier), kept):
        end = h.end
        end[2] = guessing.height(h.seen(data), job.shape, end[2])
        guesses = [("on", end, 1.0), ("straight", end, STRAIGHT)]
        guesses += [(f"kick {i}", end + d, 1.0) for i, d in enumerate(_kicks(P))]
        n = len(h.theta)
        args = (h.seen(data), window, job.shape, end[:n], end[n:], data.action[-1])
        for name, theta, x in guessing.realigned(*args):
            guesses.append((name, np.r_[theta, x], 1.0))
        proposed += [(h, along, name, z, P, turning) for name, z, turning in guesses]
    hs, alongs, names, *guesses = zip(*proposed, strict=True)
    given = data, window, job.shape
    offsets = [np.broadcast_to(h.shift, (3, data.fingers)) for h in hs]
    guesses = [np.array(g) for g in guesses]
    z, tails = guessing.follow(*given, *guesses, new, np.array(offsets))
    ends = zip(hs, alongs, names, z, tails, strict=True)
    return [_continued(*end) for end in ends]


def spherical(job: Job):
    """Return data and window as if every fingertip were a sphere."""
    window = reduce(job.data, job.scene, job.shape, job.precision, job.reductions)
    return as_spheres(job.data, job.scene), replace(window, finger=SPHERE)


def _continued(h, along, name, end, tail) -> Hypothesis:
    """Return the hypothesis whose past was changed so that it ends at `end`."""
    n = len(h.theta)
    change = end - h.end
    if abs(change[-1]) > FLIPPED:
        past = guessing.carried(h.x, h.x[:, -1], end[n:])
    else:
        past = h.x + (along @ change).T
    x = np.hstack([past, tail])
    return replace(h, theta=end[:n], x=x, objective=np.inf, path=(*h.path, name))


def first_touches(job: Job) -> list[Hypothesis]:
    """Return the guesses of the first touch, at rest before it."""
    (data, window), shape = spherical(job), job.shape
    touches = (guessing.onsets(data, action) for action in np.unique(data.action))
    t, f = next(touch[0] for touch in touches if touch)
    guesses = job.first or guessing.first_guesses(data, shape, t, f)
    names, theta, x = zip(*guesses, strict=True)
    z = np.tile(np.hstack([theta, x]), (2, 1))
    names = [*names, *(f"{name} straight" for name in names)]
    turning = np.repeat([1.0, STRAIGHT], len(x))
    spread = np.tile(SPREAD, (len(z), 1))
    spread[:, shape.theta :] *= turning[:, None]
    P = spread[:, :, None] ** 2 * np.eye(len(SPREAD))
    new = range(t, len(data.time))
    z, tails = guessing.follow(data, window, shape, z, P, turning, new)
    out = []
    for name, end, tail in zip(names, z, tails, strict=True):
        theta, x = np.split(end, [shape.theta])
        path = np.hstack([np.repeat(x[:, None], t, axis=1), tail])
        out.append(Hypothesis(theta, path, np.inf, (name,)))
    return out


def _posteriors(job: Job, kept):
    """Return (hypothesis, P, along) by the curvature of least motion at each one.

    P (n + 3, n + 3): covariance of theta and last pose; along (T, 3, n + 3): how poses
    follow a change of these.
    """
    problem, window = posed(job, quasi_static)
    data, scale, out = problem.data(WEAK), problem.scale, []
    n, m = job.shape.theta, window.motion.unknowns
    theta, poses = (problem.variables[name].span for name in ("theta", "x"))
    end = np.r_[theta, poses.stop - m : poses.stop]
    for h in kept:
        x = problem.pack(started(problem, window, h))
        H = sum(problem.hessian(name, x, data) for name in problem.costs).toarray()
        values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
        vectors = vectors * scale[:, None]
        C = (vectors / np.maximum(np.abs(values), LOOSE)) @ vectors[end].T
        along = np.linalg.solve(C[end], C[poses].T).T.reshape(-1, m, n + m)[window.pose]
        shrink = np.minimum(1, SPREAD / np.sqrt(np.diag(C[end])))
        P = C[end] * np.outer(shrink, shrink) + np.diag(LEAST**2)
        out.append((h, P, along))
    return out


def _kicks(P) -> list[np.ndarray]:
    """Return changes of theta and pose by a deviation along the least certain ways."""
    values, vectors = np.linalg.eigh(P * np.outer(ARM, ARM))
    ways = (vectors * np.sqrt(values)).T[::-1][:KICKS] / ARM
    return [sign * way for way in ways for sign in (1, -1)]
