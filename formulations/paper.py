r"""The printed problem, literally: eq:vimp, with eq:loss for what the fingers felt.

    min  sum_t  c_t/2 |n_m - n_t|^2_{Sigma_n^-1}                               (eq:norm)
              + [(c_t - 1) alpha phi_t + log(1 + exp(alpha phi_t))]            (eq:bool)
       + sum_t  |x_{t+1} - f_theta(x_t, lam_t, r_t)|^2                        (dynamics)
       + sum_t  lam_n phi_t                                       (1 complementarity)
              + |v_s|^2 lam_n + v_s . lam_t                (2 maximum power dissipation)
              + min(0, phi_t)^2                                     (3 non-penetration)
              + lam_n max(v_n, 0)                                      (4 inelasticity)
    s.t. lam in FC = {|lam_t| <= mu lam_n}
    over theta, x_t, lam_t;  the inner minimum over lam is taken jointly

f is one step of impulse and momentum, where d_1 is the rotation vector of the last step
and J the inertia per unit mass, world frame:

    p_f = p + (p - p_1) + (sum lam / m + g dt) dt
    R_f = exp(d) R,     d = d_1 + J^-1 (dt sum r x lam / m - d_1 x J d_1)

Not printed, so chosen here:
  weights            all but alpha and Sigma_n (public code), from a few scenes
  time               an impulse acts over the step that *ends* at t, as do phi, n, v
  |x - f|            of rotation matrices, a turn counted over ARM; between actions f
                     has no velocity and no impulse: x stays
  mu                 is given; where it is not, it is an unknown with a prior

Departures, all of them:
  lam_n <= MOST      or the problem is unbounded below: two fingers that squeeze raise
                     lam_n without moving anything, and are paid for it by (1) where
                     phi < 0 and by (2), negative down to lam_n |v_s| (|v_s| - mu)
  (4)                max(v_n, 0) rounded over `v_eps`: too large by v_eps / 2 at v_n = 0
                     and by less elsewhere
  FC                 is (mu lam_n)^2 - |lam_t|^2 >= 0 with lam_n >= 0: the same set, but
                     the gradient vanishes at the apex, where a multiplier need not
                     exist; the first level opens the cone, the last one does not
  gap, n, theta      edges rounded, sizes bounded as on every page; (3) is exact
"""

from __future__ import annotations

import math

import casadi as ca

from . import contact, sensing
from .friction import friction
from .level import Level
from .quasi_static import declare, way_squared
from .rigid_body import ARM, G, rotation, turn

ALPHA = math.log(19) / 5e-3  # [1/m] of eq:bool: 95 % sure 5 mm away (public code)
SIGMA_N = ((0.01519, 0, 0), (0, 0.01519, 0), (0, 0, 0.01519))  # [rad^2] (public code)
# What follows is not printed.
WEIGHTS = {  # parameters of the problem, each with its unit
    "dynamics deviation": (0.3e-3, "m"),  # of a pose from its prediction
    "complementarity": (5.0, "nats"),  # for an energy that lifts the object by LIFT
    "dissipation": (0.3, "nats"),  # likewise; more pays for sliding that is not there
    "inelasticity": (1.0, "nats"),  # likewise
    "penetration deviation": (0.05e-3, "m"),  # of a gap below zero
    "speed rounding": (0.1e-3, "m/s"),  # rounds max(v_n, 0)
    "cone slack": (0.0, "weights"),  # widens FC, on the first level only
}
LIFT = 1e-3  # [m] unit of energy: the object lifted so far
MOST = 2.0  # [weights] of the normal impulse of one contact

LEVELS = (
    Level(
        "impulses",
        {"cone slack": 0.1, "speed rounding": 6e-3},
        fixed=("theta", "x"),
        ipopt={"mu_init": 1e-1, "max_iter": 60},
    ),
    Level("joint", ipopt={"mu_init": 1e-2, "max_iter": 500}),
)


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step."""
    body = Body(window, scene, shape)
    theta, x = likelihood(nlp, window, shape, body)
    step, push, corner, lift = window.step, window.push, window.corner, window.lift
    size = scene.mass * G * (step.dt.mean() if len(step) else 1.0)  # [N s]
    impulse = {"lower": [0, -ca.inf, -ca.inf], "upper": [MOST * size, ca.inf, ca.inf],
               "unit": "N s", "scale": size}  # fmt: skip
    guess, share = [size / 10, 0, 0], [size / max(1, body.corners), 0, 0]
    lam = nlp.variable("finger", 3, len(push), guess=guess, **impulse)
    lam_g = nlp.variable("ground", 3, len(corner), guess=share, **impulse)
    for name, (value, unit) in WEIGHTS.items():
        nlp.parameter(name, value, unit)
    dynamics(nlp, window, body, theta, x, lam, lam_g)

    def now(s):
        poses = x[:, step.pose[s]], x[:, step.before[s]]
        return theta, *poses, step.dt[s], scene.mass * G * step.dt[s]

    at, v = body.finger_gap, body.finger_velocity
    r = push.p_wf, push.radius, push.p_wf_1, push.tangent
    mu = friction(nlp, "finger friction", scene.friction_finger)
    sliding(nlp, "finger", v, now(push.step), lam, mu, r)
    parting(nlp, "finger", at, v, now(push.step), lam, r)
    for name, f in (("felt", window.touch), ("free", window.free)):
        apart(nlp, f"{name} finger", at, theta, x[:, f.pose], (f.p_wf, f.radius))
    at, v = body.ground_gap, body.ground_velocity
    mu = friction(nlp, "ground friction", scene.friction_ground)
    sliding(nlp, "ground", v, now(corner.step), lam_g, mu, (corner.signs,))
    parting(nlp, "ground", at, v, now(lift.step), lam_g[:, : len(lift)], (lift.signs,))
    apart(nlp, "ground", at, theta, x[:, step.pose[lift.step]], (lift.signs,))
    apart(nlp, "rest", at, theta, x[:, window.rest.pose], (window.rest.signs,))
    nlp.report(
        "finger impulse", body.finger_impulse, theta, x[:, step.pose[push.step]], lam,
        push.p_wf, push.radius, push.tangent,
    )  # fmt: skip
    nlp.report("ground impulse", lambda lam: lam[[1, 2, 0]], lam_g)


def likelihood(nlp, window, shape, body):
    """Declare theta and x; add eq:loss of every sample."""
    theta, x = declare(nlp, window, shape)
    alpha = nlp.parameter("alpha", ALPHA, "1/m")
    inverse = ca.densify(ca.inv(ca.DM(SIGMA_N))).nonzeros()
    information = nlp.parameter("normal information", inverse, "1/rad^2")
    t, f = window.touch, window.free
    nlp.minimize(
        "touch", body.felt, theta, x[:, t.pose], t.p_wf, t.radius, t.normal, alpha,
        information, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "free", body.free, theta, x[:, f.pose], f.p_wf, f.radius, alpha,
        role="likelihood",
    )  # fmt: skip
    return theta, x


def dynamics(nlp, window, body, theta, x, lam, lam_g):
    """Add |x_{t+1} - f_theta(x_t, lam_t, r_t)|^2, by number of pushing fingers."""
    step, push, corner, gap = window.step, window.push, window.corner, window.gap
    deviation = nlp.parameters["dynamics deviation"]
    for count, g in window.groups.items():
        s, impulses = g.steps, []
        for c in g.corners.T:
            impulses += [lam_g[:, c], corner.signs[c]]
        for j in g.pushes.T:
            impulses += [lam[:, j], push.p_wf[j], push.radius[j], push.tangent[j]]
        nlp.minimize(
            f"dynamics, {count} pushing", body.unpredicted, theta, x[:, step.pose[s]],
            x[:, step.before[s]], x[:, step.before_2[s]], step.dt[s], deviation,
            *impulses, role="physics",
        )  # fmt: skip
    nlp.minimize(
        "between actions", body.moved, theta, x[:, gap.pose], x[:, gap.before],
        deviation, role="physics",
    )  # fmt: skip


def sliding(nlp, name, velocity, now, lam, mu, where):
    """Add maximum power dissipation (2) and the friction cone FC."""

    def dissipation(theta, x, x_1, dt, w, lam, nats, *where):
        _, v_s = velocity(theta, x, x_1, dt, *where)
        return nats * contact.printed_dissipation(lam, v_s) * dt / (w * LIFT)

    def cone(lam, mu, w, slack):
        return contact.cone_squared(mu, lam / w) + slack**2

    p, w = nlp.parameters, now[-1]
    nlp.minimize(
        f"{name} dissipation", dissipation, *now, lam, p["dissipation"], *where,
        role="physics",
    )  # fmt: skip
    nlp.subject_to(f"{name} cone", cone, lam, mu, w, p["cone slack"], lower=0)


def parting(nlp, name, gap, velocity, now, lam, where):
    """Add complementarity (1) and inelasticity (4)."""

    def complementarity(theta, x, x_1, dt, w, lam, nats, *where):
        phi = gap(theta, x, *where)
        return nats * contact.printed_complementarity(lam, phi) / (w * LIFT)

    def inelasticity(theta, x, x_1, dt, w, lam, nats, v_eps, *where):
        v_n, _ = velocity(theta, x, x_1, dt, *where)
        return nats * contact.inelasticity(lam, v_n, v_eps) * dt / (w * LIFT)

    p = nlp.parameters
    nlp.minimize(
        f"{name} complementarity", complementarity, *now, lam, p["complementarity"],
        *where, role="physics",
    )  # fmt: skip
    nlp.minimize(
        f"{name} inelasticity", inelasticity, *now, lam, p["inelasticity"], p["speed rounding"],
        *where, role="physics",
    )  # fmt: skip


def apart(nlp, name, gap, theta, x, where):
    """Add non-penetration (3)."""

    def penetration(theta, x, deviation, *where):
        return contact.penetration_squared(gap(theta, x, *where)) / (2 * deviation**2)

    deviation = nlp.parameters["penetration deviation"]
    nlp.minimize(
        f"{name} penetration", penetration, theta, x, deviation, *where, role="physics"
    )


class Body:
    """The equations of one body: what the pure functions of the page share."""

    def __init__(self, window, scene, shape):
        self.motion, self.finger = window.motion, window.finger
        self.scene, self.shape = scene, shape
        self.corners = len(shape.corners) * bool(len(window.corner))

    def pose(self, theta, x):
        return self.motion.pose(self.shape, theta, x)

    def normal(self, theta, x, p_wf, rho):
        return self.finger.normal(self.shape, theta, self.pose(theta, x), p_wf, rho)

    def finger_gap(self, theta, x, p_wf, rho, *_):
        return self.finger.gap(self.shape, theta, self.pose(theta, x), p_wf, rho)

    def finger_velocity(self, theta, x, x_1, dt, p_wf, rho, p_wf_1, t):
        """Return v_n, v_s (2,) [m/s] of the body against a finger; v_n > 0 parts."""
        n = self.normal(theta, x, p_wf, rho)
        p_w, tangents = p_wf - rho * n, contact.tangents(n, t)
        (p, R), (p_1, R_1) = self.pose(theta, x), self.pose(theta, x_1)
        v = (p_w - p_1 - R_1 @ (R.T @ (p_w - p)) - p_wf + p_wf_1) / dt
        return -ca.dot(v, n), ca.vertcat(*(ca.dot(v, t_i) for t_i in tangents))

    def finger_impulse(self, theta, x, lam, p_wf, rho, t):
        """Return the impulse of a finger on the body, world frame [N s]."""
        n = self.normal(theta, x, p_wf, rho)
        t_1, t_2 = contact.tangents(n, t)
        return -lam[0] * n + lam[1] * t_1 + lam[2] * t_2

    def ground_gap(self, theta, x, signs):
        return self.corner(theta, x, signs)[2]

    def corner(self, theta, x, signs):
        p_wo, R_wo = self.pose(theta, x)
        return p_wo + R_wo @ self.shape.corner(theta, signs)

    def ground_velocity(self, theta, x, x_1, dt, signs):
        """Return v_n, v_s (2,) [m/s] of a corner against the ground."""
        v = (self.corner(theta, x, signs) - self.corner(theta, x_1, signs)) / dt
        return v[2], v[:2]

    def felt(self, theta, x, p_wf, rho, n_m, alpha, information):
        """Return eq:loss of a sample with contact."""
        n = self.normal(theta, x, p_wf, rho)
        cost = sensing.normal_within(n, n_m, ca.reshape(information, 3, 3))
        return cost + sensing.felt(self.finger_gap(theta, x, p_wf, rho), alpha)

    def free(self, theta, x, p_wf, rho, alpha):
        """Return eq:loss of a sample without contact."""
        return sensing.free(self.finger_gap(theta, x, p_wf, rho), alpha)

    def unpredicted(self, theta, x, x_1, x_2, dt, deviation, *impulses):
        """Return |x_t - f(x_{t-1}, lam_t, r_t)|^2 over 2 deviation^2."""
        (p, R), (p_1, R_1), (p_2, R_2) = (self.pose(theta, c) for c in (x, x_1, x_2))
        force, moment = self.applied(theta, x, *impulses)
        m, g = self.scene.mass, ca.vertcat(0, 0, -self.scene.gravity)
        p_f = p_1 + (p_1 - p_2) + (force / m + g * dt) * dt
        J = R_1 @ ca.densify(self.shape.inertia(theta)) @ R_1.T
        d_1 = turn(R_1, R_2)
        d = d_1 + ca.inv_minor(J) @ (dt * moment / m - ca.cross(d_1, J @ d_1))
        turned = ca.sumsqr(R - rotation(d) @ R_1) / 2
        return (ca.sumsqr(p - p_f) + ARM**2 * turned) / (2 * deviation**2)

    def moved(self, theta, x, x_1, deviation):
        """Return |x_t - x_{t-1}|^2 over 2 deviation^2."""
        return way_squared(self.motion, self.shape, theta, x, x_1) / (2 * deviation**2)

    def applied(self, theta, x, *impulses):
        """Return sum lam [N s] and sum r x lam [N s m] about the centroid."""
        p_wo, R_wo = self.pose(theta, x)
        ground, fingers = impulses[: 2 * self.corners], impulses[2 * self.corners :]
        force, moment = ca.DM.zeros(3), ca.DM.zeros(3)
        for lam, signs in zip(ground[::2], ground[1::2], strict=True):
            impulse = ca.vertcat(lam[1], lam[2], lam[0])
            force += impulse
            moment += ca.cross(R_wo @ self.shape.corner(theta, signs), impulse)
        for i in range(0, len(fingers), 4):
            lam, p_wf, rho, t = fingers[i : i + 4]
            impulse = self.finger_impulse(theta, x, lam, p_wf, rho, t)
            arm = p_wf - rho * self.normal(theta, x, p_wf, rho) - p_wo
            force += impulse
            moment += ca.cross(arm, impulse)
        return force, moment
