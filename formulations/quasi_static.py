r"""Poses and shape with minimal motion, no impulses: the cheap first stage.

    min  sum_touch  rho(touch(phi)) + |n - n_m|^2 / (2 sigma_n^2)
       + sum_free   log(1 + exp(-alpha phi))
       + sum_steps  a pseudo-Huber of the motion between samples
       + sum_gaps   log(1 + |motion|^2 / gap^2)
       + sum_sizes  (theta - mean)^2 / (2 sigma^2)
    over theta, x_k

The motion term stands for quasi-static dissipation: an object that is pushed moves no
more than it must.  The Cauchy link between actions stands for the unrecorded
retraction of the fingers, which mostly moves nothing and sometimes centimetres.
"""

from __future__ import annotations

import casadi as ca

from . import sensing
from .level import Level

LEVELS = (
    Level(
        "coarse",
        {"touch scale": 2e-3, "normal scale": 0.4, "alpha": 500.0, "gap scale": 5e-3,
         "motion weight": 0.1},
        barrier=1e-1,
    ),
    Level(
        "fine",
        {"touch scale": 3e-4, "normal scale": 0.1, "alpha": 1500.0, "gap scale": 5e-4,
         "motion weight": 0.3},
        barrier=1e-2,
    ),
)  # fmt: skip

ARM = 20e-3  # [m] one radian of turn counts as this much way
STILL = 0.3e-3  # [m] below this, motion is quadratic


def build(nlp, window, scene, shape):
    """Fill `nlp` with the quasi-static programme of eq:loss and minimal motion."""
    theta, x = sense(nlp, window, shape)
    weight = nlp.parameter("motion weight", 0.3, "nats per 1 mm")
    step = window.step

    def moved(theta, x, x_1, weight):
        way = way_squared(window.motion, shape, theta, x, x_1)
        return weight * (ca.sqrt(way + STILL**2) - STILL) / 1e-3

    nlp.minimize(
        "least motion", moved, theta, x[:, step.knot], x[:, step.before], weight,
        role="regulariser",
    )  # fmt: skip


def way_squared(motion, shape, theta, x, x_1):
    """Squared way of the body between two poses [m^2], a turn counted over ARM."""
    (p, R), (p_1, R_1) = (motion.pose(shape, theta, c) for c in (x, x_1))
    return ca.sumsqr(p - p_1) + ARM**2 * ca.sumsqr(R - R_1) / 2


def sense(nlp, window, shape):
    """Declare theta and x, and add what the fingers felt (eq:loss) and the priors."""
    motion, finger = window.motion, window.finger
    low, high = shape.bounds
    mean, spread = shape.size_prior
    theta = nlp.variable(
        "theta", shape.theta, lower=low, upper=high, guess=mean, unit="m", scale=1e-3
    )
    x = nlp.variable(
        "x", motion.unknowns, window.knots, guess=0.0, unit=motion.unit,
        scale=motion.scale,
    )  # fmt: skip
    scale_touch = nlp.parameter("touch scale", 3e-4, "m")
    scale_normal = nlp.parameter("normal scale", 0.1, "rad")
    alpha = nlp.parameter("alpha", 1500.0, "1/m")
    scale_gap = nlp.parameter("gap scale", 5e-4, "m")

    def touching(theta, x, p_wf, rho, n_m, sigma, sigma_n):
        pose = motion.pose(shape, theta, x)
        phi = finger.gap(shape, theta, pose, p_wf, rho)
        n = finger.normal(shape, theta, pose, p_wf, rho)
        cost = sensing.touch(phi, sigma) + sensing.normal(n, n_m, sigma_n)
        return sensing.mixture(cost, window.ceiling)

    def free(theta, x, p_wf, rho, alpha):
        pose = motion.pose(shape, theta, x)
        phi = finger.gap(shape, theta, pose, p_wf, rho)
        return sensing.mixture(sensing.free(phi, alpha), window.ceiling)

    def jumped(theta, x, x_1, gap):
        return ca.log(1 + way_squared(motion, shape, theta, x, x_1) / gap**2)

    t, f, g = window.touch, window.free, window.gap
    nlp.minimize(
        "touch", touching, theta, x[:, t.knot], t.p_wf, t.radius, t.normal,
        scale_touch, scale_normal, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "free", free, theta, x[:, f.knot], f.p_wf, f.radius, alpha, role="likelihood"
    )
    nlp.minimize(
        "between actions", jumped, theta, x[:, g.knot], x[:, g.before], scale_gap,
        role="prior",
    )  # fmt: skip
    nlp.minimize(
        "size prior",
        lambda theta: ca.sumsqr((theta - mean) / spread) / 2,
        theta,
        role="prior",
    )
    return theta, x
