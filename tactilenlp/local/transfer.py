"""Transfer values and multipliers of a solution to a problem of other samples.

Common contacts and constraints keep theirs.  New constraints have zero multipliers, new
poses are those of their still span, and new impulses the page's own guess.
"""

from __future__ import annotations

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
    for name, term in problem.constraints.items():
        source = came_from.get(term.per, np.arange(term.instances))
        old = solution.multipliers.get(name, np.zeros((0, term.function.rows)))
        none = np.zeros((term.function.rows, term.instances))
        multipliers[name] = _columns(old.T, source, none).T
    return values, bounds, multipliers


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
