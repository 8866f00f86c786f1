r"""The joint programme of eq:vimp: shape, every pose and every contact impulse.

    min  sum_t L_t(theta, x_t)                                  what was felt, eq:loss
       + sum_k |impulse balance_k|^2 / (2 sigma^2)              x_{t+1} = f(x_t, lam, r)
       + sum   complementarity + dissipation + inelasticity     g(x_t, lam, r), in nats
    s.t. lam_n >= 0,  |lam_t| <= mu lam_n,  ground gap >= 0
    over theta, x_k, lam_k

An impulse is compared with the weight over its time step, w = m g dt, and an energy
with the work of lifting the object by a millimetre: KAPPA nats each, so that mass and
time step cancel.

Departures from the printed equations, named:
  touch, between actions   see quasi_static.py
  dissipation              v_s lam_n mu |v_s| instead of lam_n |v_s|^2: the printed form
                           is no power, and is not zero where friction opposes sliding
  depth                    felt fingers sit a common, unknown way inside the surface
  |v_s|, cone apex         rounded (STILL, ROUND), else no second derivative at rest
  complementarity          of a felt finger is the touch cost; of the ground in planar
                           motion it holds by construction, else lam_n z is an exact
                           penalty beside the hard z >= 0
  non-penetration          of the ground is a hard constraint; of a finger it is part of
                           the likelihoods of touch and free samples
  unfelt                   a finger that feels nothing hardly pushes: UNFELT, linear
  rest                     an action starts at rest: all low corners on the ground
  least impulse            pins what contact leaves open (four corners share a load)
"""

from __future__ import annotations

import casadi as ca

from . import contact, quasi_static
from .level import Level
from .rigid_body import momentum_change

LEVELS = (
    Level(
        "impulses",
        {"cone rounding": 0.01, "still": 6e-3},
        fixed=("theta", "x"),
        barrier=1e-1,
    ),
    Level("joint", barrier=1e-3),
)
ROUGH = (  # from poses that are guessed, not solved: centimetres off where it tumbles
    LEVELS[0],
    Level(
        "loose",
        {
            "touch scale": 2e-3,
            "normal scale": 0.2,
            "gap scale": 5e-3,
            "kappa": 2.0,
            "balance sigma": 0.3,
        },
    ),
    Level(
        "firm",
        {
            "touch scale": 0.5e-3,
            "normal scale": 0.05,
            "kappa": 4.0,
            "balance sigma": 0.1,
        },
    ),
    LEVELS[1],
)

TOUCH = 0.15e-3  # [m] model error of a touched gap: soft contact, rounded edges
DEPTH = 0.05e-3  # [m] compliance and radius error, the same for all touches
NORMAL = 0.010  # [rad] model error of a normal, likewise
KAPPA = 5.0  # [nats] for an energy that lifts the object by 1 mm
SIGMA = 0.03  # [weights] deviation of an impulse from balance
ARM = 20e-3  # [m] turns a moment into a force
STILL = 3e-3  # [m/s] rounds the sliding speed: 0.1 mm in a step of 1/30 s
ROUND = 0.003  # [weights] rounds the apex of the friction cone
UNFELT = 100.0  # [nats] for an impulse of one weight not felt: a sensor feels 0.01
FRICTION = 0.4  # [1] of what is not known
LEAST = 1e-3  # [nats] for an impulse of one weight
REST = 0.1e-3  # [m] deviation of a resting corner from the ground
ROOM = 3e-3  # [REST] below the ground (0.3 um): an interior, also for poses held fixed
G = 9.81  # [m/s^2] makes a weight of a mass, also where nothing falls


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step."""
    depth = nlp.variable("depth", 1, guess=0.0, unit="m", scale=DEPTH)
    theta, x = quasi_static.sense(nlp, window, shape, TOUCH, NORMAL, depth)
    nlp.minimize(
        "depth prior", lambda depth: (depth / DEPTH) ** 2 / 2, depth, role="prior"
    )
    step, push, corner = window.step, window.push, window.corner
    w = scene.mass * G * step.dt  # (steps,) [N s]
    body = _Body(window, scene, shape)
    free = [0, -ca.inf, -ca.inf]
    size = scene.mass * G * (step.dt.mean() if len(step) else 1.0)
    lam = nlp.variable(
        "finger", 3, len(push), lower=free, guess=0.0, unit="N s", scale=size
    )
    lam_g = nlp.variable(
        "ground", 3, len(corner), lower=free, guess=body.share(w), unit="N s",
        scale=size,
    )  # fmt: skip
    mu = friction(nlp, "finger friction", scene.friction_finger)
    mu_g = friction(nlp, "ground friction", scene.friction_ground if len(corner) else 0)
    kappa = nlp.parameter("kappa", KAPPA, "nats/mm")
    still = nlp.parameter("still", STILL, "m/s")
    sigma = nlp.parameter("balance sigma", SIGMA, "weights")
    rounding = nlp.parameter("cone rounding", ROUND, "weights")

    def now_and_before(s):
        return x[:, step.knot[s]], x[:, step.before[s]]

    for count, g in window.groups.items():
        rows, fingers, ground = g.steps, [], []
        for c in g.corners.T:
            ground += [lam_g[:, c], corner.signs[c]]
        for i in range(count):
            j = g.pushes[:, i]
            fingers += [lam[:, j], push.p_wf[j], push.radius[j], push.tangent[j]]
        nlp.minimize(
            f"balance, {count} pushing", body.imbalance, theta, *now_and_before(rows),
            x[:, step.before_2[rows]], step.dt[rows], w[rows], sigma,
            *ground, *fingers, role="physics",
        )  # fmt: skip

    s = push.step
    a = window.apart
    felt = [0.0 if i in a else 1.0 for i in range(len(push))]
    nlp.minimize(
        "finger dissipation", body.finger_work, theta, *now_and_before(s), lam,
        push.p_wf, push.p_wf_1, push.radius, push.tangent, step.dt[s], w[s], kappa,
        still, rounding, felt, mu, role="physics",
    )  # fmt: skip
    nlp.minimize(
        "finger complementarity", body.finger_apart, theta, x[:, step.knot[s[a]]],
        lam[:, a], push.p_wf[a], push.radius[a], w[s[a]], kappa, role="physics",
    )  # fmt: skip
    s = corner.step
    nlp.minimize(
        "ground dissipation", body.ground_work, theta, *now_and_before(s), lam_g,
        corner.signs, step.dt[s], w[s], kappa, still, rounding, mu_g, role="physics",
    )  # fmt: skip
    s = window.lift.step
    nlp.minimize(
        "ground complementarity", body.ground_apart, theta, *now_and_before(s),
        lam_g[:, : len(s)], window.lift.signs, step.dt[s], w[s], kappa, still,
        role="physics",
    )  # fmt: skip
    nlp.subject_to(
        "ground gap", body.ground_gap, theta, x[:, step.knot[s]], window.lift.signs,
        lower=-ROOM,
    )  # fmt: skip
    nlp.minimize(
        "rest", body.resting, theta, x[:, window.rest.knot], window.rest.signs,
        role="physics",
    )  # fmt: skip
    nlp.report(
        "finger impulse", body.finger_impulse, theta, x[:, step.knot[push.step]], lam,
        push.p_wf, push.radius, push.tangent,
    )  # fmt: skip
    nlp.report("ground impulse", lambda lam: lam[[1, 2, 0]], lam_g)
    for name, impulse, coefficient, weight in (
        ("finger", lam, mu, w[push.step]),
        ("ground", lam_g, mu_g, w[corner.step]),
    ):
        nlp.subject_to(
            f"{name} cone", cone, impulse, coefficient, weight, rounding, lower=0
        )
        nlp.report(f"{name} cone, exact", excess, impulse, coefficient, weight)
        nlp.minimize(
            f"least {name} impulse", least, impulse, weight, role="regulariser"
        )


def friction(nlp, name, value):
    """Declare a coefficient: a parameter where it is known, else an unknown."""
    if value is not None:
        return nlp.parameter(name, value)
    mu = nlp.variable(
        name, 1, lower=0.01, upper=2.0, guess=FRICTION, unit="1", scale=0.1
    )
    nlp.minimize(
        f"{name} prior", lambda mu: ((mu - FRICTION) / 0.3) ** 2 / 2, mu, role="prior"
    )
    return mu


def cone(lam, mu, w, rounding):
    """Inside the friction cone, in weights."""
    return contact.cone(mu, lam / w, rounding)


def excess(lam, mu, w):
    """By how much an impulse leaves the exact friction cone, in weights."""
    return ca.norm_2(lam[1:3]) / w - mu * lam[0] / w


def least(lam, w):
    """A pull towards zero, in nats."""
    return LEAST * ca.sumsqr(lam / w)


class _Body:
    """The terms of one body: what the pure functions of the page share."""

    def __init__(self, window, scene, shape):
        self.window, self.scene, self.shape = window, scene, shape
        self.shared = max(1, len(shape.corners))

    def share(self, w):
        """Guess the ground's impulses: every corner carries its share of the weight."""
        normal = w[self.window.corner.step] / self.shared
        return [normal, 0 * normal, 0 * normal]

    def pose(self, theta, x):
        return self.window.motion.pose(self.shape, theta, x)

    def touch(self, theta, x, p_wf, rho, t):
        """Where a finger touches: point p_w [m], normal and tangents of the body."""
        n = self.window.finger.normal(self.shape, theta, self.pose(theta, x), p_wf, rho)
        return p_wf - rho * n, n, *contact.tangents(n, t)

    def finger_impulse(self, theta, x, lam, p_wf, rho, t):
        """Impulse of a finger on the body, world frame [N s]."""
        _, n, t_1, t_2 = self.touch(theta, x, p_wf, rho, t)
        return -lam[0] * n + lam[1] * t_1 + lam[2] * t_2

    def imbalance(self, theta, x, x_1, x_2, dt, w, sigma, *impulses):
        """Squared momentum change less impulses, in weights, over 2 sigma^2."""
        m, corners = self.scene.mass, 2 * self.shared * bool(len(self.window.corner))
        ground, fingers = impulses[:corners], impulses[corners:]
        linear, angular = momentum_change(
            self.shape, self.window.motion, theta, x, x_1, x_2, dt
        )
        p_wo, R_wo = self.pose(theta, x)
        force = m * linear + ca.vertcat(0, 0, m * self.scene.gravity * dt)
        moment = m * angular
        for lam, signs in zip(ground[::2], ground[1::2], strict=True):
            impulse = ca.vertcat(lam[1], lam[2], lam[0])
            force -= impulse
            moment -= ca.cross(R_wo @ self.shape.corner(theta, signs), impulse)
        for i in range(0, len(fingers), 4):
            lam, p_wf, rho, t = fingers[i : i + 4]
            p_w, n, t_1, t_2 = self.touch(theta, x, p_wf, rho, t)
            impulse = -lam[0] * n + lam[1] * t_1 + lam[2] * t_2
            force -= impulse
            moment -= ca.cross(p_w - p_wo, impulse)
        return (ca.sumsqr(force) + ca.sumsqr(moment) / ARM**2) / (2 * (sigma * w) ** 2)

    def finger_work(
        self, theta, x, x_1, lam, p_wf, p_wf_1, rho, t, dt, w, kappa, still,
        rounding, felt, mu,
    ):  # fmt: skip
        """Friction that fails to dissipate, and normal impulse that pulls apart.

        felt: 0 for a finger that feels nothing, whose rounding must cost nothing.
        """
        p_w, n, t_1, t_2 = self.touch(theta, x, p_wf, rho, t)
        (p, R), (p_1, R_1) = self.pose(theta, x), self.pose(theta, x_1)
        v = (p_w - p_1 - R_1 @ (R.T @ (p_w - p)) - p_wf + p_wf_1) / dt
        v_s = ca.vertcat(ca.dot(v, t_1), ca.dot(v, t_2))
        energy = contact.dissipation(mu, lam, v_s, still, felt * rounding * w)
        energy += 0.2 * contact.inelasticity(lam, -ca.dot(v, n), still)
        return kappa * energy * dt / (w * 1e-3)

    def finger_apart(self, theta, x, lam, p_wf, rho, w, kappa):
        """Impulse across a gap, of a finger that feels none."""
        phi = self.window.finger.gap(self.shape, theta, self.pose(theta, x), p_wf, rho)
        energy = contact.complementarity(lam, phi, rho / 50)
        return kappa * energy / (w * 1e-3) + UNFELT * lam[0] / w

    def corner(self, theta, x, signs):
        p_wo, R_wo = self.pose(theta, x)
        return p_wo + R_wo @ self.shape.corner(theta, signs)

    def ground_work(self, theta, x, x_1, lam, signs, dt, w, kappa, still, rounding, mu):
        """Friction with the ground that fails to dissipate; at rest, none."""
        v = (self.corner(theta, x, signs) - self.corner(theta, x_1, signs)) / dt
        loss = contact.dissipation(mu, lam, v[:2], still, rounding * w) * dt / w
        nominal = (self.scene.friction_ground or FRICTION) / self.shared
        return kappa * (loss - (nominal + rounding) * still * dt) / 1e-3

    def ground_apart(self, theta, x, x_1, lam, signs, dt, w, kappa, still):
        """Impulse of the ground on a corner that is above it or rises."""
        z, z_1 = self.corner(theta, x, signs)[2], self.corner(theta, x_1, signs)[2]
        rises = contact.inelasticity(lam, (z - z_1) / dt, still) - lam[0] * still / 2
        energy = lam[0] * (z + ROOM * REST) + 0.2 * dt * rises
        return kappa * energy / (w * 1e-3)

    def ground_gap(self, theta, x, signs):
        """Height of a corner [m] over REST."""
        return self.corner(theta, x, signs)[2] / REST

    def resting(self, theta, x, signs):
        """A corner on which the object rests, off the ground."""
        return (self.corner(theta, x, signs)[2] / REST) ** 2 / 2
