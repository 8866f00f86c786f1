r"""Shape, friction and ground from motion alone: eq:vimp with every pose given.

    min  sum_k  balance(dv_k, dw_k, lam_k)                    momentum of every step
       + sum_kj lam_n/(lam_n + w) touch(max(phi_kj, 0))       an impulse is at phi = 0
       + sum_kj touch(max(-phi_kj, 0))                        no corner below the ground
       + sum_kj mu lam_n |v_s| + v_s . lam_t                  maximum dissipation, nats
       + priors of corners, radius, friction, inertia, ground
    s.t. lam_n >= 0,  |lam_t| <= mu lam_n
    over corners theta_j, radius, mu, inertia, lam_kj,
         the ground (one plane, and its offset in each toss)

Poses come from a camera or a motion capture (the setting of ContactNets, Pfrommer et
al. 2020): the body is unknown, its trajectory is not.  Its surface is the hull of balls
of one radius about the corners.  A cuboid reads its corners from three half widths,
sign_j * theta; a free body has a theta for each.

Departures from the printed equations, named:
  complementarity   lam_n phi as an energy would weigh an impact a hundred times as much
                    as a corner that rolls; here an impulse of any size says that its
                    corner is on the surface, as well as a tracker can tell (SURFACE)
  phi               an impulse of step k acts between the samples before and after: the
                    least of three gaps, less the dip that the change of velocity admits
  dissipation       v_s lam_n mu |v_s| instead of lam_n |v_s|^2, see violation_implicit
  balance           pseudo-Huber: an impact is not rigid, and Coulomb is not exact
  radius            enters the gap only: the arm of an impulse changes by a hundredth
  ground            the tracker's frame is not the ground's: a height and two slopes,
                    which wander a little from toss to toss
"""

from __future__ import annotations

import casadi as ca

from . import contact, sensing
from .friction import cone, friction, impulses
from .level import Level
from .rigid_body import G
from .shape import positive_part

LEVELS = (Level("joint", ipopt={"mu_init": 1.0, "max_iter": 500}),)

SURFACE = 0.5e-3  # [m] deviation of a touching corner from the ground: tracking
EDGE = 0.2e-3  # [m] rounds max(phi, 0)
KAPPA = 1.0  # [nats] for friction that fails to dissipate a weight moved by 1 mm
V_EPS = 10e-3  # [m/s] rounds the sliding speed: 0.07 mm in a step of 1/148 s
ROUND = 0.01  # [weights] rounds the apex of the friction cone
BITE = 0.25  # [weights] an impulse of that size is half a touch
SIZE = 20e-3  # [m] deviation of a corner from its first guess
ROUNDING = 3e-3  # [m] deviation of the radius of edges and corners, about zero
HEIGHT, SLOPE = 0.5e-3, 0.02  # [m], [1] of the ground, about the scene's
WANDER = (0.3e-3, 3e-3, 3e-3)  # [m], [1] by which a toss sees another ground
SPREAD = 0.3  # [1] deviation of the inertia from that of a uniform body


def build(nlp, window, scene):
    """Fill `nlp` with the motion of `window`: steps, touches, corners."""
    step, touch = window.step, window.touch
    w = scene.mass * G * window.dt  # [N s]
    theta = nlp.variable(
        "theta", 3, window.columns, guess=window.guess, unit="m", scale=1e-3
    )
    radius = nlp.variable(
        "radius", 1, lower=0.0, upper=0.05, guess=1e-3, unit="m", scale=1e-3
    )
    mu = friction(nlp, "friction", None)
    inertia = nlp.variable(
        "inertia", 3, lower=0.1, upper=10.0, guess=1.0, unit="of a uniform body",
        scale=0.1,
    )  # fmt: skip
    plane, offset = (
        nlp.variable(name, 3, n, guess=0.0, unit="m, 1, 1", scale=(1e-3, 1e-2, 1e-2))
        for name, n in (("plane", 1), ("offset", window.tosses))
    )
    weight = [w] * len(touch)
    lam = impulses(nlp, "ground", weight, w, w / 4)
    fall = nlp.parameter("fall", [scene.mass, scene.gravity, window.dt], "kg, m/s^2, s")
    uniform = nlp.parameter("uniform inertia", window.uniform, "m^2")
    surface = nlp.parameter("surface", SURFACE, "m")

    for count, g in window.groups.items():
        rows, acting = g.steps, []
        for c in g.touches.T:
            acting += [lam[:, c], theta[:, touch.column[c]], touch.sign[c]]
        nlp.minimize(
            f"balance, {count} touching", imbalance, plane,
            offset[:, step.toss[rows]], inertia, fall, uniform, step.noise[rows],
            step.dv[rows], step.w[rows], step.w_1[rows], step.R_half[rows],
            step.R_half_1[rows], step.R_wo[rows], *acting, role="likelihood",
        )  # fmt: skip

    s = touch.step
    ground = plane, offset[:, step.toss[s]]
    corner = theta[:, touch.column], touch.sign
    now = step.p_wo[s], step.R_wo[s]
    around = step.p_wo_1[s], step.R_wo_1[s], step.p_wo_2[s], step.R_wo_2[s]
    nlp.minimize(
        "on the surface", touching, *ground, radius, *corner, lam, weight, surface,
        *now, *around, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "not below", penetration, *ground, radius, *corner, surface, *now,
        role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "dissipation", sliding, *ground, *corner, lam, mu, fall, weight, *around,
        role="physics",
    )  # fmt: skip
    nlp.parameter("cone rounding", ROUND, "weights")
    cone(nlp, "ground", lam, mu, weight)
    nlp.report("world impulse", in_world, *ground, lam)

    for x, mean, deviation in (
        (theta, window.guess.T, SIZE),
        (radius, 0.0, ROUNDING),
        (inertia, 1.0, SPREAD),
        (plane, 0.0, ca.DM([HEIGHT, SLOPE, SLOPE])),
        (offset, 0.0, ca.DM(WANDER)),
    ):
        nlp.minimize(f"{x.name} prior", gaussian(deviation), x, mean, role="prior")


def gaussian(deviation):
    """Return the cost of a value with a mean and a deviation."""
    return lambda x, mean: ca.sumsqr((x - mean) / deviation) / 2


def frame(plane, offset):
    """Return the unit normal and two tangents of the ground z = a + b x + c y."""
    level = plane + offset
    n = ca.vertcat(-level[1], -level[2], 1)
    n = n / ca.norm_2(n)
    return n, *contact.tangents(n, ca.DM([1, 0, 0]))


def place(p_wo, R_wo, theta, sign):
    """Return a corner of the body [m], world frame; R_wo (9,) column by column."""
    return p_wo + ca.reshape(R_wo, 3, 3) @ (sign * theta)


def gap(plane, offset, p_w):
    """Return the height [m] of a point over the ground."""
    level, (n, _, _) = plane + offset, frame(plane, offset)
    return n[2] * (p_w[2] - level[0] - level[1] * p_w[0] - level[2] * p_w[1])


def in_world(plane, offset, lam):
    """Return an impulse (normal, t1, t2) in the world frame [N s]."""
    n, t_1, t_2 = frame(plane, offset)
    return lam[0] * n + lam[1] * t_1 + lam[2] * t_2


def imbalance(
    plane, offset, inertia, fall, uniform, noise, dv, w, w_1, R_wo, R_wo_1, R_now,
    *acting,
):  # fmt: skip
    """Momentum change less impulses, in deviations `noise` (2,) [m/s], [rad/s].

    R_wo, R_wo_1: halfway to the next and from the last sample, where w and w_1 are.
    """
    m, g, dt = fall[0], fall[1], fall[2]
    R, R_1, R_0 = (ca.reshape(r, 3, 3) for r in (R_wo, R_wo_1, R_now))
    body = ca.diag(uniform * inertia)
    linear = dv + ca.vertcat(0, 0, g * dt)
    angular = R @ body @ R.T @ w - R_1 @ body @ R_1.T @ w_1
    for lam, theta, sign in zip(*(acting[i::3] for i in range(3)), strict=True):
        impulse = in_world(plane, offset, lam) / m
        linear -= impulse
        angular -= ca.cross(R_0 @ (sign * theta), impulse)
    turn = (R_0.T @ angular) / (uniform * inertia)  # [rad/s]: what the tracker errs in
    off = ca.sumsqr(linear / noise[0]) + ca.sumsqr(turn / noise[1])
    return 4 * (ca.sqrt(1 + off / 4) - 1)


def touching(
    plane, offset, radius, theta, sign, lam, w, surface, p, R, p_1, R_1, p_2, R_2
):  # fmt: skip
    """An impulse acts where the corner is on the ground, or dips to it on the way."""
    now, before, after = (
        gap(plane, offset, place(p, R, theta, sign)) - radius
        for p, R in ((p, R), (p_1, R_1), (p_2, R_2))
    )
    dip = positive_part(before - 2 * now + after, EDGE) / 2
    lowest = lesser(lesser(now, before), after) - dip
    off = sensing.touch(positive_part(lowest, EDGE), surface)
    return lam[0] / (lam[0] + BITE * w) * off


def lesser(a, b):
    """Return the lesser of two gaps, rounded over EDGE."""
    return (a + b - ca.sqrt((a - b) ** 2 + EDGE**2)) / 2


def penetration(plane, offset, radius, theta, sign, surface, p_wo, R_wo):
    """No corner is below the ground by more than the tracker's error."""
    phi = gap(plane, offset, place(p_wo, R_wo, theta, sign)) - radius
    return sensing.touch(positive_part(-phi, EDGE), surface)


def sliding(plane, offset, theta, sign, lam, mu, fall, w, p_1, R_1, p_2, R_2):
    """Friction opposes sliding; at rest, nothing is paid."""
    dt, (_, t_1, t_2) = fall[2], frame(plane, offset)
    v = (place(p_2, R_2, theta, sign) - place(p_1, R_1, theta, sign)) / (2 * dt)
    v_s = ca.vertcat(ca.dot(v, t_1), ca.dot(v, t_2))
    lost = contact.dissipation(mu, lam, v_s, V_EPS, ROUND * w)
    return KAPPA * (lost - ROUND * w * V_EPS) * dt / (w * 1e-3)
