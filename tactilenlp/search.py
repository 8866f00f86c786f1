"""The beam: extends, solves, ranks and keeps hypotheses action by action.

A hypothesis is one local optimum: which face was touched, which way the object is
turned, how it was pushed.  Each new action extends every hypothesis kept by a few
guesses; the most promising are solved by the quasi-static page, and the best distinct
ones are kept.  Least motion drags a touch to the nearest edge, so it proposes well and
ranks badly: where a page with physics is given, that ranks the first ones (`rank`).
"""

from __future__ import annotations

import importlib
import os
import time
from dataclasses import dataclass, replace

import numpy as np

from formulations import quasi_static
from formulations.finger import SPHERE

from . import guess as guessing
from .fingertip import as_spheres
from .nlp import Problem
from .reduce import reduce
from .solve import SolverOptions, solve_levels

TOLERANCE = 1e-4  # of the search's solves; the page that follows is solved tighter
ROUGH = 1e-3  # of a page's solves that only rank
COARSE = 40.0  # [nats] a start that costs less than this skips the coarse level
WEAK = {"motion weight": 100.0}  # [nats/m] a third of the page's: guesses stay put
SAME = 1e-3  # [m] hypotheses whose corners agree this well are one
HOPELESS = 60.0  # [nats] behind the best start or hypothesis: not followed up
RIVAL = 15.0  # [nats] of least motion behind the best: physics is not asked
BEHIND = 30.0  # [nats] of physics behind the best: dropped
RELAXED = 0.1  # IPOPT's first mu where a page is solved from poses that are guessed
OPEN = 60  # iterations of a page's opened level
LONGEST = 60.0  # [s] of one solve
RANKED = 2  # actions after which a page ranks
EARLY = 2  # actions in which sizes are free: twice as many hypotheses
KICKS = 2  # directions in which a hypothesis is least certain, tried both ways
FLIPPED = 0.3  # [rad] a turn beyond this carries the past along as one piece
STRAIGHT = 0.1  # [-] how readily an object turns that is pushed straight on
SPREAD = np.r_[0.02, 0.02, 0.02, 0.03, 0.03, 0.5]  # [m, rad] of guesses, at most
LEAST = np.r_[1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.03]  # [m, rad] of guesses, at least
ARM = np.r_[1, 1, 1, 1, 1, 20e-3]  # [m] makes a length of a turn


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One local optimum: theta (n,) [m], x (3, T) planar poses, objective [nats].

    path: the guess it came from, one word an action.
    """

    theta: np.ndarray
    x: np.ndarray
    objective: float
    path: tuple[str, ...]
    iterations: int = 0

    @property
    def end(self) -> np.ndarray:
        """Theta and the last pose (n + 3,)."""
        return np.r_[self.theta, self.x[:, -1]]

    def at(self, samples: int) -> Hypothesis:
        """Return the hypothesis of the first samples only."""
        return replace(self, x=self.x[:, :samples])


@dataclass(frozen=True, eq=False)
class Job:
    """What a solve needs to know, picklable: the data so far and how to read them."""

    data: object
    scene: object
    shape: object
    precision: object
    reductions: object
    deadline: float
    first: tuple = ()  # (name, theta, x) guesses of the first touch, if a user has some
    cuts: tuple = ()  # samples within still spans that need a pose of their own


def beam(job: Job, kept, width: int, solves: int, executor=None, page=None):
    """Return the best distinct hypotheses for all actions of a job, by least motion.

    kept: hypotheses of the first actions to carry on, if any; page: ranks those of
    the first RANKED actions, while its problem is small.  `width` are kept,
    twice as many in the first actions, and guesses that least motion has not moved.
    """
    done = kept[0].x.shape[1] if kept else 0
    for i, action in enumerate(np.unique(job.data.action)):
        last = int(np.nonzero(job.data.action == action)[0][-1]) + 1
        if last <= done or not (job.data.contact & job.data.valid)[:last].any():
            continue
        part = replace(job, data=job.data.select(np.unique(job.data.action[:last])))
        more = 2 if i < EARLY else 1
        starts = _most_promising(part, extensions(part, kept), solves * more)
        if time.monotonic() > job.deadline:  # what is left is guessed, not solved
            kept = starts[:width]
            continue
        found = _solve_all(_solve_chunk, part, starts, executor)
        found += starts if i < EARLY else []
        kept = distinct(job.shape, found, width * more)
        kept += starts[:1] if i >= EARLY else []
        if page is not None and i < RANKED and last < len(job.data.time):
            kept = rank(part, page, kept, width, executor)
    return kept


def rank(job, page, kept, width, executor=None) -> list[Hypothesis]:
    """Return the best distinct hypotheses by a page's first levels, solved roughly."""
    limit = min(h.objective for h in kept) + RIVAL
    rivals = [h for h in kept if h.objective <= limit]
    if executor is not None:
        page = page.__name__  # a module travels by its name
    found = _solve_all(_rank_chunk, job, rivals, executor, page)
    return distinct(job.shape, found, width, BEHIND)


def opened(levels, final: bool):
    """Return levels to solve from guessed poses: nothing fixed, a large first mu."""
    first = [
        replace(level, fixed=(), barrier=max(RELAXED, level.barrier), iterations=OPEN)
        for level in levels
        if level.fixed
    ]
    rest = [level for level in levels if not level.fixed]
    return [*first, *rest] if final or not first else first


def _rank_chunk(job: Job, kept, page) -> list[Hypothesis]:
    page = importlib.import_module(page) if isinstance(page, str) else page
    problem, window = _problem(job, page, (kept[0].theta, kept[0].x))
    levels, solvers = opened(page.LEVELS, final=False), {}
    return [_solved(job, problem, window, levels, h, ROUGH, solvers) for h in kept]


def extensions(job: Job, kept: list[Hypothesis]) -> list[Hypothesis]:
    """Return unsolved hypotheses: guesses of how the last action continues each one."""
    data = as_spheres(job.data, job.scene)
    window = reduce(job.data, job.scene, job.shape, job.precision, job.reductions)
    window = replace(window, finger=SPHERE)
    if not kept:
        return _first(replace(job, data=data), window)
    new = np.nonzero(data.action == data.action[-1])[0]
    old = replace(job, data=job.data.select(np.unique(data.action[: new[0]])))
    proposed = []
    for h, P, along in _posteriors(old, kept):
        end = h.end
        end[2] = guessing.height(data, job.shape, end[2])
        guesses = [("on", end, 1.0), ("straight", end, STRAIGHT)]
        guesses += [(f"kick {i}", end + d, 1.0) for i, d in enumerate(_kicks(P))]
        n = len(h.theta)
        args = (data, window, job.shape, end[:n], end[n:], data.action[-1])
        for name, theta, x in guessing.realigned(*args):
            guesses.append((name, np.r_[theta, x], 1.0))
        proposed += [(h, along, name, z, P, turning) for name, z, turning in guesses]
    hs, alongs, names, *guesses = zip(*proposed, strict=True)
    given = data, window, job.shape
    z, tails = guessing.follow(*given, *(np.array(g) for g in guesses), new)
    ends = zip(hs, alongs, names, z, tails, strict=True)
    return [_continued(*end) for end in ends]


def _continued(h, along, name, end, tail) -> Hypothesis:
    """Return the hypothesis whose past was changed so that it ends at `end`."""
    n = len(h.theta)
    change = end - h.end
    if abs(change[-1]) > FLIPPED:
        past = guessing.carried(h.x, h.x[:, -1], end[n:])
    else:
        past = h.x + (along @ change).T
    return Hypothesis(end[:n], np.hstack([past, tail]), np.inf, (*h.path, name))


def _first(job: Job, window) -> list[Hypothesis]:
    """Return the guesses of the first touch, at rest before it."""
    data, shape = job.data, job.shape
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
    """Return (hypothesis, P, along) by the curvature at each hypothesis.

    P (n + 3, n + 3): covariance of theta and last pose; along (T, 3, n + 3): how poses
    follow a change of these.
    """
    problem, window = _problem(job, quasi_static)
    data, scale, out = problem.data(WEAK), problem.scale, []
    n, m = job.shape.theta, window.motion.unknowns
    end = np.r_[:n, problem.size - m : problem.size]
    for h in kept:
        x = problem.pack({"theta": h.theta, "x": h.x[:, window.last]})
        H = sum(problem.hessian(name, x, data) for name in problem.costs).toarray()
        values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
        vectors = vectors * scale[:, None]
        C = (vectors / np.maximum(np.abs(values), 1e-4)) @ vectors[end].T
        along = np.linalg.solve(C[end], C[n:].T).T.reshape(-1, m, n + m)[window.knot]
        shrink = np.minimum(1, SPREAD / np.sqrt(np.diag(C[end])))
        P = C[end] * np.outer(shrink, shrink) + np.diag(LEAST**2)
        out.append((h, P, along))
    return out


def _kicks(P) -> list[np.ndarray]:
    """Return changes of theta and pose by a deviation along the least certain ways."""
    values, vectors = np.linalg.eigh(P * np.outer(ARM, ARM))
    ways = (vectors * np.sqrt(values)).T[::-1][:KICKS] / ARM
    return [sign * way for way in ways for sign in (1, -1)]


def _most_promising(job: Job, starts, count: int) -> list[Hypothesis]:
    """Return the cheapest distinct starts by the quasi-static page's own cost."""
    problem, window = _problem(job, quasi_static)
    data, costed = problem.data(WEAK), []
    for h in starts:
        x = problem.pack({"theta": h.theta, "x": h.x[:, window.last]})
        cost = sum(float(problem.value(n, x, data).sum()) for n in problem.costs)
        costed.append(replace(h, objective=cost))
    return distinct(job.shape, costed, count)


def _solve_all(solve_chunk, job: Job, starts, executor, *args) -> list:
    """Solve every start, in order; spread over the executor in chunks."""
    if executor is None:
        return solve_chunk(job, starts, *args)
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    chunks = [starts[i::workers] for i in range(workers) if starts[i::workers]]
    futures = [executor.submit(solve_chunk, job, chunk, *args) for chunk in chunks]
    out = [None] * len(starts)
    for i, future in enumerate(futures):
        out[i::workers] = future.result()
    return out


def _solve_chunk(job: Job, starts) -> list[Hypothesis]:
    problem, window = _problem(job, quasi_static)
    weak = [replace(v, parameters=v.parameters | WEAK) for v in quasi_static.LEVELS]
    solvers, out = {}, []
    for h in starts:
        levels = weak if h.objective > COARSE else weak[-1:]
        out.append(_solved(job, problem, window, levels, h, TOLERANCE, solvers))
    return out


def _solved(job, problem, window, levels, h, tolerance, solvers):
    """Return the hypothesis that solving the levels makes of h."""
    left = min(LONGEST, max(0.05, job.deadline - time.monotonic()))
    options = SolverOptions(tolerance=tolerance, time_limit=left)
    start = {"theta": h.theta, "x": h.x[:, window.last]}
    s = solve_levels(problem, levels, start, options, solvers)
    theta, x = s.values["theta"][:, 0], s.values["x"][:, window.knot]
    return Hypothesis(theta, x, s.objective, h.path, s.iterations)


def _problem(job: Job, page, guess=None):
    known = job.scene, job.shape, job.precision, job.reductions
    window = reduce(job.data, *known, guess)
    problem = Problem()
    page.build(problem, window, job.scene, job.shape)
    return problem, window


def distinct(shape, found, count: int, hopeless=HOPELESS) -> list[Hypothesis]:
    """Return the best `count` hypotheses of which no two are the same body."""
    kept = []
    for h in sorted(found, key=lambda h: round(h.objective, 3)):  # ties: first wins
        if kept and h.objective > kept[0].objective + hopeless:
            break
        if len(kept) < count and not any(same(shape, h, k) for k in kept):
            kept.append(h)
    return kept


def same(shape, a: Hypothesis, b: Hypothesis) -> bool:
    """Tell whether two hypotheses are one: corners agree at the first and last pose."""
    for k in (0, -1):
        corners = [guessing.corners(shape, h.theta, h.x[:, k]) for h in (a, b)]
        apart = np.linalg.norm(corners[0][:, None] - corners[1][None], axis=2)
        if max(apart.min(axis=0).max(), apart.min(axis=1).max()) > SAME:
            return False
    return True
