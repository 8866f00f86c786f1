r"""How far a body moves between two actions, while nothing is recorded: a prior.

    power log(1 + way^2 / gap^2)                                (`add_fixed_width`)

    - log( (c(x - x_1, gap^2 + slid^2) + c(x - x_on, gap^2 + (PUSHED_ON last)^2)) / 2 )

    c(u, width^2) = (1 + u^2 / width^2)^-CAUCHY (gap / width)^3       (`add_moved_on`)

    way^2   = |p - p_1|^2 + ARM^2 |R - R_1|^2 / 2

The retraction of the fingers mostly moves nothing, and sometimes centimetres: this is a
Cauchy density in x, y and yaw.  A body that is still pushed as an action ends either
comes to rest slid = v^2 / (2 mu g) further on, where v = last / dt is the speed of the
last step, or is pushed on: the recording ends, the finger does not.  Then it is at
x_on, one more step as the last one from x_1, before the fingers are taken away.  Either
is as likely as the other; at rest both are the same.  `add_moved_on` is for pages whose
poses tell a speed; poses of least motion follow noisy fingers.
"""

from __future__ import annotations

import casadi as ca

from .names import BETWEEN_ACTIONS
from .rigid_body import ARM

GAP = 0.5e-3  # [m] way of the object between actions
CAUCHY = 2  # power of its density in x, y and yaw
PUSHED_ON = 0.3  # [-] of the last step: how far the one after it may differ
HEAVY = 1  # of a hull's, whose shape follows a wrong path: a heavier tail lets it leave


def add_fixed_width(nlp, window, shape, theta, x, power=CAUCHY):
    """Add the density of fixed width `gap scale`."""
    motion, g = window.motion, window.gap
    gap_scale = nlp.parameter("gap scale", GAP, "m")

    def way_cost(theta, x, x_1, gap):
        return power * ca.log(1 + way_squared(motion, shape, theta, x, x_1) / gap**2)

    nlp.minimize(
        BETWEEN_ACTIONS, way_cost, theta, x[:, g.pose], x[:, g.before], gap_scale,
        role="prior",
    )  # fmt: skip


def add_moved_on(nlp, window, shape, theta, x):
    """Add the density of a body that comes to rest, or is pushed on for a step."""
    motion, g = window.motion, window.gap
    gap_scale = nlp.parameter("gap scale", GAP, "m")
    braking = window.braking + 0 * g.dt  # [m/s^2] of every gap

    def density(way, width_squared, gap):
        return (1 + way / width_squared) ** -CAUCHY * (gap**2 / width_squared) ** 1.5

    def way_cost(theta, x, x_1, x_2, dt, gap, braking):
        end, last, before = (motion.pose(shape, theta, c) for c in (x, x_1, x_2))
        step = squared_between(last, before)
        slid = (step / dt**2 / (2 * braking)) ** 2
        on = 2 * last[0] - before[0], last[1] @ before[1].T @ last[1]
        stopped = density(squared_between(end, last), gap**2 + slid, gap)
        pushed = density(squared_between(end, on), gap**2 + PUSHED_ON**2 * step, gap)
        return -ca.log((stopped + pushed) / 2)

    nlp.minimize(
        BETWEEN_ACTIONS, way_cost, theta, x[:, g.pose], x[:, g.before],
        x[:, g.before_2], g.dt, gap_scale, braking, role="prior",
    )  # fmt: skip


def way_squared(motion, shape, theta, x, x_1):
    """Return the squared way [m^2] between two poses, a turn counted over ARM."""
    return squared_between(*(motion.pose(shape, theta, c) for c in (x, x_1)))


def squared_between(pose, other):
    """Return the same of poses p (3,) [m], R (3, 3)."""
    (p, R), (p_1, R_1) = pose, other
    return ca.sumsqr(p - p_1) + ARM**2 * ca.sumsqr(R - R_1) / 2
