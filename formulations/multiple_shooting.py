r"""eq:loss_const by multiple shooting: every pose an unknown, every step a constraint.

    min  sum_t L_t(theta, x_t), way between actions     as in violation_implicit.py
       + priors of theta, d; where unknown of mu        as in violation_implicit.py
    s.t. x_{t+1} = f_theta(x_t, x_{t-1}, r_t)           time_stepping.py
    over theta, x_t, d; where unknown also mu

Contact is what f computes: a finger also pushes where it felt nothing.  So no sample
may be left out, and no poses may be merged (REDUCTIONS).  The noise of finger positions
enters f as it is, and fingertips are rigid.  f is rounded over v_eps, which each level
reduces.  x_{t-1} stands for where the body came from at its speed before, had that step
been as long as this one (`coming`).
"""

from __future__ import annotations

import casadi as ca

from . import indentation
from .between_actions import add_moved_on
from .friction import friction
from .level import Level
from .likelihood import add_free, add_touches
from .names import (
    EXACT,
    FINGER_FRICTION,
    FINGER_IMPULSE,
    GROUND_FRICTION,
    IMPULSE,
    RESPONSE,
)
from .rigid_body import G, declare_poses, momentum_change, steps_of, uniform
from .size_prior import add_size_prior, declare_sizes
from .sliding_contact import Pusher
from .sliding_contact import push as push_of
from .time_stepping import STEP_V_EPS, Sliding
from .violation_implicit import NORMAL, TOUCH

# These equations need every sample, whatever the options say.
REDUCTIONS = {"planar": True, "still": False, "far": False, "absent": False}
LEVELS = (
    Level("soft", {"speed rounding": 20e-3, "touch scale": 2e-3, "normal scale": 0.2}),
    # Without it 4 of 12 recordings end otherwise, 3 of them higher; 1.4 times the CPU.
    Level("medium", {"speed rounding": 6e-3, "touch scale": 0.6e-3,
                     "normal scale": 0.1},
          ipopt={"mu_init": 1e-3, "max_iter": 60}),
    Level("sharp", ipopt={"mu_init": 1e-3, "max_iter": 100}),
)  # fmt: skip


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:loss_const, a defect for every step."""
    depth = indentation.declare(nlp, window, scene)
    theta, x = declare_sizes(nlp, shape), declare_poses(nlp, window)
    add_touches(nlp, window, shape, theta, x, TOUCH, NORMAL, depth)
    add_free(nlp, window, shape, theta, x)
    add_moved_on(nlp, window, shape, theta, x)
    add_size_prior(nlp, shape, theta)
    indentation.add_prior(nlp, depth)
    body = Sliding(shape, window.finger, scene.mass, scene.gravity)
    mu = friction(nlp, FINGER_FRICTION, scene.friction_finger)
    mu_g = friction(nlp, GROUND_FRICTION, scene.friction_ground)
    v_eps = nlp.parameter("speed rounding", STEP_V_EPS, "m/s")
    step, push = window.step, window.push

    def motion(*begun):
        return body.step(*evenly(*begun))

    def response(x_t, *begun):
        return ca.diag(1 / x.scale) @ body.impulse_response(x_t, *evenly(*begun))

    def remaining(x_t, *begun):
        theta, x_1, x_2, dt, mu, mu_g, v_eps, *pushers = evenly(*begun)
        known = theta, x_1, x_2, dt, mu, mu_g, *pushers
        return ca.norm_inf(body.imbalance(x_t, v_eps, *known))

    for count, g in window.groups.items():
        s, at = g.steps, g.pushes.T
        fingers = [Pusher(push.p_wf[j], push.p_wf_1[j], push.radius[j]) for j in at]
        name, end = f"motion, {count} fingers", x[:, step.pose[s]]
        begun = (
            theta, x[:, step.before[s]], x[:, step.before_2[s]], step.dt[s],
            step.dt_1[s], mu, mu_g, v_eps, *fingers,
        )  # fmt: skip
        nlp.follow(name, motion, *begun, gives=end)
        nlp.report(name + RESPONSE, response, end, *begun)
        nlp.report(name + EXACT, remaining, end, *begun)
    reports(nlp, window, scene, shape, body, theta, x, mu)


def evenly(theta, x_1, x_2, dt, dt_1, *more):
    """Return what a step begins with, had the one before been as long."""
    return theta, x_1, coming(x_1, x_2, dt, dt_1), dt, *more


def coming(x_1, x_2, dt, dt_1):
    """Return the pose from which a body would come to x_1 in dt, as from x_2 in dt_1.

    Exactly x_2 where both steps are as long.
    """
    return x_2 + (1 - dt / dt_1) * (x_1 - x_2)


def reports(nlp, window, scene, shape, body, theta, x, mu):
    """Name the impulses of fingers, and of all contacts together."""
    step, push, v_eps = window.step, window.push, nlp.parameters["speed rounding"]

    def pushed(step, mu, v_eps, pusher):
        return push_of(body, step, mu, v_eps, pusher)[1]

    def whole(theta, x, x_1, x_2, dt, dt_1):
        poses = [window.motion.pose(shape, theta, c) for c in (x, x_1, x_2)]
        linear, _ = momentum_change(uniform(shape, theta), poses, dt, dt_1)
        return scene.mass * (linear + ca.vertcat(0, 0, scene.gravity * dt))

    now = steps_of(step, theta, x, scene.mass * G * step.dt[push.step], push.step)
    finger = Pusher(push.p_wf, push.p_wf_1, push.radius)
    nlp.report(FINGER_IMPULSE, pushed, now, mu, v_eps, finger)
    nlp.report(
        IMPULSE, whole, theta, x[:, step.pose], x[:, step.before],
        x[:, step.before_2], step.dt, step.dt_1,
    )  # fmt: skip
