"""Compile what exploration evaluates a thousand times: a pushed step, a felt sample."""

from __future__ import annotations

from functools import cache

import casadi as ca

from formulations import exploration, pushing
from formulations.finger import SPHERE
from formulations.rigid_body import FREE, PLANAR

from .codegen import compiled
from .errors import OptionError, SceneError

ITERATIONS = 8  # of a time step: the work is then least to a micrometre
SHARE = 0.2  # [-] deviation of a predicted step, of its way
LEAST = 1e-5  # [m] and at least
ARM = 20e-3  # [m] a radian of turn counts as this much way


@cache
def pushed(shape, free: bool, fingers: int, steps: int, off=False) -> ca.Function:
    """Return (d, p, s, M, P, F; z, goal_1, goal, rho, known, sensors, sloped), all.

    s (3,): planar way of the body since x_T, d (3,): its last part; p (3 F,) [m]: where
    fingers are; goal_1, goal: where they should be, before and now; M, P, F: as in the
    page `exploration`; z: theta and x_T; known: as in `pushing`; sensors: alpha,
    sigma, sigma_n; sloped: 1, or 0 for dx_t/dx_T = I.  off: M and F have columns for
    an offset (3,) of every finger after those of z; where fingers are includes them.
    Gives the first six anew, and the probabilities (F,) that a finger feels the body.
    """
    return _step(shape, free, fingers, off).mapaccum("pushed", steps, 6)


@cache
def _step(shape, free: bool, fingers: int, off: bool) -> ca.Function:
    z, theta, pose = _unknowns(shape, free)
    rows = [slice(3 * f, 3 * f + 3) for f in range(fingers)]
    k = z.numel() + off * 3 * fingers
    p, goal_1, goal, r = (ca.SX.sym(name, 3 * fingers) for name in ("p", "g", "h", "r"))
    rho, known = ca.SX.sym("rho", fingers), ca.SX.sym("known", 5)
    sensors, sloped = ca.SX.sym("sensors", 3), ca.SX.sym("sloped")
    d, s, M = ca.SX.sym("d", 3), ca.SX.sym("s", 3), ca.SX.sym("M", 3, k)
    P, F = ca.SX.sym("P", 3, 3), ca.SX.sym("F", k, k)
    tips = [(r[at], p[at], rho[f]) for f, at in enumerate(rows)]
    body, rest = (shape, SPHERE, theta, pose), (tips, ca.vertsplit(known))
    here = shape, SPHERE, theta, pushing.moved(pose, s)
    meant = [
        pushing.reached(
            *here,
            p[at],
            goal[at],
            rho[f],
            known[4] / known[3] + ca.norm_2(goal[at] - goal_1[at]),
        )
        for f, at in enumerate(rows)
    ]

    given = [d, s, z, p, r, rho, known]
    better = pushing.improved(*body, s, d, *rest)
    better = ca.Function("improved", given, [better], {"cse": True})
    step, at = d, [s, z, p, ca.vertcat(*meant), rho, known]
    for _ in range(ITERATIONS):
        step = better(step, *at)
    D_s, D_z, D_r, p_now = _slopes(body, s, d, rest, given)(step, *at)
    D_z = ca.horzcat(D_z, D_r) if off else D_z
    now = s + step
    M_now = M + sloped * (D_s @ M + D_z)
    A = ca.DM.eye(3) + D_s
    P_now = sloped * (A @ P @ A.T + exploration.wandered(step, SHARE, LEAST, ARM))
    felt, F_now, feel = [], F, _feeling(shape, free)
    for f, p_wf in enumerate(meant):
        chance, weights, h, h_s, h_r = feel(z, now, p_wf, rho[f], sensors)
        if off:
            others = [ca.DM.zeros(4, 3) for _ in range(fingers)]
            h = ca.horzcat(h, *others[:f], h_r, *others[f + 1 :])
        felt.append(chance)
        for i in range(4):
            F_now, M_now, P_now = exploration.told(
                F_now, M_now, P_now, h[i, :], h_s[i, :], weights[i]
            )
    out = [step, p_now, now, *map(ca.densify, (M_now, P_now, F_now)), ca.vertcat(*felt)]
    given = [d, p, s, M, P, F, z, goal_1, goal, rho, known, sensors, sloped]
    return compiled([ca.Function("step", given, out, {"cse": True})])[0]


def _slopes(body, s, d, rest, given) -> ca.Function:
    """Return how the step d follows s, z and fingers that are elsewhere, and tips.

    By the implicit function theorem.
    """
    loads = ca.SX.sym("loads", 1 + len(rest[0]))
    pull = pushing.balance(*body, s, d, *rest, ca.vertsplit(loads))
    by_d, by_s, by_z, by_p, by_r = (ca.jacobian(pull, v) for v in (d, s, *given[2:5]))
    out = [-pushing.solve_3(by_d, by) for by in (by_s, by_z, by_p + by_r)]
    out.append(ca.vertcat(*pushing.tips(*body, s, d, *rest, ca.vertsplit(loads))))
    slopes = ca.Function("slopes", [*given, loads], out, {"cse": True})
    at = ca.vertcat(*pushing.loads_of(*body, s + d, *rest))
    return ca.Function("at", given, slopes(*given, at), {"cse": True})


@cache
def _feeling(shape, free: bool) -> ca.Function:
    """Return (z, s, r, rho, sensors) -> p, weights (4,), slopes by z, s and r (4, ...).

    The rows are gap and normal of one finger's sample.
    """
    z, theta, pose = _unknowns(shape, free)
    s, r, rho = ca.SX.sym("s", 3), ca.SX.sym("r", 3), ca.SX.sym("rho")
    sensors = ca.SX.sym("sensors", 3)
    alpha, sigma, sigma_n = ca.vertsplit(sensors)
    at = pushing.moved(pose, s)
    phi = SPHERE.gap(shape, theta, at, r, rho)
    sensed = ca.vertcat(phi, SPHERE.normal(shape, theta, at, r, rho))
    p, w = exploration.probability(phi, alpha), exploration.worth(phi, alpha, sigma)
    weights = ca.vertcat(w, *[p / sigma_n**2] * 3)
    slopes = [ca.densify(ca.jacobian(sensed, v)) for v in (z, s, r)]
    inputs = [z, s, r, rho, sensors]
    return ca.Function("feeling", inputs, [p, weights, *slopes], {"cse": True})


@cache
def sampled(shape, free: bool) -> ca.Function:
    """Return (z, r, rho, c, sensors) -> (k + 3, k + 3) what a sample of boolean c told.

    Of z, theta and the pose at that sample, by which slopes are taken (dx_t/dx_T = I),
    and of where the finger is.
    """
    z, theta, pose = _unknowns(shape, free)
    r, rho, c = ca.SX.sym("r", 3), ca.SX.sym("rho"), ca.SX.sym("c")
    sensors = ca.SX.sym("sensors", 3)
    phi = SPHERE.gap(shape, theta, pose, r, rho)
    n = SPHERE.normal(shape, theta, pose, r, rho)
    slopes = [ca.jacobian(v, ca.vertcat(z, r)) for v in (phi, n)]
    told = exploration.sample_information(c, phi, *slopes, *ca.vertsplit(sensors))
    inputs, out = [z, r, rho, c, sensors], [ca.densify(told)]
    return compiled([ca.Function("sampled", inputs, out, {"cse": True})])[0]


def _unknowns(shape, free: bool):
    """Return z, and the shape and the pose that it means."""
    motion = FREE if free else PLANAR
    z = ca.SX.sym("z", shape.theta + motion.unknowns)
    theta = z[: shape.theta]
    return z, theta, motion.pose(shape, theta, z[shape.theta :])


def check_ground(scene) -> None:
    """Raise SceneError without a ground: what floats is not pushed, it drifts away."""
    if scene.ground is None:
        raise SceneError(
            "no action is predicted without a ground",
            where="scene.ground",
            got="None",
            expected="the plane on which the object lies",
            next="explore with policy='random' or one of your own",
        )


def check_moves(shape) -> None:
    """Raise OptionError for a shape whose way under a push cannot be predicted."""
    if shape.inertia is None:
        raise OptionError(
            "no action is predicted for this shape",
            where="estimate.shape",
            got=shape.name,
            expected="a shape with inertia and a foot, as a cuboid has",
            next="estimate a cuboid to choose actions, or explore with "
            "policy='random' or 'farthest'",
        )
