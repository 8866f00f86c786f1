"""Build the unreduced problem at a reduced solution, with its multipliers.

Every sample has a pose of its own, and every finger sample and impulse that was dropped
is restored: one problem, built once, on which all certificates are evaluated.  Common
constraints keep their multipliers.  New ones have zero multipliers, new poses are those
of their still span, and new impulses the page's own guess.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from formulations.names import FINGER

from ..local.solved import Solved
from ..local.transfer import matching_contacts, rows_of, samples_of, transferred_values
from ..nlp.kkt import gradient
from ..nlp.problem import Problem
from ..problem.job import Job

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

    @cached_property
    def whole_slope(self) -> np.ndarray:
        """The gradient (unknowns,) of costs and constraints times multipliers, SI."""
        lam = self.multipliers
        return self.slope + gradient(self.problem, self.x, self.data, lam, weights=lam)


def unreduced(job: Job, solved: Solved) -> UnreducedProblem:
    """Return a solved page without its reductions of samples, poses and impulses."""
    h, window, solution = solved.hypothesis, solved.window, solved.solution
    more = job.with_reductions(**dict.fromkeys(LEFT_OUT, False))
    more = replace(more, cuts=())
    again = more.window((h.theta, h.x), solved.at.theta)
    problem = job.build(again)
    values, _, multipliers = transferred_values(solved, again, problem)
    free = rows_of(samples_of(window.free), samples_of(again.free))
    unfelt = matching_contacts(window, again)[FINGER]
    return UnreducedProblem(
        window=again, problem=problem, x=problem.pack(values),
        data=problem.data(solution.parameters), multipliers=multipliers,
        far=np.nonzero(free < 0)[0], unfelt=np.nonzero(unfelt < 0)[0],
    )  # fmt: skip
