r"""Vertices and poses of a convex polytope with predicted motion, no impulses.

    min  eq:loss                                                   (likelihood.py)
       + heavy-tailed motion between actions                       (between_actions.py)
       + sum_j (|v_j - m| / r - 1)^2 / (2 SPREAD^2)                (ball prior)
       + (r - mean)^2 / (2 deviation^2)                            (size prior)
       + sum_legs v_z^2 / (2 LEG^2)                                (legs on the ground)
       + sum_j |v_j - v_j0|^2 / (2 STAY^2)                         (stay)
       + motion other than predicted                               (quasi_static.py)
    s.t. v_z >= 0                                                  (with a ground)
    over v_j, x_k, m, r

A touch reads the vertices nearest to it (window.near_touch): the others do not change
the nearest point.  `window.legs` are the vertices that carry the body, at least three
of which rest on the ground in planar motion (window.grounded).  Where nothing was felt,
the vertices lie about a sphere (m, r), near where they started: the regulariser `stay`
makes unique what slides along the surface at no cost.

The last pose is held (see polytope_planes.py): v_z is the height at the last sample.
"""

from __future__ import annotations

import casadi as ca

from .between_actions import HEAVY, add_fixed_width
from .level import Level
from .likelihood import add_free, add_touches
from .names import BALL
from .quasi_static import add_unpredicted_motion
from .rigid_body import declare_poses

REDUCTIONS = {"planar": True}  # no term keeps a free body on the ground
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level("coarse", {"touch scale": 1e-3, "normal scale": 0.2}, ipopt={"max_iter": 40}),
    Level("fine", {"touch scale": 0.3e-3, "normal scale": 0.05}),
)
STARTING = tuple(k.with_ipopt(max_iter=40) for k in LEVELS)  # only start another page

TOUCH = 0.2e-3  # [m] model error of a touched gap where there are no impulses
NORMAL = 0.02  # [rad] model error of a normal, likewise
SPREAD = 0.2  # [-] deviation of a vertex from the sphere, in radii
STAY = 5e-3  # [m] deviation of a vertex from where it started
LEG = 0.02e-3  # [m] deviation of a leg from the ground


def declare_vertices(nlp, window):
    """Declare the vertices theta (3, V)."""
    return nlp.variable(
        "theta", 3, len(window.start), lower=[-ca.inf, -ca.inf, window.floor],
        guess=window.start.T, unit="m", scale=1e-3,
    )  # fmt: skip


def add_ball_prior(nlp, window, shape, theta):
    """Add the priors of a body that was not touched yet."""
    mean, deviation = shape.size_prior
    sphere = nlp.variable(
        BALL, 4, guess=[*window.start.mean(axis=0), mean],
        lower=[-ca.inf, -ca.inf, -ca.inf, mean / 10], unit="m", scale=1e-3,
    )  # fmt: skip

    def near_ball(vertex, ball):
        away = ca.sqrt(ca.sumsqr(vertex - ball[:3]) + (mean / 100) ** 2)
        return (away / ball[3] - 1) ** 2 / (2 * SPREAD**2)

    def near_start(vertex, start):
        return ca.sumsqr(vertex - start) / (2 * STAY**2)

    nlp.minimize("ball prior", near_ball, theta, sphere, role="prior")
    nlp.minimize(
        "size prior", lambda ball: ((ball[3] - mean) / deviation) ** 2 / 2,
        sphere,
        role="prior",
    )  # fmt: skip
    nlp.minimize(
        "legs on the ground", lambda vertex: (vertex[2] / LEG) ** 2 / 2,
        theta[:, window.grounded], role="prior",
    )  # fmt: skip
    nlp.minimize("stay", near_start, theta, window.start, role="regulariser")


def build(nlp, window, scene, shape, prior=add_ball_prior):
    """Fill `nlp` with what was felt, and predicted motion.

    prior(nlp, window, shape, theta): adds what was known of the vertices before.
    """
    theta, x = declare_vertices(nlp, window), declare_poses(nlp, window)
    near_touch, near_free = theta[:, window.near_touch], theta[:, window.near_free]
    add_touches(nlp, window, shape, near_touch, x, TOUCH, NORMAL)
    add_free(nlp, window, shape, near_free, x)
    add_fixed_width(nlp, window, shape, 0.0, x, HEAVY)
    prior(nlp, window, shape, theta)
    add_unpredicted_motion(nlp, window, shape, 0.0, x)
