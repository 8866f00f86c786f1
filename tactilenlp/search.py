"""The beam: extends, solves, ranks and keeps hypotheses action by action."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations import quasi_static

from . import guess as guessing
from .nlp import Problem
from .reduce import window_of
from .solve import SolverOptions, make_solver, solve


@dataclass(frozen=True, eq=False)
class Hypothesis:
    theta: np.ndarray
    x: np.ndarray  # (unknowns, samples)
    objective: float
    path: tuple = ()
    iterations: int = 0


VAR = 0
SOLVES = 8
COARSE = 40.0


def distinct_of(shape, found, count):
    kept = []
    for h in sorted(found, key=lambda h: h.objective):
        if len(kept) < count and not any(same(shape, h, k) for k in kept):
            kept.append(h)
    return kept


def starts(data, window, shape, kept, action):
    """Return start (theta, x at every sample) for each hypothesis and variation."""
    new = np.nonzero(data.action == action)[0]
    out = []
    if not kept:
        for i, (theta, x) in enumerate(guessing.first_guesses(data, shape)):
            t = np.argwhere(data.contact)[0][0]
            head = np.repeat(x[:, None], t, axis=1)
            tail = guessing.follow(data, window, shape, theta, x, range(t, new[-1] + 1))
            out.append((theta, np.hstack([head, tail]), (f"first{i}",)))
        return out
    for h in kept:
        tail = guessing.follow(data, window, shape, h.theta, h.x[:, -1], new)
        out.append((h.theta, np.hstack([h.x, tail]), (*h.path, "on")))
        for name, theta, x in guessing.realigned(data, window, shape, h.theta, h.x[:, -1], action):
            past = guessing.moved_along(h.x, h.x[:, -1], x)
            whole = guessing.follow(data, window, shape, theta, past[:, 0], range(new[-1] + 1)) if VAR == 1 else np.hstack([past, guessing.follow(data, window, shape, theta, x, new)])
            out.append((theta, np.hstack([whole]), (*h.path, name)))
    return out


def corners_of(shape, theta, x):
    signs = np.array([(a, b) for a in (-1, 1) for b in (-1, 1)])
    c, s = np.cos(x[2]), np.sin(x[2])
    flat = signs * theta[:2] / 2 @ np.array([[c, s], [-s, c]]) + x[:2]
    return np.r_[flat.T, [np.full(4, theta[2])]].T


def same(shape, a, b, tolerance=1e-3):
    """Tell whether two hypotheses are one: corners agree at the first and last pose."""
    for k in (0, -1):
        ca_, cb = (corners_of(shape, h.theta, h.x[:, k]) for h in (a, b))
        d = np.linalg.norm(ca_[:, None] - cb[None], axis=2)
        if max(d.min(0).max(), d.min(1).max()) > tolerance:
            return False
    return True


def beam(data, scene, shape, width=4, verbose=False):
    kept = []
    for action in range(data.actions):
        part = data.select(range(action + 1))
        if not (part.contact & part.valid).any():
            continue
        window = window_of(part, scene, corners=shape.corners)
        nlp = Problem()
        quasi_static.build(nlp, window, scene, shape)
        coarse, fine = quasi_static.LEVELS
        options = SolverOptions(barrier=1e-2, tolerance=1e-4, iterations=100)
        solver = make_solver(nlp, options)
        last = np.r_[np.nonzero(np.diff(window.knot))[0], len(window.knot) - 1]
        found = []
        candidates = []
        data_fine = nlp.data(fine.parameters)
        for theta, x, path in starts(part, window, shape, kept, action):
            z = nlp.pack({"theta": theta, "x": x[:, last]})
            cost = sum(nlp.value(n, z, data_fine).sum() for n in nlp.costs)
            candidates.append(Hypothesis(theta, x, cost, path))
        distinct = distinct_of(shape, candidates, SOLVES)
        for c in distinct:
            values = {"theta": c.theta, "x": c.x[:, last]}
            i0 = 0
            if c.objective > COARSE:
                s = solve(nlp, options, start=values, parameters=coarse.parameters, throw=False, solver=solver)
                i0, values = s.iterations, s.values
            s = solve(nlp, options, start=values, parameters=fine.parameters, throw=False, solver=solver)
            h = Hypothesis(s.values["theta"][:, 0], s.values["x"][:, window.knot], s.objective, c.path + (round(float(c.objective)),), i0 + s.iterations)
            found.append(h)
        kept = distinct_of(shape, found, width)
        if verbose:
            print(action, nlp.size, [(round(h.objective, 1), h.path[-2:], h.iterations) for h in sorted(found,key=lambda h:h.objective)], len(kept))
    return kept, window
