r"""The printed problem, literally: eq:vimp, with eq:loss for what the fingers felt.

    min  sum_t  c_t/2 |n_m - n_t|^2_{Sigma_n^-1}                               (eq:norm)
              + [(c_t - 1) alpha phi_t + log(1 + exp(alpha phi_t))]            (eq:bool)
       + sum_t  |x_{t+1} - f_theta(x_t, lam_t, r_t)|^2                        (dynamics)
       + sum_t  lam_n phi_t                                       (1 complementarity)
              + |v_s|^2 lam_n + v_s . lam_t                (2 maximum power dissipation)
              + min(0, phi_t)^2                                     (3 non-penetration)
              + lam_n max(v_n, 0)                                      (4 inelasticity)
    s.t. lam in FC = {|lam_t| <= mu lam_n}
    over theta, x_t, lam_t;  the inner minimum over lam is taken jointly

eq:loss and f are in paper_physics.py, (1) to (4), FC and LAM_MAX in paper_contact.py.

Not printed, so chosen here:
  weights            all but alpha and Sigma_n (public code), from a few scenes
  time               an impulse acts over the step that *ends* at t, as do phi, n, v
  |x - f|            of rotation matrices, a turn counted over ARM; between actions f
                     has no velocity and no impulse: x stays
  mu                 is given; where it is not, it is an unknown with a prior

Departures, all of them:
  lam_n <= LAM_MAX   or the problem is unbounded below: two fingers that squeeze raise
                     lam_n without moving anything, and are paid for it by (1) where
                     phi < 0 and by (2), negative down to lam_n |v_s| (|v_s| - mu)
  (4)                max(v_n, 0) rounded over v_eps: too large by v_eps / 2 at v_n = 0
                     and by less elsewhere
  FC                 is (mu lam_n)^2 - |lam_t|^2 >= 0 with lam_n >= 0: the same set, its
                     gradient zero at the apex; only the first level opens the cone
  gap, n, theta      edges rounded, sizes bounded as on every page; (3) is exact
  fingertips         are rigid
"""

from __future__ import annotations

import math

import casadi as ca

from . import finger_contact, names
from . import paper_contact as g
from .balance import Dynamics
from .finger_contact import pushing, sensed
from .friction import Impulses, friction
from .ground_contact import Corner
from .level import Level
from .paper_physics import Physics
from .rigid_body import G, declare_poses, steps_of
from .size_prior import declare_sizes

ALPHA = math.log(19) / 5e-3  # [1/m] of eq:bool: 95 % sure 5 mm away (public code)
SIGMA_N = ((0.01519, 0, 0), (0, 0.01519, 0), (0, 0, 0.01519))  # [rad^2] (public code)
# What follows is not printed.
WEIGHTS = {  # parameters of the problem, each with its unit
    "dynamics deviation": (0.3e-3, "m"),  # of a pose from its prediction
    "complementarity": (5.0, "nats"),  # for an energy that lifts the object by 1 mm
    "dissipation": (0.3, "nats"),  # likewise; more pays for sliding that is not there
    "inelasticity": (1.0, "nats"),  # likewise
    "penetration deviation": (0.05e-3, "m"),  # of a gap below zero
    "speed rounding": (0.1e-3, "m/s"),  # v_eps: rounds max(v_n, 0)
    "cone slack": (0.0, "weights"),  # widens FC, on the first level only
}

LEVELS = (
    Level("impulses", {"cone slack": 0.1, "speed rounding": 6e-3},
          fixed=("theta", "x"), ipopt={"mu_init": 1e-1, "max_iter": 60}),
    Level("joint", ipopt={"mu_init": 1e-2, "max_iter": 500}),
)  # fmt: skip


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step."""
    body = Physics(window, scene, shape)
    theta, x = declare_sizes(nlp, shape), declare_poses(nlp, window)
    add_loss(nlp, window, body, theta, x)
    step, push = window.step, window.push
    lam, lam_g = g.impulses(nlp, window, scene, shape)
    for name, (value, unit) in WEIGHTS.items():
        nlp.parameter(name, value, unit)
    add_dynamics(nlp, window, body, theta, x, lam, lam_g)

    gap, velocity = body.fingers.gap, body.fingers.velocity
    mu = friction(nlp, names.FINGER_FRICTION, scene.friction_finger)
    w = scene.mass * G * step.dt
    now, at = steps_of(step, theta, x, w[push.step], push.step), pushing(push, lam)
    g.maximum_dissipation(nlp, "finger", velocity, now, at)
    g.friction_cone(nlp, "finger", now.w, lam, mu)
    g.complementarity(nlp, "finger", gap, now, sensed(push, lam))
    g.inelasticity(nlp, "finger", velocity, now, at)
    for name, f in (("felt finger", window.touch), ("free finger", window.free)):
        g.non_penetration(nlp, name, gap, theta, x[:, f.pose], sensed(f))
    add_ground(nlp, window, scene, body, theta, x, lam_g, w)
    pushes = Impulses(lam, mu, now.w)
    finger_contact.report_impulses(nlp, window, body.fingers, theta, x, pushes)
    nlp.report(names.GROUND_IMPULSE, body.ground.impulse, lam_g)


def add_ground(nlp, window, scene, body, theta, x, lam_g, w):
    """Add (1) to (4) and FC of the corners on the ground."""
    step, corner, lift, rest = window.step, window.corner, window.lift, window.rest
    gap, velocity = body.ground.gap, body.ground.velocity
    mu = friction(nlp, names.GROUND_FRICTION, scene.friction_ground)
    now = steps_of(step, theta, x, w[corner.step], corner.step)
    at = Corner(None, lam_g, corner.signs)
    g.maximum_dissipation(nlp, "ground", velocity, now, at)
    g.friction_cone(nlp, "ground", now.w, lam_g, mu)
    now = steps_of(step, theta, x, w[lift.step], lift.step)
    at = Corner(None, lam_g[:, : len(lift)], lift.signs)
    g.complementarity(nlp, "ground", gap, now, at)
    g.inelasticity(nlp, "ground", velocity, now, at)
    g.non_penetration(nlp, "ground", gap, theta, now.x, Corner(None, None, lift.signs))
    resting = Corner(None, None, rest.signs)
    g.non_penetration(nlp, "rest", gap, theta, x[:, rest.pose], resting)


def add_loss(nlp, window, body, theta, x):
    """Add eq:loss of every sample."""
    alpha = nlp.parameter("alpha", ALPHA, "1/m")
    inverse = ca.densify(ca.inv(ca.DM(SIGMA_N))).nonzeros()
    information = nlp.parameter("normal information", inverse, "1/rad^2")
    t, f = window.touch, window.free
    nlp.minimize(
        names.TOUCH_TERM, body.felt, theta, x[:, t.pose], sensed(t), t.normal, alpha,
        information, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        names.FREE_TERM, body.free, theta, x[:, f.pose], sensed(f), alpha,
        role="likelihood",
    )  # fmt: skip


def add_dynamics(nlp, window, body, theta, x, lam, lam_g):
    """Add |x_{t+1} - f_theta(x_t, lam_t, r_t)|^2, by number of pushing fingers."""
    gap, deviation = window.gap, nlp.parameters["dynamics deviation"]
    pushes, corners = Impulses(lam, None, None), Impulses(lam_g, None, None)
    dynamics = Dynamics(theta, x, None, None, pushes, corners)
    for count, now, contacts in dynamics.steps(window):
        name, of = f"dynamics, {count} pushing", (now, deviation, *contacts)
        nlp.minimize(name, body.unpredicted, *of, role="physics")
    nlp.minimize(
        names.BETWEEN_ACTIONS, body.between_actions, theta, x[:, gap.pose],
        x[:, gap.before], deviation, role="physics",
    )  # fmt: skip
