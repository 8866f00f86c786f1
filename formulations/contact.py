r"""Contact: friction cone, maximum dissipation, complementarity, inelasticity.

An impulse is lam = (lam_n, lam_t1, lam_t2) [N s] in the frame (normal, t1, t2) of its
contact.  The paper's list after eq:vimp, in its order, as energies and limits:

    complementarity      lam_n max(phi, 0)
    maximum dissipation  D = lam_f sqrt(|v_s|^2 + v_eps^2) + v_s . lam_t
                             - v_eps sqrt(lam_f^2 - |lam_t|^2),   lam_f = mu lam_n + r w
    non-penetration      min(0, phi)^2      (paper_contact.py; of unseen fingers also
                                            finger_contact.py)
    inelasticity         lam_n max(v_n, 0)
    friction cone        mu lam_n + r w - sqrt(|lam_t|^2 + (r w)^2) >= 0

r w rounds the apex of the cone, v_eps the speed; max(., 0) is rounded as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from .shape import positive_part

MM = 1e-3  # [m] unit of gaps, and of the way that an energy lifts a weight
NO_IMPULSE = 1e-14  # [N s] of a root that has derivatives where the cone is a point


@dataclass(frozen=True)
class Contact:
    """One contact of a body: its impulse lam, and where and along what it acts.

    lam (3,) [N s] in the frame of normal and tangents, or (1,) without friction;
    point (3,) [m]; normal: direction (3,) of a positive lam_n on the body, tangents:
    two of (3,); world frame.
    """

    lam: object
    point: object
    normal: object
    tangents: tuple

    @property
    def impulse(self):
        """The impulse on the body (3,) [N s], world frame."""
        return impulse(self.lam, self.normal, self.tangents)


class FrictionLaw(NamedTuple):
    """The law of friction of a contact, and what it costs to be off it.

    mu: coefficient; kappa [nats/mm]; v_eps [m/s] and rounding r [weights] round it.
    """

    mu: object
    kappa: object
    v_eps: object
    rounding: object

    def cost(self, lam, v_s, dt, w):
        """Return kappa D dt / (w mm) [nats] of an impulse while it slides at v_s."""
        energy = dissipation(self.mu, lam, v_s, self.v_eps, self.rounding * w)
        return self.kappa * energy * dt / (w * MM)


class Sliding:
    """A contact of a body that may slide: what finger and ground have in common.

    velocity(step, at) -> v_n, v_s of a contact `at`, which has an impulse lam.
    """

    def dissipation(self, step, at, law):
        """Return the cost of friction that does not dissipate."""
        _, v_s = self.velocity(step, at)
        return law.cost(at.lam, v_s, step.dt, step.w)


def tangents(n, t):
    """Return two unit tangents of the plane normal to n; t (3,) picks the first."""
    t1 = t - n * ca.dot(n, t)
    t1 = t1 / ca.sqrt(ca.sumsqr(t1) + 1e-9)
    return t1, ca.cross(n, t1)


def impulse(lam, n, tangents):
    """Return the impulse of lam along n and the tangents, world frame [N s].

    A contact without friction has one number, lam_n: nothing acts along the tangents.
    """
    total = lam[0] * n
    for lam_t, t in zip(ca.vertsplit(lam)[1:], tangents, strict=False):
        total += lam_t * t
    return total


def cone(mu, lam, rounding):
    """Return mu lam_n - |lam_t|, apex rounded over `rounding` [N s]; >= 0 inside."""
    tangential = ca.sqrt(lam[1] ** 2 + lam[2] ** 2 + rounding**2) - rounding
    return mu * lam[0] - tangential


def sliding_loss(lam_f, lam, v_s, v_eps):
    """Return lam_f sqrt(|v_s|^2 + v_eps^2) + v_s . lam_t [J]: what friction leaves.

    lam_f: largest impulse of friction [N s]; v_s (2,): sliding velocity [m/s].
    """
    speed = ca.sqrt(ca.sumsqr(v_s) + v_eps**2)
    power = ca.dot(v_s, lam[1:3]) if lam.numel() > 1 else 0.0
    return lam_f * speed + power


def dissipation(mu, lam, v_s, v_eps, rounding):
    """Return D, the energy that friction fails to dissipate, of the most it can [J].

    It is the gap of Fenchel's inequality: zero where Coulomb's law holds, rounded over
    v_eps [m/s], v_s = -v_eps lam_t / sqrt(lam_f^2 - |lam_t|^2), and positive elsewhere.
    So an impulse costs nothing as such, however hard two fingers squeeze.  rounding:
    r w [N s] of the cone, inside which the last root is at least `rounding`; from half
    of that on, outside, it is constant.
    """
    lam_f = mu * lam[0] + rounding
    left = ca.fmax(lam_f**2 - ca.sumsqr(lam[1:]), rounding**2 / 4 + NO_IMPULSE**2)
    return sliding_loss(lam_f, lam, v_s, v_eps) - v_eps * ca.sqrt(left)


def complementarity(lam, phi, small):
    """Return lam_n max(phi, 0): no impulse across a gap phi [m]."""
    return lam[0] * positive_part(phi, small)


def cone_squared(mu, lam):
    """Return (mu lam_n)^2 - |lam_t|^2: with lam_n >= 0, exactly the cone where >= 0.

    A polynomial, but its gradient vanishes at the apex lam = 0.
    """
    return (mu * lam[0]) ** 2 - lam[1] ** 2 - lam[2] ** 2


def inelasticity(lam, v_n, v_eps):
    """Return lam_n max(v_n, 0): a normal impulse returns no energy."""
    return lam[0] * positive_part(v_n, v_eps)
