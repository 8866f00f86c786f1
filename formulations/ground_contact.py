r"""What the ground does to the body: the ground part of g(x_t, lam, r_t) of eq:vimp.

The ground is z = 0.  An impulse lam = (lam_n, lam_t1, lam_t2) acts along (z, x, y) at a
corner of the body of height z.  In nats, with w = m g dt and D of contact.py, the
energy that friction fails to dissipate there,

    dissipation      kappa D dt / (w mm)
    complementarity  kappa lam_n (z + ROOM REST) / (w mm)
    rest             z^2 / (2 REST^2)        at poses without a step, of low corners
    ground gap       z >= -ROOM REST

In planar motion the lowest corners stay on the ground, else they may lift: only then
are there the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from . import contact
from .contact import MM
from .friction import friction_law_of
from .names import GROUND_GAP, GROUND_IMPULSE
from .rigid_body import steps_of

REST = 0.1e-3  # [m] deviation of a resting corner from the ground
ROOM = 3e-3  # [REST] below the ground (0.3 um): an interior, also for poses held fixed
X, Y, Z = ca.DM([1, 0, 0]), ca.DM([0, 1, 0]), ca.DM([0, 0, 1])


class Corner(NamedTuple):
    """What a term reads of a contact with the ground.

    theta: the part of the body that it sees, None: all of it; signs: which corner.
    """

    theta: object
    lam: object
    signs: object


@dataclass(frozen=True, eq=False)
class GroundContact(contact.Sliding):
    """The pure functions of a body (shape, motion of its pose x) on the ground."""

    shape: object
    motion: object

    def corner(self, theta, x, signs):
        """Return where a corner is, world frame [m]."""
        p_wo, R_wo = self.motion.pose(self.shape, theta, x)
        return p_wo + R_wo @ self.low(theta, R_wo, signs)

    def low(self, theta, R_wo, signs):
        """Return a corner, or the lowest point of a body that rolls, body frame [m]."""
        if self.shape.rolls:
            return self.shape.support(theta, -R_wo.T @ Z)
        return self.shape.corner(theta, signs)

    def contact(self, theta, x, corner):
        """Return the Contact of a Corner."""
        theta = theta if corner.theta is None else corner.theta
        p_w = self.corner(theta, x, corner.signs)
        return contact.Contact(corner.lam, p_w, Z, (X, Y))

    def impulse(self, lam):
        """Return the impulse of the ground on the body, world frame [N s]."""
        return contact.impulse(lam, Z, (X, Y))

    def gap(self, theta, x, corner):
        """Return the height [m] of a corner."""
        return self.corner(theta, x, corner.signs)[2]

    def velocity(self, step, corner):
        """Return v_n, v_s (2,) [m/s] of a corner against the ground."""
        p_w = self.corner(step.theta, step.x, corner.signs)
        v = (p_w - self.before(step, corner.signs)) / step.dt
        return v[2], v[:2]

    def before(self, step, signs):
        """Return where, at the pose x_1, the point was that is the corner at x [m]."""
        if not self.shape.rolls:
            return self.corner(step.theta, step.x_1, signs)
        _, R_wo = self.motion.pose(self.shape, step.theta, step.x)
        p_1, R_1 = self.motion.pose(self.shape, step.theta, step.x_1)
        return p_1 + R_1 @ self.low(step.theta, R_wo, signs)

    def complementarity(self, theta, x, corner, w, kappa):
        """Return the cost of an impulse on a corner above the ground."""
        height = self.gap(theta, x, corner) + ROOM * REST
        return kappa * corner.lam[0] * height / (w * MM)

    def above(self, theta, x, corner):
        """Return the height of a corner [REST]."""
        return self.gap(theta, x, corner) / REST

    def rest(self, theta, x, corner):
        """Return the cost of a corner off the ground, on which the object rests."""
        return self.above(theta, x, corner) ** 2 / 2


def corners_of(corner, corners, c):
    """Return the Corner that each instance of a term reads; c: its row in `corner`."""
    return Corner(corners.part(None, c), corners.lam[:, c], corner.signs[c])


def add(nlp, window, ground, theta, x, corners, resting=None):
    """Add dissipation of every corner; complementarity, gap and rest where it can lift.

    corners: friction.Impulses of every corner; resting: the part of the body that each
    resting corner sees, by default all of it.
    """
    step, corner, lift = window.step, window.corner, window.lift
    lam, w, kappa = corners.lam, corners.w, nlp.parameters["kappa"]
    if lam.rows > 1:
        of = corners.part(theta, slice(None))
        now, at = steps_of(step, of, x, w, corner.step), Corner(None, lam, corner.signs)
        nlp.minimize(
            "ground dissipation", ground.dissipation, now, at,
            friction_law_of(nlp, corners.mu), role="physics",
        )  # fmt: skip
    first = slice(len(lift))
    of, now = corners.part(theta, first), x[:, step.pose[lift.step]]
    at = Corner(None, lam[:, first], lift.signs)
    nlp.minimize(
        "ground complementarity", ground.complementarity, of, now, at, w[first], kappa,
        role="physics",
    )  # fmt: skip
    if resting is None:
        resting = corners.part(theta, slice(len(window.rest)))
    add_support(nlp, window, ground, of, resting, x, lam)
    nlp.report(GROUND_IMPULSE, ground.impulse, lam)


def add_support(nlp, window, ground, lifting, resting, x, lam=None):
    """Add gap and rest, where the body can lift: the ground carries it.

    lifting, resting: the parts of the body that corners of window.lift and window.rest
    see; lam: impulses there, by which rows of the constraint are named.
    """
    step, lift, rest = window.step, window.lift, window.rest
    now, at = x[:, step.pose[lift.step]], Corner(None, None, lift.signs)
    nlp.subject_to(GROUND_GAP, ground.above, lifting, now, at, lower=-ROOM, per=lam)
    now, at = x[:, rest.pose], Corner(None, None, rest.signs)
    nlp.minimize("rest", ground.rest, resting, now, at, role="physics")
