r"""How far off an estimate may be where nothing was felt: its ball is but a guess.

There the vertices lie about a sphere (m, r) and near where they started, which is what
a page's prior says, each for itself.  A body differs from its ball otherwise: by INSIDE
radii, and alike in directions alike.  With u_j the direction of vertex j from m,

    v_j = start_j + r INSIDE g_j u_j,    cov(g_i, g_j) = exp(-|u_i - u_j|^2 / 2 ALIKE^2)

By such errors e of where it pulls to, the prior's Hessian H moves the estimate by
K^{-1} H e, nothing where touches hold the vertices:

    K^{-1} H cov(e) H K^{-1}
"""

from __future__ import annotations

import numpy as np

from .curvature import Curvature
from .hull import INSIDE

ALIKE = 1.0  # [-] on the unit sphere: as far apart as directions to one face are
PRIOR = ("ball prior", "stay")  # what holds a vertex that nothing touches
TINY = 1e-9  # [-] of the covariance of g: it is singular where vertices coincide


def guessed(curvature: Curvature, pulls) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns by a wrong ball, SI.

    pulls: see Curvature.response_of.
    """
    problem, values = curvature.problem, curvature.problem.unpack(curvature.x)
    V, (*middle, radius) = values["theta"].T, np.ravel(values["ball"])
    u = V - middle
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), radius * TINY)
    apart = np.linalg.norm(u[:, None] - u[None], axis=2)
    alike = np.exp(-((apart / ALIKE) ** 2) / 2)
    root = np.linalg.cholesky(alike + TINY * np.eye(len(u)))
    errors = np.zeros((problem.size, len(u)))
    errors[problem.variables["theta"].span] = (
        radius * INSIDE * (u[:, :, None] * root[:, None]).reshape(u.size, -1)
    )
    moved = pulls.T @ (curvature.hessian(PRIOR) @ errors)
    return moved @ moved.T
