"""A programme as functions of arrays, and the points where they are evaluated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .condensed_kkt import CondensedKkt


class Programme:
    """What a Newton method needs of an nlp.assembly.Assembly.

    equal (m,): which rows of the constraints are equations.
    """

    def __init__(self, assembly, equal: np.ndarray):
        self._assembly = assembly
        self.kkt = CondensedKkt(assembly.hessian, assembly.jacobian, equal)

    def evaluated(self, x: np.ndarray, data: np.ndarray) -> tuple:
        """Return f, its gradient, g and the nonzeros of its Jacobian."""
        return self._assembly.evaluated(x, data)

    def hessian(self, x, data, y) -> np.ndarray:
        """Return the nonzeros of the upper triangle of that of f + y' g."""
        return self._assembly.second(x, data, 1.0, y)


@dataclass(frozen=True)
class Point:
    """w = (x, s), with f, its gradient, g, nonzeros of J, distances from the bounds."""

    w: np.ndarray
    f: float
    gradient: np.ndarray
    g: np.ndarray
    jacobian: np.ndarray
    below: np.ndarray
    above: np.ndarray

    @cached_property
    def residual(self) -> np.ndarray:
        return self.g - self.w[len(self.gradient) :]

    @cached_property
    def violation(self) -> float:
        return np.abs(self.residual).sum()

    def barrier(self, mu: float) -> float:
        return self.f - mu * (np.log(self.below).sum() + np.log(self.above).sum())
