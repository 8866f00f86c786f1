r"""One more action of a polytope: the earlier ones as a Gaussian prior of its vertices.

    min  eq:loss of the action, way from the one before       (polytope_quasi_static.py)
       + (v - v_0)' Lambda (v - v_0) / 2                                    (`add_past`)
       + motion other than predicted                          (polytope_quasi_static.py)
         or the other terms of eq:vimp                  (polytope_violation_implicit.py)
    s.t. v_z >= 0, with eq:vimp all its constraints
    over v_j, x_k of the action, with eq:vimp also its other unknowns but m, r

v_0 and Lambda are the vertices and the information about them at the last pose before
the action, which is held.  There are two pages: `build` with predicted motion,
`build_pushed` with impulses.  Their solutions start the joint problem of all actions.
"""

from __future__ import annotations

import casadi as ca

from . import polytope_quasi_static, polytope_violation_implicit
from .level import Level

LEVELS = polytope_quasi_static.STARTING
PUSHED = (Level("pushed", ipopt={"mu_init": 1e-1, "max_iter": 60}),)


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:loss of the action, the prior, and predicted motion."""
    polytope_quasi_static.build(nlp, window, scene, shape, add_past)


def build_pushed(nlp, window, scene, shape):
    """Fill `nlp` with eq:vimp of the action, and the prior."""
    polytope_violation_implicit.build(nlp, window, scene, shape, add_past)


def add_past(nlp, window, shape, theta):
    """Add the prior: window.information (3 V, 3 V) [1/m^2] about window.past."""
    n = theta.rows * theta.columns

    def gaussian(v, v_0, information):
        d = v - v_0
        return d.T @ ca.reshape(information, n, n) @ d / 2

    vertices = theta[:, [[*range(theta.columns)]]]
    nlp.minimize(
        "past", gaussian, vertices, window.past.reshape(1, n),
        window.information.reshape(1, n * n), role="prior",
    )  # fmt: skip
