r"""What the fingers do to the body: the finger part of g(x_t, lam, r_t) of eq:vimp.

An impulse lam = (lam_n, lam_1, lam_2) acts along (-n, t1, t2) where finger and body
touch, during the step that ends at its sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from . import contact
from .friction import rounding

UNFELT = 2000.0  # [nats] for an impulse of one weight not felt: 20 for what would be


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
        mu,
    ):  # fmt: skip
        """Friction that fails to dissipate, and normal impulse that pulls apart."""
        p_w, n, (t_1, t_2) = self.touch(theta, x, p_wf, rho, t)
        p, R = self.motion.pose(self.shape, theta, x)
        p_1, R_1 = self.motion.pose(self.shape, theta, x_1)
        body_before = p_1 + R_1 @ (R.T @ (p_w - p))
        v = (self.finger.before(p_w, p_wf, p_wf_1) - body_before) / dt
        v_s = ca.vertcat(ca.dot(v, t_1), ca.dot(v, t_2))
        energy = contact.dissipation(mu, lam, v_s, still, rounding * w)
        energy += 0.2 * contact.inelasticity(lam, -ca.dot(v, n), still)
        return kappa * energy * dt / (w * 1e-3)

    def apart(self, theta, x, lam, p_wf, rho, w, kappa):
        """Impulse across a gap, of a finger that feels none."""
        pose = self.motion.pose(self.shape, theta, x)
        phi = self.finger.gap(self.shape, theta, pose, p_wf, rho)
        energy = contact.complementarity(lam, phi, rho / 50)
        return kappa * energy / (w * 1e-3) + UNFELT * lam[0] / w


def add(nlp, window, fingers, theta, x, lam, mu, w):
    """Add dissipation with inelasticity where a finger feels, else complementarity.

    theta: of the body, or of the part that each push sees; lam: the impulse of every
    push, w [N s]: the weight over its step.  What rounds the
    cone of a finger that feels nothing neither costs nor earns: all its impulses cost.
    """
    step, push, apart = window.step, window.push, window.apart
    kappa, still = nlp.parameters["kappa"], nlp.parameters["still"]
    unfelt = set(apart.tolist())
    felt = [i for i in range(len(push)) if i not in unfelt]
    f, s = push.pick(felt), push.step[felt]
    nlp.minimize(
        "finger dissipation", fingers.work, theta.pick(felt), x[:, step.knot[s]],
        x[:, step.before[s]], lam[:, felt], f.p_wf, f.p_wf_1, f.radius, f.tangent,
        step.dt[s], w[felt], kappa, still, rounding(nlp, mu), mu, role="physics",
    )  # fmt: skip
    f, s = push.pick(apart), push.step[apart]
    nlp.minimize(
        "finger complementarity", fingers.apart, theta.pick(apart), x[:, step.knot[s]],
        lam[:, apart], f.p_wf, f.radius, w[apart], kappa, role="physics",
    )  # fmt: skip
    nlp.report(
        "finger impulse", fingers.impulse, theta, x[:, step.knot[push.step]], lam,
        push.p_wf, push.radius, push.tangent,
    )  # fmt: skip
