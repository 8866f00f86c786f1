r"""What the ground does to the body: the ground part of g(x_t, lam, r_t) of eq:vimp.

The ground is z = 0.  An impulse lam = (lam_n, lam_1, lam_2) acts along (z, x, y) at a
corner of the body.  In planar motion the lowest corners stay on the ground, else they
may lift.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from . import contact
from .friction import FRICTION, rounding

REST = 0.1e-3  # [m] deviation of a resting corner from the ground
ROOM = 3e-3  # [REST] below the ground (0.3 um): an interior, also for poses held fixed
X, Y, Z = ca.DM([1, 0, 0]), ca.DM([0, 1, 0]), ca.DM([0, 0, 1])


@dataclass(frozen=True, eq=False)
class GroundContact:
    """The pure functions of a body (shape, motion of its pose x) on the ground."""

    shape: object
    motion: object

    def corner(self, theta, x, signs):
        """Where a corner is, world frame [m]."""
        p_wo, R_wo = self.motion.pose(self.shape, theta, x)
        return p_wo + R_wo @ self.shape.corner(theta, signs)

    def impulse(self, lam):
        """Impulse of the ground on the body, world frame [N s]."""
        return contact.impulse(lam, Z, (X, Y))

    def wrench(self, theta, x, lam, signs):
        """Impulse [N s] and its moment about the body's origin [N m s], world frame."""
        _, R_wo = self.motion.pose(self.shape, theta, x)
        impulse = self.impulse(lam)
        return impulse, ca.cross(R_wo @ self.shape.corner(theta, signs), impulse)

    def work(
        self, theta, x, x_1, lam, signs, dt, w, kappa, v_eps, rounding, nominal, mu
    ):
        """Friction with the ground that fails to dissipate; at rest, none.

        nominal: friction of the corner's share of the weight, of which the rounding of
        the speed makes a cost also at rest.
        """
        v = (self.corner(theta, x, signs) - self.corner(theta, x_1, signs)) / dt
        loss = contact.dissipation(mu, lam, v[:2], v_eps, rounding * w) * dt / w
        return kappa * (loss - (nominal + rounding) * v_eps * dt) / 1e-3

    def apart(self, theta, x, x_1, lam, signs, dt, w, kappa, v_eps):
        """Impulse of the ground on a corner that is above it or rises."""
        z, z_1 = self.corner(theta, x, signs)[2], self.corner(theta, x_1, signs)[2]
        rises = contact.inelasticity(lam, (z - z_1) / dt, v_eps) - lam[0] * v_eps / 2
        energy = lam[0] * (z + ROOM * REST) + 0.2 * dt * rises
        return kappa * energy / (w * 1e-3)

    def gap(self, theta, x, signs):
        """Height of a corner [m] over REST."""
        return self.corner(theta, x, signs)[2] / REST

    def off(self, theta, x, signs):
        """A corner on which the object rests, off the ground."""
        return (self.corner(theta, x, signs)[2] / REST) ** 2 / 2


def add(nlp, window, ground, theta, x, lam, mu, w, resting=None):
    """Add dissipation of every corner; complementarity, gap and rest where it can lift.

    theta: of the body, or of the part that each corner sees; lam: its impulse, w [N s]:
    the weight over its step; resting: the part that each resting corner sees, by
    default the body.
    """
    resting = theta if resting is None else resting
    step, corner, lift, rest = window.step, window.corner, window.lift, window.rest
    kappa, v_eps = nlp.parameters["kappa"], nlp.parameters["speed rounding"]
    value = FRICTION if mu.name in nlp.variables else mu.value[0]

    def poses(s):
        return x[:, step.pose[s]], x[:, step.before[s]]

    s = corner.step
    if lam.rows > 1:
        nlp.minimize(
            "ground dissipation", ground.work, theta, *poses(s), lam, corner.signs,
            step.dt[s], w, kappa, v_eps, rounding(nlp, mu),
            value / max(1, len(ground.shape.corners)), mu, role="physics",
        )  # fmt: skip
    s = lift.step
    nlp.minimize(
        "ground complementarity", ground.apart, theta.pick(slice(len(s))), *poses(s),
        lam[:, : len(s)], lift.signs, step.dt[s], w[: len(s)], kappa, v_eps,
        role="physics",
    )  # fmt: skip
    nlp.subject_to(
        "ground gap", ground.gap, theta.pick(slice(len(s))), x[:, step.pose[s]],
        lift.signs, lower=-ROOM,
    )  # fmt: skip
    nlp.minimize(
        "rest",
        ground.off,
        resting.pick(slice(len(rest))),
        x[:, rest.pose],
        rest.signs,
        role="physics",
    )
    nlp.report("ground impulse", ground.impulse, lam)
