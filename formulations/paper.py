r"""The printed problem, literally: eq:vimp, with eq:loss for what the fingers felt.

    min  sum_t  c_t/2 |n_m - n_t|^2_{Sigma_n^-1}                             eq:norm
              + [(c_t - 1) alpha phi_t + log(1 + exp(alpha phi_t))]          eq:bool
       + sum_t  |x_{t+1} - f_theta(x_t, lam_t, r_t)|^2                       dynamics
       + sum_t  lam_n phi_t                                     (1) complementarity
              + |v_s|^2 lam_n + v_s . lam_t                     (2) maximum dissipation
              + min(0, phi_t)^2                                 (3) non-penetration
              + lam_n max(v_n, 0)                               (4) inelasticity
    s.t. lam in FC = {|lam_t| <= mu lam_n}
    over theta, x_t, lam_t

f is one impulse-momentum step from x_{t-1} (and the velocity it came with):

    p_f = p + (p - p_1) + (sum lam / m + g dt) dt
    R_f = exp(d + J^-1 (dt sum r x lam / m - d x J d)) R,   d = vee log(R R_1')

The inner minimum over lam and the outer one over theta, x are one joint minimum.

Not printed, chosen here: every weight but alpha and Sigma_n (public code); an impulse
acts over the step that *ends* at t, so that phi, n, v are taken where it is felt; mu is
known, or an unknown with a prior; |R - R_f|^2 is that of rotation matrices over ARM^2;
between actions f has no impulse and no velocity, so x stays.

Departures, all of them:
  lam_n <= MOST      else unbounded below: two fingers that squeeze a body without
                     moving it raise lam_n at no cost, and where phi < 0 or |v_s| < mu
                     (in m/s!) (1) and (2) pay for it.
  (4)                max(v_n, 0) has a kink; rounded over STILL it is STILL / 2 too
                     large where v_n = 0 and less elsewhere.
  FC                 (mu lam_n)^2 - |lam_t|^2 >= 0 with lam_n >= 0: the same set, but
                     the gradient vanishes at the apex, where no multiplier exists.  The
                     first level opens the cone (`cone slack`), the last one does not.
  (3)                exact; its curvature jumps at phi = 0, which Newton steps across.
  gap, normal        edges rounded as on every page (see shape.py)
"""

from __future__ import annotations

import math

import casadi as ca

from . import contact, sensing
from .level import Level
from .rigid_body import rotation, turn
from .violation_implicit import friction

ALPHA = math.log(19) / 5e-3  # [1/m] of eq:bool: 95 % sure 5 mm away (public code)
SIGMA_N = 0.01519 * ca.DM.eye(3)  # [rad^2] of eq:norm (public code)
# What follows is not printed.
DYNAMICS = 0.3e-3  # [m] deviation of a pose from its prediction
ARM = 20e-3  # [m] one radian of turn counts as this much way
LIFT = 1e-3  # [m] an energy is compared with that of lifting the object so far
COMPLEMENTARITY = 5.0  # [nats] for one such energy
DISSIPATION = 5.0  # [nats] likewise
INELASTICITY = 1.0  # [nats] likewise
PENETRATION = 0.1e-3  # [m] deviation of a gap below zero
STILL = 0.1e-3  # [m/s] rounds max(v_n, 0)
MOST = 5.0  # [weights] of the normal impulse of one contact
G = 9.81  # [m/s^2] makes a weight of a mass, also where nothing falls

LEVELS = (
    Level(
        "impulses",
        {"cone slack": 0.01, "still": 6e-3},
        fixed=("theta", "x"),
        barrier=1e-1,
    ),
    Level("joint", barrier=1e-3),
)


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step."""
    body = Body(window, scene, shape)
    theta, x = likelihood(nlp, window, shape, body)
    step, push, corner = window.step, window.push, window.corner
    size = scene.mass * G * (step.dt.mean() if len(step) else 1.0)  # [N s]
    low, high = [0, -ca.inf, -ca.inf], [MOST * size, ca.inf, ca.inf]
    lam = nlp.variable(
        "finger", 3, len(push), lower=low, upper=high, guess=[size / 10, 0, 0],
        unit="N s", scale=size,
    )  # fmt: skip
    lam_g = nlp.variable(
        "ground", 3, len(corner), lower=low, upper=high,
        guess=[size / body.shared, 0, 0], unit="N s", scale=size,
    )  # fmt: skip
    dynamics(nlp, window, body, theta, x, lam, lam_g)
    at_fingers(nlp, window, scene, body, theta, x, lam)
    at_ground(nlp, window, scene, body, theta, x, lam_g)


def likelihood(nlp, window, shape, body):
    """Declare theta and x; add eq:loss of every sample."""
    low, high = shape.bounds
    theta = nlp.variable(
        "theta", shape.theta, lower=low, upper=high, guess=shape.size_prior[0],
        unit="m", scale=1e-3,
    )  # fmt: skip
    x = nlp.variable(
        "x", window.motion.unknowns, window.knots, guess=0.0, unit=window.motion.unit,
        scale=window.motion.scale,
    )  # fmt: skip
    alpha = nlp.parameter("alpha", ALPHA, "1/m")
    information = nlp.parameter(
        "normal information", ca.vec(ca.densify(ca.inv(SIGMA_N))), "1/rad^2"
    )
    t, f = window.touch, window.free
    nlp.minimize(
        "touch", body.felt, theta, x[:, t.knot], t.p_wf, t.radius, t.normal, alpha,
        information, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "free", body.free, theta, x[:, f.knot], f.p_wf, f.radius, alpha,
        role="likelihood",
    )  # fmt: skip
    return theta, x


def dynamics(nlp, window, body, theta, x, lam, lam_g):
    """Add |x_{t+1} - f_theta(x_t, lam_t, r_t)|^2, by number of pushing fingers."""
    step, push, corner, gap = window.step, window.push, window.corner, window.gap
    deviation = nlp.parameter("dynamics deviation", DYNAMICS, "m")
    for count, g in window.groups.items():
        impulses = []
        for c in g.corners.T:
            impulses += [lam_g[:, c], corner.signs[c]]
        for j in g.pushes.T:
            impulses += [lam[:, j], push.p_wf[j], push.radius[j], push.tangent[j]]
        s = g.steps
        nlp.minimize(
            f"dynamics, {count} pushing", body.unpredicted, theta, x[:, step.knot[s]],
            x[:, step.before[s]], x[:, step.before_2[s]], step.dt[s], deviation,
            *impulses, role="physics",
        )  # fmt: skip
    nlp.minimize(
        "between actions", body.moved, theta, x[:, gap.knot], x[:, gap.before],
        deviation, role="physics",
    )  # fmt: skip


def at_fingers(nlp, window, scene, body, theta, x, lam):
    """Add the four terms of g and the friction cone of every finger."""
    step, push = window.step, window.push
    s = push.step
    now = (theta, x[:, step.knot[s]])
    where = (push.p_wf, push.radius)
    motion = (*now, x[:, step.before[s]], lam, push.p_wf, push.p_wf_1, push.radius)
    w = scene.mass * G * step.dt[s]
    nlp.minimize(
        "finger complementarity", body.finger_complementarity, *now, lam, *where, w,
        nlp.parameter("complementarity", COMPLEMENTARITY, "nats"), role="physics",
    )  # fmt: skip
    nlp.minimize(
        "finger dissipation", body.finger_dissipation, *motion, push.tangent,
        step.dt[s], w, nlp.parameter("dissipation", DISSIPATION, "nats"),
        role="physics",
    )  # fmt: skip
    nlp.minimize(
        "finger inelasticity", body.finger_inelasticity, *motion, step.dt[s], w,
        nlp.parameter("inelasticity", INELASTICITY, "nats"),
        nlp.parameter("still", STILL, "m/s"), role="physics",
    )  # fmt: skip
    deviation = nlp.parameter("penetration deviation", PENETRATION, "m")
    for name, f in (("touch", window.touch), ("free", window.free)):
        nlp.minimize(
            f"{name} penetration", body.finger_penetration, theta, x[:, f.knot],
            f.p_wf, f.radius, deviation, role="physics",
        )  # fmt: skip
    mu = friction(nlp, "finger friction", scene.friction_finger)
    slack = nlp.parameter("cone slack", 0.0, "weights")
    nlp.subject_to("finger cone", cone, lam, mu, w, slack, lower=0)
    nlp.report(
        "finger impulse", body.finger_impulse, *now, lam, *where, push.tangent
    )


def at_ground(nlp, window, scene, body, theta, x, lam_g):
    """Add the four terms of g and the friction cone of every corner on the ground.

    Where no corner can leave the ground, phi = v_n = 0 and (2) is all there is of g.
    """
    p, corner, lift, rest = nlp.parameters, window.corner, window.lift, window.rest
    step = window.step
    s, up = corner.step, lift.step
    dt, w = step.dt[s], scene.mass * G * step.dt[s]
    nlp.minimize(
        "ground dissipation", body.ground_dissipation, theta, x[:, step.knot[s]],
        x[:, step.before[s]], lam_g, corner.signs, dt, w, p["dissipation"],
        role="physics",
    )  # fmt: skip
    lifted = (theta, x[:, step.knot[up]])
    lam_up, w_up = lam_g[:, : len(up)], w[: len(up)]
    nlp.minimize(
        "ground complementarity", body.ground_complementarity, *lifted, lam_up,
        lift.signs, w_up, p["complementarity"], role="physics",
    )  # fmt: skip
    nlp.minimize(
        "ground inelasticity", body.ground_inelasticity, *lifted,
        x[:, step.before[up]], lam_up, lift.signs, dt[: len(up)], w_up,
        p["inelasticity"], p["still"], role="physics",
    )  # fmt: skip
    for name, knot, signs in (
        ("ground penetration", step.knot[up], lift.signs),
        ("rest penetration", rest.knot, rest.signs),
    ):
        nlp.minimize(
            name, body.ground_penetration, theta, x[:, knot], signs,
            p["penetration deviation"], role="physics",
        )  # fmt: skip
    mu = friction(nlp, "ground friction", scene.friction_ground)
    nlp.subject_to("ground cone", cone, lam_g, mu, w, p["cone slack"], lower=0)
    nlp.report("ground impulse", lambda lam: lam[[1, 2, 0]], lam_g)


def cone(lam, mu, w, slack):
    """Inside the friction cone, in weights squared."""
    return contact.cone_squared(mu, lam / w) + slack**2


def work(energy, w, nats):
    """Return `nats` for an energy over one step [N s m] that lifts the object by LIFT."""
    return nats * energy / (w * LIFT)


class Body:
    """The equations of one body: what the pure functions of the page share."""

    def __init__(self, window, scene, shape):
        self.motion, self.finger = window.motion, window.finger
        self.scene, self.shape = scene, shape
        self.shared = max(1, len(shape.corners))
        self.corners = self.shared * bool(len(window.corner))

    def pose(self, theta, x):
        return self.motion.pose(self.shape, theta, x)

    def gap(self, theta, x, p_wf, rho):
        return self.finger.gap(self.shape, theta, self.pose(theta, x), p_wf, rho)

    def normal(self, theta, x, p_wf, rho):
        return self.finger.normal(self.shape, theta, self.pose(theta, x), p_wf, rho)

    def corner(self, theta, x, signs):
        p_wo, R_wo = self.pose(theta, x)
        return p_wo + R_wo @ self.shape.corner(theta, signs)

    def felt(self, theta, x, p_wf, rho, n_m, alpha, information):
        """Return eq:loss of a sample with contact."""
        n = self.normal(theta, x, p_wf, rho)
        cost = sensing.normal_within(n, n_m, ca.reshape(information, 3, 3))
        return cost + sensing.felt(self.gap(theta, x, p_wf, rho), alpha)

    def free(self, theta, x, p_wf, rho, alpha):
        """Return eq:loss of a sample without contact."""
        return sensing.free(self.gap(theta, x, p_wf, rho), alpha)

    def unpredicted(self, theta, x, x_1, x_2, dt, deviation, *impulses):
        """Return |x_t - f(x_{t-1}, lam_t, r_t)|^2 over 2 deviation^2."""
        (p, R), (p_1, R_1), (p_2, R_2) = (self.pose(theta, c) for c in (x, x_1, x_2))
        force, moment = ca.DM.zeros(3), ca.DM.zeros(3)
        for arm, lam_w in self._applied(theta, x, impulses):
            force += lam_w
            moment += ca.cross(arm, lam_w)
        m, fall = self.scene.mass, ca.vertcat(0, 0, -self.scene.gravity * dt)
        p_f = p_1 + (p_1 - p_2) + (force / m + fall) * dt
        J = R_1 @ ca.densify(self.shape.inertia(theta)) @ R_1.T
        d = turn(R_1, R_2)
        d += ca.inv_minor(J) @ (dt * moment / m - ca.cross(d, J @ d))
        R_f = rotation(d) @ R_1
        return distance_squared((p, R), (p_f, R_f)) / (2 * deviation**2)

    def moved(self, theta, x, x_1, deviation):
        """Return |x_t - x_{t-1}|^2 over 2 deviation^2: f without velocity or impulse."""
        poses = self.pose(theta, x), self.pose(theta, x_1)
        return distance_squared(*poses) / (2 * deviation**2)

    def _applied(self, theta, x, impulses):
        """Return (lever arm [m], impulse [N s]) of every contact, world frame."""
        p_wo, R_wo = self.pose(theta, x)
        ground, fingers = impulses[: 2 * self.corners], impulses[2 * self.corners :]
        applied = []
        for lam, signs in zip(ground[::2], ground[1::2], strict=True):
            arm = R_wo @ self.shape.corner(theta, signs)
            applied.append((arm, ca.vertcat(lam[1], lam[2], lam[0])))
        for i in range(0, len(fingers), 4):
            lam, p_wf, rho, t = fingers[i : i + 4]
            p_w = p_wf - rho * self.normal(theta, x, p_wf, rho)
            lam_w = self.finger_impulse(theta, x, lam, p_wf, rho, t)
            applied.append((p_w - p_wo, lam_w))
        return applied

    def finger_impulse(self, theta, x, lam, p_wf, rho, t):
        """Return the impulse of a finger on the body, world frame [N s]."""
        n = self.normal(theta, x, p_wf, rho)
        t_1, t_2 = contact.tangents(n, t)
        return -lam[0] * n + lam[1] * t_1 + lam[2] * t_2

    def finger_velocity(self, theta, x, x_1, p_wf, p_wf_1, rho, dt):
        """Return normal, and velocity of body against finger where they touch [m/s]."""
        n = self.normal(theta, x, p_wf, rho)
        p_w = p_wf - rho * n
        (p, R), (p_1, R_1) = self.pose(theta, x), self.pose(theta, x_1)
        return n, (p_w - p_1 - R_1 @ (R.T @ (p_w - p)) - p_wf + p_wf_1) / dt

    def finger_complementarity(self, theta, x, lam, p_wf, rho, w, nats):
        phi = self.gap(theta, x, p_wf, rho)
        return work(contact.printed_complementarity(lam, phi), w, nats)

    def finger_dissipation(self, theta, x, x_1, lam, p_wf, p_wf_1, rho, t, dt, w, nats):
        n, v = self.finger_velocity(theta, x, x_1, p_wf, p_wf_1, rho, dt)
        v_s = ca.vertcat(*(ca.dot(v, tangent) for tangent in contact.tangents(n, t)))
        return work(contact.printed_dissipation(lam, v_s) * dt, w, nats)

    def finger_inelasticity(
        self, theta, x, x_1, lam, p_wf, p_wf_1, rho, dt, w, nats, still
    ):
        n, v = self.finger_velocity(theta, x, x_1, p_wf, p_wf_1, rho, dt)
        return work(contact.inelasticity(lam, -ca.dot(v, n), still) * dt, w, nats)

    def finger_penetration(self, theta, x, p_wf, rho, deviation):
        phi = self.gap(theta, x, p_wf, rho)
        return contact.penetration_squared(phi) / (2 * deviation**2)

    def ground_complementarity(self, theta, x, lam, signs, w, nats):
        phi = self.corner(theta, x, signs)[2]
        return work(contact.printed_complementarity(lam, phi), w, nats)

    def ground_dissipation(self, theta, x, x_1, lam, signs, dt, w, nats):
        v = (self.corner(theta, x, signs) - self.corner(theta, x_1, signs)) / dt
        return work(contact.printed_dissipation(lam, v[:2]) * dt, w, nats)

    def ground_inelasticity(self, theta, x, x_1, lam, signs, dt, w, nats, still):
        v = (self.corner(theta, x, signs) - self.corner(theta, x_1, signs)) / dt
        return work(contact.inelasticity(lam, v[2], still) * dt, w, nats)

    def ground_penetration(self, theta, x, signs, deviation):
        phi = self.corner(theta, x, signs)[2]
        return contact.penetration_squared(phi) / (2 * deviation**2)


def distance_squared(pose, pose_f):
    """Return the squared distance of two poses [m^2], a turn counted over ARM."""
    (p, R), (p_f, R_f) = pose, pose_f
    return ca.sumsqr(p - p_f) + ARM**2 * ca.sumsqr(R - R_f) / 2
