r"""The joint programme of eq:vimp: shape, every pose and every contact impulse.

    min  sum_t L_t(theta, x_t)                                  (eq:loss, sensing)
       + |momentum balance|^2 / (2 sigma^2)                     (rigid body)
       + maximum dissipation + inelasticity + complementarity   (contact, in nats)
    s.t. lam in the friction cone, lam_n >= 0
    over theta, x_k, lam_k

Units of the penalties: an impulse is measured in w = m g dt, the weight over a step;
an energy in m g * 1 mm / KAPPA.
"""

from __future__ import annotations

import casadi as ca

from . import contact, quasi_static, sensing
from .level import Level
from .rigid_body import momentum_change

LEVELS = (
    Level("impulses", fixed=("theta", "x"), barrier=1e-1),
    Level("joint", barrier=1e-3),
)

KAPPA = 2.0  # [1/mm] nats per (weight x 1 mm) of energy that friction fails to dissipate
STILL = 6e-3  # [m/s] rounds the sliding speed: 0.2 mm in a step of 1/30 s
SIGMA = 0.1  # [weights] deviation of an impulse from momentum balance
ARM = 20e-3  # [m] turns a moment into a force
ROUND = 0.01  # [weights] rounds the apex of the friction cone
LEAST = 1e-3  # [1/weights^2] least impulses, where contact leaves them open


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:vimp: the sensor terms, then the physics of every step."""
    theta, x = quasi_static.sense(nlp, window, shape)
    motion, step, push, corner = window.motion, window.step, window.push, window.corner
    w = scene.mass * scene.gravity * step.dt  # [N s] weight over each step
    lam = nlp.variable(
        "finger", 3, len(push.knot), lower=[0, -ca.inf, -ca.inf], guess=0.0,
        unit="N s", scale=w.mean() if len(w) else 1.0,
    )  # fmt: skip
    lam_g = nlp.variable(
        "ground", 3, len(corner.step), lower=[0, -ca.inf, -ca.inf],
        guess=ca.DM([0.25, 0, 0]).full() * w[corner.step], unit="N s",
        scale=w.mean() if len(w) else 1.0,
    )  # fmt: skip
    mu_f = nlp.parameter("finger friction", scene.friction_finger)
    mu_g = nlp.parameter("ground friction", scene.friction_ground)
    kappa = nlp.parameter("kappa", KAPPA, "1/mm")
    still = nlp.parameter("still", STILL, "m/s")
    sigma = nlp.parameter("momentum sigma", SIGMA, "weights")
    rounding = nlp.parameter("cone rounding", ROUND, "weights")

    def finger_contact(theta, x, p_wf, rho, t):
        """Contact point [m], normal and tangents of a finger on the body."""
        pose = motion.pose(shape, theta, x)
        n = window.finger.normal(shape, theta, pose, p_wf, rho)
        return p_wf - rho * n, n, *contact.tangents(n, t)

    def finger_slip(theta, x, x_1, p_wf, p_wf_1, rho, t, dt):
        """Velocity of the body past the finger at the contact, (n, t1, t2) [m/s]."""
        p, n, t_1, t_2 = finger_contact(theta, x, p_wf, rho, t)
        (p_wo, R), (p_wo_1, R_1) = (motion.pose(shape, theta, c) for c in (x, x_1))
        v = (p - (R_1 @ R.T @ (p - p_wo) + p_wo_1) - (p_wf - p_wf_1)) / dt
        return ca.vertcat(ca.dot(v, n), ca.dot(v, t_1), ca.dot(v, t_2))

    def finger_physics(theta, x, x_1, lam, p_wf, p_wf_1, rho, t, dt, mu, w, kappa, still):
        v = finger_slip(theta, x, x_1, p_wf, p_wf_1, rho, t, dt)
        energy = contact.dissipation(mu, lam, v[1:3], still)
        energy += 0.2 * contact.inelasticity(lam, -v[0], still)
        return kappa * energy * dt / (w * 1e-3)

    def ground_physics(theta, x, x_1, lam, signs, dt, mu, w, kappa, still):
        r = shape.corner(theta, signs)
        (p, R), (p_1, R_1) = (motion.pose(shape, theta, c) for c in (x, x_1))
        v = (p + R @ r - p_1 - R_1 @ r) / dt
        energy = contact.dissipation(mu, lam, v[:2], still)
        return kappa * energy * dt / (w * 1e-3)

    def balance(theta, x, x_1, x_2, dt, w, lams, corners, fingers):
        """Momentum less impulses, in weights: linear (3,), angular (3,) / ARM."""
        linear, angular = momentum_change(shape, motion, theta, x, x_1, x_2, dt)
        m = scene.mass
        p_wo, R = motion.pose(shape, theta, x)
        force, moment = m * linear + ca.vertcat(0, 0, w), m * angular
        for lam, signs in zip(lams, corners, strict=True):
            impulse = ca.vertcat(lam[1], lam[2], lam[0])
            force -= impulse
            moment -= ca.cross(R @ shape.corner(theta, signs), impulse)
        for lam, p_wf, rho, t in fingers:
            p, n, t_1, t_2 = finger_contact(theta, x, p_wf, rho, t)
            impulse = -lam[0] * n + lam[1] * t_1 + lam[2] * t_2
            force -= impulse
            moment -= ca.cross(p - p_wo, impulse)
        return ca.vertcat(force, moment / ARM) / w

    for count, group in window.steps_by_pushes.items():
        chosen = group.steps

        def momentum(theta, x, x_1, x_2, dt, w, sigma, *rest, count=count):
            lams, rest = rest[:4], rest[4:]
            fingers = [rest[4 * i : 4 * i + 4] for i in range(count)]
            r = balance(theta, x, x_1, x_2, dt, w, lams, shape.corners, fingers)
            return ca.sumsqr(r) / (2 * sigma**2)

        fingers = []
        for i in range(count):
            j = group.pushes[:, i]
            fingers += [lam[:, j], push.p_wf[j], push.radius[j], push.tangent[j]]
        nlp.minimize(
            f"momentum ({count} pushing)", momentum, theta,
            x[:, step.knot[chosen]], x[:, step.before[chosen]],
            x[:, step.before_2[chosen]], step.dt[chosen], w[chosen], sigma,
            *(lam_g[:, group.corners[:, i]] for i in range(4)), *fingers, role="physics",
        )  # fmt: skip

    s = push.step
    nlp.minimize(
        "finger contact", finger_physics, theta, x[:, step.knot[s]],
        x[:, step.before[s]], lam, push.p_wf, push.p_wf_1, push.radius, push.tangent,
        step.dt[s], mu_f, w[s], kappa, still, role="physics",
    )  # fmt: skip
    s = corner.step
    nlp.minimize(
        "ground contact", ground_physics, theta, x[:, step.knot[s]],
        x[:, step.before[s]], lam_g, corner.signs, step.dt[s], mu_g, w[s], kappa, still,
        role="physics",
    )  # fmt: skip

    def cone(lam, mu, w, rounding):
        return contact.cone(mu, lam / w, rounding)

    def least(lam, w):
        return LEAST * ca.sumsqr(lam / w)

    nlp.subject_to("finger cone", cone, lam, mu_f, w[push.step], rounding, lower=0)
    nlp.subject_to("ground cone", cone, lam_g, mu_g, w[corner.step], rounding, lower=0)
    nlp.minimize("least finger impulse", least, lam, w[push.step], role="regulariser")
    nlp.minimize("least ground impulse", least, lam_g, w[corner.step], role="regulariser")
