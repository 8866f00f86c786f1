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
from .past import Past, summarise
from .reduce import reduce
from .trial import posed

WEAK = {"motion weight": 100.0}  # [nats/m] a third of the page's: guesses stay put
KICKS = 2  # directions in which a hypothesis is least certain, tried both ways
FLIPPED = 0.3  # [rad] a turn beyond this carries the past along as one piece
STRAIGHT = 0.1  # [-] how readily an object turns that is pushed straight on
SPREAD = np.r_[0.02, 0.02, 0.02, 0.03, 0.03, 0.5]  # [m, rad] of guesses, at most
LEAST = np.r_[1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.03]  # [m, rad] of guesses, at least
ARM = np.r_[1, 1, 1, 1, 1, 20e-3]  # [m] makes a length of a turn


def before(job: Job) -> Job:
    """Return the job without its last action."""
    earlier = np.unique(job.data.action)[:-1]
    return replace(job, data=job.data.select(earlier))


def pasts_of(job: Job, kept, page=None) -> list[tuple[Past, bool]]:
    """Return the Gaussian at each hypothesis of a job, and whether a page made it.

    A page's where it was solved here, else that of least motion.
    """
    weak, out = posed(job, quasi_static), []
    full = weak
    if page is not None and any(h.unknowns for h in kept):
        full = posed(job, page, (kept[0].theta, kept[0].x))
    for h in kept:
        solved = page is not None and h.fits(full[0])
        problem, window = full if solved else weak
        h = (
            h
            if solved
            else replace(h, unknowns={}, multipliers={}, bound_multipliers={})
        )
        values = {**h.unknowns, "theta": h.theta, "x": h.x[:, window.last]}
        data = problem.data({} if solved else WEAK)
        out.append((summarise(problem, window.knot, h, values, data), solved))
    return out


def extensions(job: Job, kept: list[Hypothesis]) -> list[Hypothesis]:
    """Return unsolved hypotheses: guesses of how the last action continues each one."""
    if not kept:
        return first_touches(job)
    pasts = [past for past, _ in pasts_of(before(job), kept)]
    return [h for _, h in continuations(job, kept, pasts)]


def continuations(job: Job, kept, pasts) -> list[tuple[int, Hypothesis]]:
    """Return (which of kept, guess of how the last action continues it)."""
    data, window = _spherical(job)
    new = np.nonzero(data.action == data.action[-1])[0]
    proposed = []
    for k, (h, past) in enumerate(zip(kept, pasts, strict=True)):
        P, along = _posterior(past, len(h.theta))
        end = h.end
        end[2] = guessing.height(data, job.shape, end[2])
        guesses = [("on", end, 1.0), ("straight", end, STRAIGHT)]
        guesses += [(f"kick {i}", end + d, 1.0) for i, d in enumerate(_kicks(P))]
        n = len(h.theta)
        args = (data, window, job.shape, end[:n], end[n:], data.action[-1])
        for name, theta, x in guessing.realigned(*args):
            guesses.append((name, np.r_[theta, x], 1.0))
        proposed += [(k, along, name, z, P, turning) for name, z, turning in guesses]
    ks, alongs, names, *guesses = zip(*proposed, strict=True)
    given = data, window, job.shape
    z, tails = guessing.follow(*given, *(np.array(g) for g in guesses), new)
    ends = zip(ks, alongs, names, z, tails, strict=True)
    return [(k, _continued(kept[k], *end)) for k, *end in ends]


def _spherical(job: Job):
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
    return Hypothesis(end[:n], np.hstack([past, tail]), np.inf, (*h.path, name))


def first_touches(job: Job) -> list[Hypothesis]:
    """Return the guesses of the first touch, at rest before it."""
    (data, window), shape = _spherical(job), job.shape
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


def _posterior(past: Past, n: int):
    """Return P (n + 3, n + 3) of theta and last pose, and along (T, 3, n + 3).

    P: how far a guess may be off; along: how poses follow a change of these.
    """
    chosen = np.r_[past.rows("theta"), past.rows("x")]
    C = past.covariance[np.ix_(chosen, chosen)]
    gain = np.linalg.solve(C, past.covariance[chosen]).T  # numbers of the body follow
    along = past.along["x"].transpose(1, 0, 2)[past.knot] @ gain
    shrink = np.minimum(1, SPREAD / np.sqrt(np.diag(C)))
    return C * np.outer(shrink, shrink) + np.diag(LEAST**2), along


def _kicks(P) -> list[np.ndarray]:
    """Return changes of theta and pose by a deviation along the least certain ways."""
    values, vectors = np.linalg.eigh(P * np.outer(ARM, ARM))
    ways = (vectors * np.sqrt(values)).T[::-1][:KICKS] / ARM
    return [sign * way for way in ways for sign in (1, -1)]
