r"""eq:loss_const with the physics as hard constraints: relaxed complementarity.

    min  sum_t L_t(theta, x_t), way between actions     as in violation_implicit.py
       + priors of theta, d; where unknown of mu, e_m   as in violation_implicit.py
       + sum LEAST |lam / w|^2                          least impulse, friction.py
    s.t. |unbalanced impulse, in weights| <= slack      x_{k+1} = f(x, lam, r)
         phi + d >= 0,  lam_n >= 0
         lam_n (phi + d)               <= eps           complementarity
         lam_n v_n                     <= eps           inelasticity
         mu lam_n |v_s| + v_s . lam_t  <= eps           maximum dissipation
         (mu lam_n)^2 - |lam_t|^2      >= -(r w)^2      friction cone, r = APEX_ROUNDING
    over theta, x_k, lam_k, d; where unknown also mu, e_m

Scholtes' relaxation: eps [weights mm] falls by levels to EPS; the same products are
penalties in violation_implicit.py.  In planar motion phi = 0 of the ground holds by
construction.  The balance is in balance.py.

Departures:
  |v_s|   is rounded from below by V = SPEED_ROUNDING: sqrt(v^2 + V^2) - V
  noise   of finger positions relaxes no constraint; fingertips are rigid
"""

from __future__ import annotations

import casadi as ca

from . import centre_of_mass, contact, finger_contact, indentation, names
from .balance import Balance, Dynamics, contacts_of
from .between_actions import add_moved_on
from .contact import MM
from .finger_contact import pushing
from .friction import add_cone, contact_impulses
from .ground_contact import Corner
from .level import Level
from .likelihood import add_free, add_touches
from .rigid_body import ARM, declare_poses, steps_of
from .size_prior import add_size_prior, declare_sizes
from .violation_implicit import APEX_ROUNDING, NORMAL, SPEED_ROUNDING, TOUCH

# Free motion and contacts without friction have not been tested.
REDUCTIONS = {"planar": True, "frictionless": False}
LEVELS = (
    Level("impulses", {"eps": 10.0, "slack": 3.0}, ("theta", "x"),
          ipopt={"mu_init": 0.1}),
    Level("loose", {"eps": 1.0, "slack": 0.3}, ipopt={"mu_init": 0.1}),
    Level("closer", {"eps": 0.1, "slack": 0.03}),
    Level("close", {"eps": 0.01, "slack": 0.003}),
    Level("tight", ipopt={"mu_init": 1e-3}),
)  # fmt: skip
SLACK = 1e-4  # [weights] residual of a balance at the last level
EPS = 1e-3  # [weights mm] of every relaxed product at the last level


def build(nlp, window, scene, shape):
    """Fill `nlp` with what was felt, and the physics of every step as constraints."""
    depth = indentation.declare(nlp, window, scene)
    theta, x = declare_sizes(nlp, shape), declare_poses(nlp, window)
    add_touches(nlp, window, shape, theta, x, TOUCH, NORMAL, depth)
    add_free(nlp, window, shape, theta, x)
    add_moved_on(nlp, window, shape, theta, x)
    add_size_prior(nlp, shape, theta)
    indentation.add_prior(nlp, depth)
    eps = nlp.parameter("eps", EPS, "weights mm")
    slack = nlp.parameter("slack", SLACK, "weights")
    nlp.parameter("cone rounding", APEX_ROUNDING, "weights")
    law = Balance(*contacts_of(window, shape), scene.gravity)
    step, push, corner = window.step, window.push, window.corner
    w, pushes, corners = contact_impulses(nlp, window, scene, shape, push=0.1)
    centre = centre_of_mass.declare(nlp, window, scene, shape)
    dynamics = Dynamics(theta, x, w, centre, pushes, corners)
    add_balance(nlp, window, law, dynamics, slack)
    now = steps_of(step, theta, x, pushes.w, push.step)
    at = pushing(push, pushes.lam)
    add_sliding(nlp, names.FINGER, law.fingers.velocity, now, at, pushes, eps)
    add_separation(nlp, law.fingers, now, at, eps)
    now = steps_of(step, theta, x, corners.w, corner.step)
    at = Corner(None, corners.lam, corner.signs)
    add_sliding(nlp, names.GROUND, law.ground.velocity, now, at, corners, eps)
    finger_contact.report_impulses(nlp, window, law.fingers, theta, x, pushes)
    nlp.report(names.GROUND_IMPULSE, law.ground.impulse, corners.lam)


def add_balance(nlp, window, law, dynamics, slack):
    """Constrain every step: change of momentum is the sum of impulses, in weights."""

    def imbalance(step, centre, slack, *contacts):
        force, moment = law.unbalanced(step, centre, contacts)
        off = ca.vertcat(force, moment / ARM) / step.w
        return ca.vertcat(slack - off, slack + off)

    def response(w):  # to one weight in x, y, z, and about each at ARM
        return ca.vertcat(-ca.DM.eye(6), ca.DM.eye(6)) + 0 * w

    for count, now, contacts in dynamics.steps(window):
        name = f"{names.BALANCE}, {count} pushing"
        of = now, dynamics.centre, slack, *contacts
        nlp.report(name + names.RESPONSE, response, now.w)
        nlp.subject_to(name, imbalance, *of, lower=0)


def add_sliding(nlp, name, velocity, now, at, impulses, eps):
    """Add the friction cone, and maximum dissipation within eps.

    velocity(now, at) -> v_n, v_s of a contact `at` (a Push or a Corner) in a Step.
    """

    def dissipation(now, at, mu, eps):
        _, v_s = velocity(now, at)
        lam_f = mu * at.lam[0]
        loss = contact.sliding_loss(lam_f, at.lam, v_s, SPEED_ROUNDING)
        loss -= lam_f * SPEED_ROUNDING
        return loss * now.dt / (now.w * MM) - eps

    def cone(lam, mu, w, r):
        return contact.cone_squared(mu, lam / w) + r**2

    nlp.subject_to(
        f"{name} dissipation", dissipation, now, at, impulses.mu, eps, upper=0,
        per=at.lam,
    )  # fmt: skip
    add_cone(nlp, name, impulses, cone)


def add_separation(nlp, fingers, now, at, eps):
    """Add non-penetration; complementarity and inelasticity within eps."""
    depth, apart = nlp.variables[names.DEPTH_OF_TOUCH], at._replace(lam=None)

    def gap(theta, x, depth, at):
        return (fingers.gap(theta, x, at) + depth) / MM

    def products(now, at, depth, eps):
        v_n, _ = fingers.velocity(now, at)
        both = ca.vertcat(gap(now.theta, now.x, depth, at), v_n * now.dt / MM)
        return at.lam[0] / now.w * both - eps

    nlp.subject_to(
        "finger gap", gap, now.theta, now.x, depth, apart, lower=0, per=at.lam
    )
    nlp.subject_to(
        "finger complementarity", products, now, at, depth, eps, upper=0, per=at.lam
    )
