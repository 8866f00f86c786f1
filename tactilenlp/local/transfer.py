"""Transfer values and multipliers of a solution to a problem of other samples.

Common contacts and constraints keep theirs: instances of a constraint that belong to
the same contact, or read the same unknowns.  New ones have zero multipliers, new poses
are those of their still span, and new impulses the page's own guess.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from formulations.names import FINGER, GROUND

from .solved import Solved


def transferred_values(solved: Solved, again, problem) -> tuple[dict, dict, dict]:
    """Return values, bound multipliers and multipliers of a solution for a problem.

    again: the window of `problem`, of the same data as that of `solved`.
    """
    window, solution = solved.window, solved.solution
    came_from = {"x": window.pose[again.last], **matching_contacts(window, again)}
    values, bounds, multipliers = {}, {}, {}
    for name, v in problem.variables.items():
        if name not in solution.values:  # what was fixed before
            values[name], bounds[name] = v.guess, np.zeros(v.guess.shape)
            continue
        source = came_from.get(name, np.arange(v.columns))
        values[name] = _columns(solution.values[name], source, v.guess)
        old = solution.bound_multipliers[name]
        bounds[name] = _columns(old, source, np.zeros(v.guess.shape))
    places = old_places(solved.problem, problem, came_from)
    for name, term in problem.constraints.items():
        source = came_from.get(term.per)
        if source is None:
            before = solved.problem.constraints.get(name)
            source = same_instances(before, term, places)
        old = solution.multipliers.get(name, np.zeros((0, term.function.rows)))
        none = np.zeros((term.function.rows, term.instances))
        multipliers[name] = _columns(old.T, source, none).T
    return values, bounds, multipliers


def old_places(old, new, came_from: dict) -> np.ndarray:
    """Return where each unknown of a new problem is among those of an old one, or -1.

    came_from: by variable, the old column of each new one, by default the same.  Poses
    of another motion have other unknowns.
    """
    places = np.full(new.size, -1)
    for name, variable in new.variables.items():
        v = old.variables.get(name)
        if v is None or v.rows != variable.rows:
            continue
        source = came_from.get(name, np.arange(variable.columns))
        kept = ((source >= 0) & (source < v.columns))[:, None]
        rows = v.span.start + source[:, None] * v.rows + np.arange(v.rows)
        places[variable.span] = np.where(kept, rows, -1).ravel()
    return places


def same_instances(before, term, places) -> np.ndarray:
    """Return which instance of a term `before`, if any, each one of a term is, or -1.

    It reads the same unknowns; places: as of `old_places`.  Where none does, the one of
    the same number if there are as many.
    """
    if before is None:
        return np.full(term.instances, -1)
    source = rows_of(numbered(before.unknowns), numbered(places[term.unknowns]))
    if term.instances == before.instances:
        source = np.where(source < 0, np.arange(term.instances), source)
    return source


def numbered(rows) -> list[tuple[bytes, int]]:
    """Return the rows of an array, each with how many before it are equal to it."""
    seen, keys = Counter(), []
    for key in (row.tobytes() for row in rows):
        keys.append((key, seen[key]))
        seen[key] += 1
    return keys


def _columns(old, source, otherwise) -> np.ndarray:
    """Return columns `source` of `old`, those of `otherwise` where there is none."""
    kept = (source >= 0) & (source < old.shape[1])
    out = otherwise.copy()
    out[:, kept] = old[:, source[kept]]
    return out


def samples_of(rows) -> list[tuple[int, int]]:
    """Return (sample, finger) of every row."""
    return list(zip(rows.sample.tolist(), rows.finger.tolist(), strict=True))


def corners_of(window) -> list[tuple[int, int]]:
    """Return (sample, which corner of its step) of every ground contact."""
    steps = window.step.sample[window.corner.step].tolist()
    width = max(1, len(window.corner) // max(1, len(window.step)))
    return [(s, i % width) for i, s in enumerate(steps)]


def matching_contacts(old, new) -> dict[str, np.ndarray]:
    """Return where in a window each contact of another one is, or -1, by impulses."""
    return {
        FINGER: rows_of(samples_of(old.push), samples_of(new.push)),
        GROUND: rows_of(corners_of(old), corners_of(new)),
    }


def rows_of(old, new) -> np.ndarray:
    """Return for every entry of `new` where it is in `old`, or -1."""
    place = {key: i for i, key in enumerate(old)}
    return np.array([place.get(key, -1) for key in new], int)
