r"""Coulomb friction of a contact: its coefficient, its impulses and their cone.

lam_n >= 0,     |lam_t| <= mu lam_n          (apex rounded; recomputed exactly)
LEAST |lam / w|^2                            least impulse, w = m g dt
(mu - 0.4)^2 / (2 0.3^2)                     prior, where mu is unknown (FRICTION_MEAN)
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from . import contact
from .names import EXACT, FINGER, FINGER_FRICTION, GROUND, GROUND_FRICTION
from .rigid_body import G

# [1] prior of a coefficient: dry rubber, wood, metal
FRICTION_MEAN, FRICTION_SIGMA = 0.4, 0.3
# [nats] for an impulse of one weight: with 0.001 solves take 1.7 times the iterations,
# with 0.3 sizes that only forces tell are twice as far off (results/EXPERIMENTS.md).
LEAST = 1e-2


@dataclass(frozen=True, eq=False)
class Impulses:
    """The impulses lam of some contacts (normal, t1, t2), as unknowns or data.

    mu: their coefficient of friction; w: weight [N s] over the step of each; theta: the
    part of the body that each contact reads, None: all of it.
    """

    lam: object
    mu: object
    w: object
    theta: object = None

    def part(self, theta, j):
        """Return what contacts j read of the body, by default theta (None: None)."""
        whole = theta if self.theta is None else self.theta
        return whole if whole is None else whole.pick(j)


def friction(nlp, name, value):
    """Declare a coefficient: a parameter where it is known, else an unknown."""
    if value is not None:
        return nlp.parameter(name, value)
    mu = nlp.variable(
        name, 1, lower=0.01, upper=2.0, guess=FRICTION_MEAN, unit="1", scale=0.1
    )
    nlp.minimize(
        f"{name} prior",
        lambda mu: ((mu - FRICTION_MEAN) / FRICTION_SIGMA) ** 2 / 2,
        mu,
        role="prior",
    )
    return mu


def impulses(nlp, name, count, scale, normal=0.0, frictionless=(), most=ca.inf):
    """Declare the impulses (normal, t1, t2) [N s] of `count` contacts, as columns.

    normal: guess of the normal one; scale: of all [N s]; frictionless: the names of
    contacts without friction, which have the normal one alone; most: bound of that, of
    all or of each.
    """
    rows = 1 if name in frictionless else 3
    lower, upper = [0, -ca.inf, -ca.inf], [most, most + ca.inf, most + ca.inf]
    guess = [normal, 0 * normal, 0 * normal]
    return nlp.variable(
        name, rows, count, lower=lower[:rows], upper=upper[:rows],
        guess=guess[:rows], unit="N s", scale=scale,
    )  # fmt: skip


def contact_impulses(nlp, window, scene, shape, share=None, push=0.0):
    """Declare the impulses and the friction of fingers and of the ground.

    Guesses of their normal impulses: share of the weight, that each ground contact
    carries, by default all corners the same; push: of each finger, in mean weights.
    Returns w = m g dt of the steps [N s], and the Impulses of fingers and ground.
    """
    w = scene.mass * G * window.step.dt
    w_push, w_corner = w[window.push.step], w[window.corner.step]
    size = w.mean() if len(w) else scene.mass * G
    load = w_corner * (1 / len(shape.corners) if share is None else share)
    slips = window.frictionless
    lam = impulses(nlp, FINGER, len(w_push), size, push * size, slips)
    lam_g = impulses(nlp, GROUND, len(w_corner), size, load, slips)
    mu = friction(nlp, FINGER_FRICTION, scene.friction_finger)
    known = scene.friction_ground if len(w_corner) else 0
    mu_g = friction(nlp, GROUND_FRICTION, known)
    return w, Impulses(lam, mu, w_push), Impulses(lam_g, mu_g, w_corner)


def cone_margin(lam, mu, w, rounding):
    """Return how far inside the friction cone an impulse is, in weights w [N s]."""
    return contact.cone(mu, lam / w, rounding)


def add_cone(nlp, name, impulses, margin=cone_margin):
    """Keep the impulses of contacts in the cone, and no larger than they need to be."""
    lam, mu, w = impulses.lam, impulses.mu, impulses.w
    if lam.rows > 1:
        r = nlp.parameters["cone rounding"]
        nlp.subject_to(f"{name} cone", margin, lam, mu, w, r, lower=0, per=lam)
        nlp.report(f"{name} cone{EXACT}", cone_violation, lam, mu, w)
    nlp.minimize(f"least {name} impulse", least, lam, w, role="regulariser")


def friction_law_of(nlp, mu):
    """Return the FrictionLaw; nothing rounds the cone where mu is known to be zero."""
    p, slips = nlp.parameters, mu.name in nlp.parameters and mu.value[0] == 0
    rounding = 0.0 if slips else p["cone rounding"]
    return contact.FrictionLaw(mu, p["kappa"], p["speed rounding"], rounding)


def cone_violation(lam, mu, w):
    """Return by how much an impulse leaves the exact friction cone, in weights."""
    return ca.norm_2(lam[1:3]) / w - mu * lam[0] / w


def least(lam, w):
    """Return the cost [nats] of an impulse, least at zero."""
    return LEAST * ca.sumsqr(lam / w)
