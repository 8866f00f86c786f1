r"""What the fingers do to the body: the finger part of g(x_t, lam, r_t) of eq:vimp.

An impulse lam = (lam_n, lam_1, lam_2) acts along (-n, t1, t2) where finger and body
touch, during the step that ends at its sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from . import contact
from .friction import rounding

UNFELT = 100.0  # [nats] for an impulse of one weight not felt: a sensor feels 0.01


@dataclass(frozen=True, eq=False)
class FingerContact:
    """The pure functions of a body (shape, motion of its pose x) and a finger."""

    shape: object
    motion: object
    finger: object

    def touch(self, theta, x, p_wf, rho, t):
        """Where a finger touches: point p_w [m], normal and tangents of the body."""
        pose = self.motion.pose(self.shape, theta, x)
        p_w, n = self.finger.touch(self.shape, theta, pose, p_wf, rho)
        return p_w, n, contact.tangents(n, t)

    def impulse(self, theta, x, lam, p_wf, rho, t):
        """Impulse of a finger on the body, world frame [N s]."""
        return self.wrench(theta, x, lam, p_wf, rho, t)[0]

    def wrench(self, theta, x, lam, p_wf, rho, t):
        """Impulse [N s] and its moment about the body's origin [N m s], world frame."""
        p_w, n, tangents = self.touch(theta, x, p_wf, rho, t)
        p_wo, _ = self.motion.pose(self.shape, theta, x)
        impulse = contact.impulse(lam, -n, tangents)
        return impulse, ca.cross(p_w - p_wo, impulse)

    def work(
        self, theta, x, x_1, lam, p_wf, p_wf_1, rho, t, dt, w, kappa, still, rounding,
        felt, mu,
    ):  # fmt: skip
        """Friction that fails to dissipate, and normal impulse that pulls apart.

        felt: 0 for a finger that feels nothing, whose rounding must cost nothing.
        """
        p_w, n, (t_1, t_2) = self.touch(theta, x, p_wf, rho, t)
        p, R = self.motion.pose(self.shape, theta, x)
        p_1, R_1 = self.motion.pose(self.shape, theta, x_1)
        body_before = p_1 + R_1 @ (R.T @ (p_w - p))
        v = (self.finger.before(p_w, p_wf, p_wf_1) - body_before) / dt
        v_s = ca.vertcat(ca.dot(v, t_1), ca.dot(v, t_2))
        energy = contact.dissipation(mu, lam, v_s, still, felt * rounding * w)
        energy += 0.2 * contact.inelasticity(lam, -ca.dot(v, n), still)
        return kappa * energy * dt / (w * 1e-3)

    def apart(self, theta, x, lam, p_wf, rho, w, kappa):
        """Impulse across a gap, of a finger that feels none."""
        pose = self.motion.pose(self.shape, theta, x)
        phi = self.finger.gap(self.shape, theta, pose, p_wf, rho)
        energy = contact.complementarity(lam, phi, rho / 50)
        return kappa * energy / (w * 1e-3) + UNFELT * lam[0] / w


def add(nlp, window, fingers, theta, x, lam, mu, w):
    """Add dissipation with inelasticity, and complementarity, of every push.

    lam: its impulse, w [N s]: the weight over its step.
    """
    step, push, a = window.step, window.push, window.apart
    weights = nlp.parameters["kappa"], nlp.parameters["still"]
    s, unfelt = push.step, set(a.tolist())
    felt = [0.0 if i in unfelt else 1.0 for i in range(len(push))]
    nlp.minimize(
        "finger dissipation", fingers.work, theta, x[:, step.knot[s]],
        x[:, step.before[s]], lam, push.p_wf, push.p_wf_1, push.radius, push.tangent,
        step.dt[s], w, *weights, rounding(nlp, mu), felt, mu,
        role="physics",
    )  # fmt: skip
    nlp.minimize(
        "finger complementarity", fingers.apart, theta, x[:, step.knot[s[a]]],
        lam[:, a], push.p_wf[a], push.radius[a], w[a], weights[0], role="physics",
    )  # fmt: skip
    nlp.report(
        "finger impulse", fingers.impulse, theta, x[:, step.knot[s]], lam, push.p_wf,
        push.radius, push.tangent,
    )  # fmt: skip
