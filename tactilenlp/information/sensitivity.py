r"""Compute the parametric sensitivity of an estimate to what was assumed.

    dz/da = - K^{-1} [ d^2 L / dx da ]
                     [ d g   / da    ]

for mass, frictions, sensor noise and finger offsets a, by the factorised K of the
solution and central differences of exact gradients: no solve is repeated.  It holds as
long as no contact changes its state.
"""

from __future__ import annotations

import numpy as np

from ..nlp.kkt import KKTSystem

ASSUMPTION_STEP = 1e-4  # [-] relative change of what was assumed


def parameter_sensitivity(kkt, by_gradient, by_constraint, name: str) -> np.ndarray:
    """Return the derivative of the chosen unknowns (k,) by a relative change.

    name: of the parameter of the problem that changes.
    """
    problem, ends = kkt.problem, []
    span = problem.parameters[name].span
    for side in (1, -1):
        data = kkt.data.copy()
        data[span] += side * ASSUMPTION_STEP * data[span]
        ends.append(kkt_residual(problem, kkt, data))
    return difference(by_gradient, by_constraint, ends, ASSUMPTION_STEP)


def kkt_residual(problem, kkt: KKTSystem, data=None) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradient of L and the values of all constraints at the solution.

    data: by default those of `problem`, with the parameters of the solution.
    """
    if data is None:
        data = kkt.data + (problem.data() - kkt.problem.data())
    forces = [np.ravel(kkt.multipliers[name]) for name in problem.constraints]
    forces = np.concatenate([np.zeros(0), *forces])
    slope, g = problem.assembly.lagrangian(kkt.x / problem.scale, data, forces)
    return slope / problem.scale, g


def difference(by_gradient, by_constraint, ends, step) -> np.ndarray:
    (s, g), (s_1, g_1) = ends
    return -(by_gradient.T @ (s - s_1) + by_constraint.T @ (g - g_1)) / (2 * step)
