r"""How far a body moves between two actions, while nothing is recorded: a prior.

    power log(1 + way^2 / gap^2)                                (`add_fixed_width`)

    CAUCHY log(1 + way^2 / width^2) + NORM_POWER log(width^2 / gap^2)  (`add_coasting`)
    width^2 = gap^2 + (v^2 / (2 mu g))^2,     v = way of the last step / dt

    way^2   = |p - p_1|^2 + ARM^2 |R - R_1|^2 / 2

The retraction of the fingers mostly moves nothing, and sometimes centimetres: this is a
Cauchy density in x, y and yaw.  A body that still slides at v when an action ends comes
to rest v^2 / (2 mu g) further on, so that `add_coasting` has a density that much wider.
It is for pages whose poses tell a speed; poses of least motion follow noisy fingers.
"""

from __future__ import annotations

import casadi as ca

from .rigid_body import ARM

GAP = 0.5e-3  # [m] way of the object between actions
CAUCHY = 2  # power of its density in x, y and yaw
NORM_POWER = 3 / 2  # power of width^2 in the norm of that density: of three dimensions
HEAVY = 1  # of a hull's, whose shape follows a wrong path: a heavier tail lets it leave


def add_fixed_width(nlp, window, shape, theta, x, power=CAUCHY):
    """Add the density of fixed width `gap scale`."""
    motion, g = window.motion, window.gap
    gap_scale = nlp.parameter("gap scale", GAP, "m")

    def way_cost(theta, x, x_1, gap):
        return power * ca.log(1 + way_squared(motion, shape, theta, x, x_1) / gap**2)

    nlp.minimize(
        "between actions", way_cost, theta, x[:, g.pose], x[:, g.before], gap_scale,
        role="prior",
    )  # fmt: skip


def add_coasting(nlp, window, shape, theta, x):
    """Add the density that is wider where the body still slides."""
    motion, g = window.motion, window.gap
    gap_scale = nlp.parameter("gap scale", GAP, "m")
    braking = window.braking + 0 * g.dt  # [m/s^2] of every gap

    def way_cost(theta, x, x_1, x_2, dt, gap, braking):
        v_squared = way_squared(motion, shape, theta, x_1, x_2) / dt**2
        width_squared = gap**2 + (v_squared / (2 * braking)) ** 2
        way = way_squared(motion, shape, theta, x, x_1) / width_squared
        return CAUCHY * ca.log(1 + way) + NORM_POWER * ca.log(width_squared / gap**2)

    nlp.minimize(
        "between actions", way_cost, theta, x[:, g.pose], x[:, g.before],
        x[:, g.before_2], g.dt, gap_scale, braking, role="prior",
    )  # fmt: skip


def way_squared(motion, shape, theta, x, x_1):
    """Return the squared way [m^2] between two poses, a turn counted over ARM."""
    (p, R), (p_1, R_1) = (motion.pose(shape, theta, c) for c in (x, x_1))
    return ca.sumsqr(p - p_1) + ARM**2 * ca.sumsqr(R - R_1) / 2
