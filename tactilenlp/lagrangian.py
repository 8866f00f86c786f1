"""The Lagrangian of a problem: the sum of its costs, and of multipliers times rows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

NONE: Mapping[str, np.ndarray] = {}


def gradient(problem, x, data, multipliers=NONE, costs=None) -> np.ndarray:
    """Return nabla L (unknowns,), SI, at x (unknowns,) SI.

    multipliers: by constraint; with none of them, the gradient of the costs alone;
    costs: names of those that count, by default all.
    """
    g = np.zeros(problem.size)
    for name in problem.costs if costs is None else costs:
        g += np.asarray(problem.jacobian(name, x, data).sum(axis=0)).ravel()
    for name, multiplier in multipliers.items():
        g += problem.jacobian(name, x, data).T @ np.ravel(multiplier)
    return g
