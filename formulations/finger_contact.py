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
        self, theta, x, x_1, lam, p_wf, p_wf_1, rho, t, dt, w, kappa, v_eps, rounding,
        mu,
    ):  # fmt: skip
        """Friction that fails to dissipate, and normal impulse that pulls apart."""
        p_w, n, (t_1, t_2) = self.touch(theta, x, p_wf, rho, t)
        p, R = self.motion.pose(self.shape, theta, x)
        p_1, R_1 = self.motion.pose(self.shape, theta, x_1)
        body_before = p_1 + R_1 @ (R.T @ (p_w - p))
        v = (self.finger.before(p_w, p_wf, p_wf_1) - body_before) / dt
        v_s = ca.vertcat(ca.dot(v, t_1), ca.dot(v, t_2))
        energy = contact.dissipation(mu, lam, v_s, v_eps, rounding * w)
        energy += 0.2 * contact.inelasticity(lam, -ca.dot(v, n), v_eps)
        return kappa * energy * dt / (w * 1e-3)

    def unfelt(self, theta, x, lam, p_wf, rho, w, kappa):
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
    step, push, unfelt = window.step, window.push, window.unfelt
    kappa, v_eps = nlp.parameters["kappa"], nlp.parameters["speed rounding"]
    silent = set(unfelt.tolist())
    felt = [i for i in range(len(push)) if i not in silent]
    f, s = push.pick(felt), push.step[felt]
    nlp.minimize(
        "finger dissipation", fingers.work, theta.pick(felt), x[:, step.pose[s]],
        x[:, step.before[s]], lam[:, felt], f.p_wf, f.p_wf_1, f.radius, f.tangent,
        step.dt[s], w[felt], kappa, v_eps, rounding(nlp, mu), mu, role="physics",
    )  # fmt: skip
    f, s = push.pick(unfelt), push.step[unfelt]
    nlp.minimize(
        "finger complementarity", fingers.unfelt, theta.pick(unfelt), x[:, step.pose[s]],
        lam[:, unfelt], f.p_wf, f.radius, w[unfelt], kappa, role="physics",
    )  # fmt: skip
    nlp.report(
        "finger impulse", fingers.impulse, theta, x[:, step.pose[push.step]], lam,
        push.p_wf, push.radius, push.tangent,
    )  # fmt: skip
