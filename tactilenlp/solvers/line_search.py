"""A line search with a filter: a step lowers the barrier function or the violation.

Waechter and Biegler, Math. Program. 106, 2006, sections 2.3 and 3.2; constants are
IPOPT's defaults.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

GAMMA_THETA, GAMMA_PHI, ETA, S_THETA, S_PHI = 1e-5, 1e-8, 1e-8, 1.1, 2.3  # (18) to (20)
GAMMA_ALPHA, LEAST_STEP = 0.05, 1e-12  # (23), and a bound of it
LARGEST_VIOLATION, SMALL = 1e4, 1e-4  # violations, relative to that of the start, (21)
FLOAT_ERROR = 10 * np.finfo(float).eps  # of barrier functions that are compared


class Stuck(Exception):
    """No step is accepted, or the problem has no number where the solve begins."""


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
        """The residuals g - s of the constraints."""
        return self.g - self.w[len(self.gradient) :]

    @cached_property
    def violation(self) -> float:
        """The sum of absolute residuals."""
        return np.abs(self.residual).sum()

    def barrier(self, mu: float) -> float:
        """Return the barrier function: f less mu times the logarithms of distances."""
        return self.f - mu * (np.log(self.below).sum() + np.log(self.above).sum())


class Filter:
    """Pairs of violation and barrier function that a step must not be worse than.

    violation: that of the start, sum of absolute values.
    """

    def __init__(self, violation: float):
        self._largest = LARGEST_VIOLATION * max(1.0, violation)
        self._small = SMALL * max(1.0, violation)
        self.entries: list[tuple[float, float]] = []

    def first_accepted(
        self, at: Point, dw, slope: float, longest: float, mu: float,
        evaluated: Callable,
    ) -> tuple[float, Point]:  # fmt: skip
        """Return step length and point: the first of the halves of `longest` to pass.

        at: where the step dw (n + m,) begins; slope: of the barrier function along it;
        evaluated: returns the Point of w.  Raises Stuck if none passes.
        """
        phi, theta = at.barrier(mu), at.violation
        feasible, less = theta <= self._small, (1 - GAMMA_THETA) * theta
        alpha, least = longest, _least_step(theta, slope, feasible)
        while alpha > least:
            point = evaluated(at.w + alpha * dw)
            value = point.barrier(mu)
            rise = value - phi - FLOAT_ERROR * abs(phi)
            descends = slope < 0 and alpha * (-slope) ** S_PHI > theta**S_THETA
            if not self._refuses(value, point.violation):
                if descends and feasible:
                    if rise <= ETA * alpha * slope:
                        return alpha, point
                elif point.violation <= less or rise <= -GAMMA_PHI * theta:
                    self.entries.append((less, phi - GAMMA_PHI * theta))
                    return alpha, point
            alpha /= 2
        raise Stuck

    def _refuses(self, phi: float, theta: float) -> bool:
        """Tell whether a point has no numbers, or the filter has a better one."""
        if not np.isfinite(phi) or not theta <= self._largest:
            return True
        return any(theta >= a and phi >= b for a, b in self.entries)


def longest_step(distances, steps, tau: float) -> float:
    """Return the longest step, at most 1, that keeps 1 - tau of each distance, (15).

    distances, steps: arrays, from lower and from upper bounds.
    """
    distance, step = np.concatenate(distances), np.concatenate(steps)
    # One that is overstepped is the first to be; steps of 1e-310 are not divided by.
    over = step < -tau * distance
    return min(1.0, (tau * distance[over] / -step[over]).min(initial=1.0))


def _least_step(theta: float, slope: float, nearly_feasible: bool) -> float:
    """Return the step length below which none is tried, (23)."""
    bounds = [GAMMA_THETA]
    if slope < 0:
        bounds.append(GAMMA_PHI * theta / -slope)
        if nearly_feasible:
            bounds.append(theta**S_THETA / (-slope) ** S_PHI)
    return max(LEAST_STEP, GAMMA_ALPHA * min(bounds))
