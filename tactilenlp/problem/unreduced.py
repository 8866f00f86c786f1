"""Build the unreduced problem at a reduced solution, and transfer its multipliers.

Every sample has a pose of its own, and every finger sample and impulse that was dropped
is restored: one problem, built once, on which all certificates are evaluated.  Common
constraints keep their multipliers.  New ones have zero multipliers, new poses are those
of their still span, and new impulses the page's own guess.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from formulations.names import FINGER, GROUND

from ..nlp.kkt import gradient
from ..nlp.problem import Problem
from .polytope_window import build_window

if TYPE_CHECKING:
    from ..local.job import Job
    from ..local.solved import Solved

LEFT_OUT = ("still", "far", "absent")


@dataclass(frozen=True, eq=False)
class UnreducedProblem:
    """The unreduced problem at a reduced solution.

    x (unknowns,) SI and data of `problem`; multipliers by constraint; far: rows of
    window.free, unfelt: rows of window.push, that had been left out.
    """

    window: object
    problem: Problem
    x: np.ndarray
    data: np.ndarray
    multipliers: dict[str, np.ndarray]
    far: np.ndarray
    unfelt: np.ndarray

    @cached_property
    def slope(self) -> np.ndarray:
        """The gradient (unknowns,) of the costs, SI."""
        return gradient(self.problem, self.x, self.data, self.problem.costs)

    @property
    def whole_slope(self) -> np.ndarray:
        """The gradient (unknowns,) of costs and constraints times multipliers, SI."""
        lam = self.multipliers
        return self.slope + gradient(self.problem, self.x, self.data, lam, weights=lam)


def unreduced(job: Job, solved: Solved) -> UnreducedProblem:
    """Return a solved page without its reductions of samples, poses and impulses."""
    h, window, solution = solved.hypothesis, solved.window, solved.solution
    more = job.with_reductions(**dict.fromkeys(LEFT_OUT, False))
    more = replace(more, cuts=())
    again = build_window(more, (h.theta, h.x), solved.at.theta)
    problem = job.build(again)
    values, _, multipliers = transferred_values(solved, again, problem)
    free = rows_of(samples_of(window.free), samples_of(again.free))
    unfelt = matching_contacts(window, again)[FINGER]
    return UnreducedProblem(
        window=again, problem=problem, x=problem.pack(values),
        data=problem.data(solution.parameters), multipliers=multipliers,
        far=np.nonzero(free < 0)[0], unfelt=np.nonzero(unfelt < 0)[0],
    )  # fmt: skip


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
