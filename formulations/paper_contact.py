r"""The contact terms of the printed problem (paper.py): (1) to (4), and the cone.

    (1) lam_n phi      (2) |v_s|^2 lam_n + v_s . lam_t      (3) min(0, phi)^2
    (4) lam_n max(v_n, 0)            FC = {|lam_t| <= mu lam_n}

Each is a term, an energy over w MM, the work of lifting the object by 1 mm.  (1) is of
either sign, (2) a sum of unlike units, and the curvature of (3) jumps at 0.  `now` is a
Step, `at` the Push of a finger or the Corner of a ground contact; gap(theta, x, at) and
velocity(now, at) are those of a contact.
"""

from __future__ import annotations

import casadi as ca

from . import contact, friction
from .contact import MM
from .names import FINGER, GROUND
from .rigid_body import G

LAM_MAX = 2.0  # [weights] of the normal impulse of one contact


def impulses(nlp, window, scene, shape):
    """Declare the impulses (normal, t1, t2) [N s] of fingers and ground."""
    step, push, corner = window.step, window.push, window.corner
    w = scene.mass * G * step.dt  # [N s]
    size = w.mean() if len(step) else 1.0
    most, load = LAM_MAX * w, size / len(shape.corners)
    lam = friction.impulses(
        nlp, FINGER, len(push), size, size / 10, most=most[push.step]
    )
    return lam, friction.impulses(
        nlp, GROUND, len(corner), size, load, most=most[corner.step]
    )


def maximum_dissipation(nlp, name, velocity, now, at):
    """Add maximum power dissipation (2)."""

    def dissipation(now, at, nats):
        _, v_s = velocity(now, at)
        energy = ca.sumsqr(v_s) * at.lam[0] + ca.dot(v_s, at.lam[1:3])
        return nats * energy * now.dt / (now.w * MM)

    weight = nlp.parameters["dissipation"]
    nlp.minimize(f"{name} dissipation", dissipation, now, at, weight, role="physics")


def friction_cone(nlp, name, w, lam, mu):
    """Add the friction cone FC."""

    def cone(lam, mu, w, slack):
        return contact.cone_squared(mu, lam / w) + slack**2

    slack = nlp.parameters["cone slack"]
    nlp.subject_to(f"{name} cone", cone, lam, mu, w, slack, lower=0, per=lam)


def complementarity(nlp, name, gap, now, at):
    """Add complementarity (1)."""

    def energy(now, at, nats):
        phi = gap(now.theta, now.x, at)
        return nats * (at.lam[0] * phi) / (now.w * MM)

    weight = nlp.parameters["complementarity"]
    nlp.minimize(f"{name} complementarity", energy, now, at, weight, role="physics")


def inelasticity(nlp, name, velocity, now, at):
    """Add inelasticity (4)."""

    def energy(now, at, nats, v_eps):
        v_n, _ = velocity(now, at)
        rebound = contact.inelasticity(at.lam, v_n, v_eps)
        return nats * rebound * now.dt / (now.w * MM)

    weights = nlp.parameters["inelasticity"], nlp.parameters["speed rounding"]
    nlp.minimize(f"{name} inelasticity", energy, now, at, *weights, role="physics")


def non_penetration(nlp, name, gap, theta, x, at):
    """Add non-penetration (3)."""

    def penetration(theta, x, deviation, at):
        return ca.fmin(0, gap(theta, x, at)) ** 2 / (2 * deviation**2)

    deviation = nlp.parameters["penetration deviation"]
    nlp.minimize(
        f"{name} penetration", penetration, theta, x, deviation, at, role="physics"
    )
