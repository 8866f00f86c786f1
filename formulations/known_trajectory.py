r"""Shape, friction and ground from motion alone: eq:vimp with every pose given.

    min  sum_k  imbalance(dv_k, domega_k, lam_k)              momentum of every step
       + sum_kj lam_n/(lam_n + BITE w) touch(max(phi_kj, 0))  an impulse is at phi = 0
       + sum_kj touch(max(-phi_kj, 0))                        no corner below the ground
       + sum_kj sliding(lam_kj, v_s)                          maximum dissipation, nats
       + sum_kj LEAST |lam_kj / w|^2                          least impulse, friction.py
       + ((y - mean) / deviation)^2 / 2                       priors, y = theta, radius,
                                                              inertia, plane, offset
       + (mu - 0.4)^2 / (2 0.3^2)                             prior, friction.py
    s.t. lam_n >= 0,  |lam_t| <= mu lam_n
    over corners theta_j, radius, mu, inertia, lam_kj,
         the ground (one plane, and its offset in each toss)

The terms are in known_trajectory_terms.py, the cone is in friction.py.

Poses come from a camera or a motion capture (the setting of ContactNets, Pfrommer et
al. 2020): the body is unknown, its trajectory is not.  Its surface is the hull of balls
of one radius about the corners.  A cuboid reads its corners from three half widths,
sign_j * theta; a free body has a theta for each.

Departures from the printed equations:
  complementarity   the energy lam_n phi would weigh an impact a hundred times as much
                    as a corner that rolls; here an impulse of any size means that its
                    corner is on the surface, within the tracker's error (SURFACE)
  phi               an impulse of step k acts between the samples before and after: the
                    least of three gaps, less the dip that the change of velocity admits
  dissipation       mu lam_n |v_s| instead of lam_n |v_s|^2, see violation_implicit.py
  balance           pseudo-Huber: an impact is not rigid, and Coulomb is not exact
  radius            enters the gap only: the arm of an impulse changes by a hundredth
  ground            the tracker's frame is not the ground's: a height and two slopes,
                    which change a little from toss to toss
"""

from __future__ import annotations

import casadi as ca

from .friction import Impulses, add_cone, friction, impulses
from .known_trajectory_terms import (
    CONE_ROUNDING,
    Ground,
    Pose,
    StepMotion,
    Touch,
    Vertex,
    cuboid_imbalance,
    gaussian,
    imbalance,
    penetration,
    sliding,
    touching,
)
from .level import Level
from .names import BALANCE, NOT_BELOW, ON_SURFACE, WORLD_IMPULSE
from .rigid_body import G

LEVELS = (Level("joint", ipopt={"mu_init": 1.0, "max_iter": 500}),)

SURFACE = 0.5e-3  # [m] deviation of a touching corner from the ground: tracking
SIZE = 20e-3  # [m] deviation of a corner from its first guess
EDGE_RADIUS = 3e-3  # [m] deviation of the radius of edges and corners, about zero
HEIGHT, SLOPE = 0.5e-3, 0.02  # [m], [1] of the ground, about the scene's
WANDER = (0.3e-3, 3e-3, 3e-3)  # [m], [1] by which a toss sees another ground
INERTIA = 0.3  # [1] deviation of the inertia from that of a uniform body


def build(nlp, window, scene):
    """Fill `nlp` with the motion of `window`: steps, touches, corners."""
    touch, step = window.touch, window.step
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
    lam = impulses(nlp, "ground", len(touch), w, w / 4)
    fall = nlp.parameter("fall", [scene.mass, scene.gravity, window.dt], "kg, m/s^2, s")
    nlp.parameter("surface", SURFACE, "m")
    uniform = theta  # a cuboid's follows from its half widths, a free body's is guessed
    if window.columns > 1:
        uniform = nlp.parameter("uniform inertia", window.uniform, "m^2")
    balance(nlp, window, plane, offset, inertia, fall, uniform, theta, lam)
    ground = Ground(plane, offset[:, step.toss[touch.step]])
    corner = Vertex(theta[:, touch.column], touch.sign)
    pushes = Impulses(lam, mu, [w] * len(touch))
    contacts(nlp, window, ground, radius, corner, pushes, fall)
    for x, mean, deviation in (
        (theta, window.guess.T, SIZE),
        (radius, 0.0, EDGE_RADIUS),
        (inertia, 1.0, INERTIA),
        (plane, 0.0, ca.DM([HEIGHT, SLOPE, SLOPE])),
        (offset, 0.0, ca.DM(WANDER)),
    ):
        nlp.minimize(f"{x.name} prior", gaussian(deviation), x, mean, role="prior")


def balance(nlp, window, plane, offset, inertia, fall, uniform, theta, lam):
    """Add the balance of every step, by number of corners that may touch.

    uniform: the inertia per mass [m^2] of a uniform body, or the half widths of one.
    """
    touch, law = window.touch, imbalance if window.columns > 1 else cuboid_imbalance
    for count, g in window.groups.items():
        ground = Ground(plane, offset[:, window.step.toss[g.steps]])
        s = window.step.pick(g.steps)
        motion = StepMotion(s.noise, s.dv, s.w, s.w_1, s.R_half, s.R_half_1, s.R_wo)
        touches = [
            Touch(lam[:, c], Vertex(theta[:, touch.column[c]], touch.sign[c]))
            for c in g.touches.T
        ]
        nlp.minimize(
            f"{BALANCE}, {count} touching", law, ground, inertia, fall, uniform,
            motion, *touches, role="likelihood",
        )  # fmt: skip


def contacts(nlp, window, ground, radius, corner, impulses, fall):
    """Add where corners are when they touch, maximum dissipation, and the cone.

    ground, corner, impulses (friction.Impulses): of every touch.
    """
    s, surface = window.step.pick(window.touch.step), nlp.parameters["surface"]
    lam, mu, w = impulses.lam, impulses.mu, impulses.w
    now, before = Pose(s.p_wo, s.R_wo), Pose(s.p_wo_1, s.R_wo_1)
    after = Pose(s.p_wo_next, s.R_wo_next)
    nlp.minimize(
        ON_SURFACE, touching, ground, radius, corner, lam, w, surface, now,
        before, after, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        NOT_BELOW, penetration, ground, radius, corner, s.depth, now, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "dissipation", sliding, ground, corner, lam, mu, fall, w, before, after,
        role="physics",
    )  # fmt: skip
    nlp.parameter("cone rounding", CONE_ROUNDING, "weights")
    add_cone(nlp, "ground", impulses)
    nlp.report(WORLD_IMPULSE, Ground.in_world, ground, lam)
