r"""The joint programme of eq:vimp for a convex polytope of unknown vertices.

    min  what was felt and known                           (polytope_quasi_static.py)
       + sum_k |impulse balance_k|^2 / (2 sigma^2)         x_{t+1} = f(x_t, lam, r_t)
       + sum   complementarity + dissipation + inelasticity     g(x_t, lam, r_t)
    s.t. lam_n >= 0,  |lam_t| <= mu lam_n,  v_z >= 0
         vol = sum vol_i,  vol c = sum first_i,  vol S = sum second_i        (mass)
    over v_j, x_k, lam_k, and vol, c, S

The same as violation_implicit.py but for three things.  Every contact reads the
vertices near it, not all.  The body's centroid c and its second moments S, unknowns of
their own, are tied to the vertices by the sums over the hull's triangles: mass known,
density uniform; an impulse balance then reads nine numbers of the body, not all
vertices.  The last pose is held, all of it, in free motion as in planar: the vertices
lie in a frame that is upright at the last sample.  Without a ground nothing of it is
here, no legs and no v_z >= 0.

Which vertices a contact reads and which triangles the hull has follows from where the
page starts.  Its last level fills it anew where the one before ended: vertices that had
become invisible, inside the hull, are moved onto it, and the solve goes on.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import casadi as ca

from . import finger_contact, ground_contact
from .friction import cone
from .level import Level
from .polytope import inertia_about, whole_moments
from .polytope_quasi_static import sense
from .rigid_body import momentum_change
from .violation_implicit import ARM, WEIGHTS, G, contacts, felt

EXTENDS = True  # an estimate is extended by one action: polytope_extension.py
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level(
        "loose",
        {
            "touch scale": 0.5e-3,
            "normal scale": 0.05,
            "kappa": 2.0,
            "balance sigma": 0.3,
            "cone rounding": 0.01,
            "speed rounding": 6e-3,
        },
        ipopt={"mu_init": 1e-1, "max_iter": 20},
    ),
    Level("joint", rebuild=True, ipopt={"mu_init": 1e-2}),
)
MOMENTS = ca.DM([1e-6] + 3 * [1e-8] + 6 * [1e-10])  # [m^3, m^4, m^5] scale of each


def build(nlp, window, scene, shape, sense=sense):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step.

    sense: declares vertices and poses and adds what was felt and known of them.
    """
    theta, x = felt(nlp, window, shape, sense)
    for name, (value, unit) in WEIGHTS.items():
        nlp.parameter(name, value, unit)
    w = scene.mass * G * window.step.dt  # (steps,) [N s]
    (fingers, lam, mu, w_f), (ground, lam_g, mu_g, w_g) = contacts(
        nlp, window, scene, shape, w, window.weight_share
    )
    pushed, leg = theta[:, window.near_push], theta[:, window.leg]
    body = mass(nlp, window, theta)
    balance(nlp, window, scene, fingers, ground, body, pushed, leg, x, lam, lam_g, w)
    finger_contact.add(nlp, window, fingers, pushed, x, lam, mu, w_f)
    resting = theta[:, window.resting]
    ground_contact.add(nlp, window, ground, leg, x, lam_g, mu_g, w_g, resting)
    cone(nlp, "finger", lam, mu, w_f)
    cone(nlp, "ground", lam_g, mu_g, w_g)


def mass(nlp, window, theta):
    """Declare the body (10,): volume, centroid, second moments; tie it to theta.

    The moments are per volume, about the body's origin.
    """
    body = nlp.variable(
        "body", 10, guess=window.body, unit="m^3, m, m^2",
        scale=(1e-6, *3 * (1e-3,), *6 * (1e-5,)),
    )  # fmt: skip

    def untied(body, triangles):
        claimed = ca.vertcat(body[0], body[0] * body[1:])
        return (whole_moments(triangles) - claimed) / MOMENTS

    surface = theta[:, window.triangles.reshape(1, -1)]
    nlp.subject_to("mass", untied, body, surface, lower=0, upper=0)
    return body


def balance(nlp, window, scene, fingers, ground, body, pushed, leg, x, lam, lam_g, w):
    """Add x_{t+1} = f(x_t, lam, r_t) of every step, by number of pushing fingers.

    |momentum change less impulses|^2 / (2 sigma^2), in weights w over the step; pushed,
    leg: the vertices that each finger and each ground contact sees.
    """
    step, push, corner = window.step, window.push, window.corner
    sigma, pose = nlp.parameters["balance sigma"], window.motion.pose

    def about_centroid(shape, body, x):
        p_wo, R_wo = pose(shape, body, x)
        return p_wo + R_wo @ body[1:4], R_wo

    motion = replace(window.motion, pose=about_centroid)
    uniform = replace(fingers.shape, inertia=inertia)

    def imbalance(corners, body, x, x_1, x_2, dt, w, sigma, *acts):
        linear, angular = momentum_change(uniform, motion, body, x, x_1, x_2, dt)
        force, moment = ca.vertcat(0, 0, scene.gravity * dt) + linear, angular
        force, moment = scene.mass * force, scene.mass * moment
        arm = pose(uniform, body, x)[1] @ body[1:4]
        for i in range(0, 3 * corners, 3):
            v, *rest = acts[i : i + 3]
            impulse, turning = ground.wrench(v, x, *rest)
            force, moment = force - impulse, moment - turning + ca.cross(arm, impulse)
        for i in range(3 * corners, len(acts), 5):
            V, *rest = acts[i : i + 5]
            impulse, turning = fingers.wrench(V, x, *rest)
            force, moment = force - impulse, moment - turning + ca.cross(arm, impulse)
        return (ca.sumsqr(force) + ca.sumsqr(moment) / ARM**2) / (2 * (sigma * w) ** 2)

    for count, g in window.groups.items():
        s, acts = g.steps, []
        for c in g.corners.T:
            acts += [leg.pick(c), lam_g[:, c], corner.signs[c]]
        for j in g.pushes.T:
            acts += [
                pushed.pick(j), lam[:, j], push.p_wf[j], push.radius[j], push.tangent[j]
            ]  # fmt: skip
        nlp.minimize(
            f"balance, {count} pushing", partial(imbalance, g.corners.shape[1]), body,
            x[:, step.pose[s]], x[:, step.before[s]], x[:, step.before_2[s]],
            step.dt[s], w[s], sigma, *acts, role="physics",
        )  # fmt: skip


def inertia(body):
    """Return the inertia (3, 3) [m^2] per unit mass about the centroid."""
    return inertia_about(body[1:4], body[4:10])
