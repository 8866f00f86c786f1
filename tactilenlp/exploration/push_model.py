"""Compile what exploration evaluates a thousand times: a pushed step, a felt sample."""

from __future__ import annotations

from functools import cache

import casadi as ca

from formulations import exploration, pushed_hull, pushing
from formulations.finger import SPHERE
from formulations.rigid_body import FREE, PLANAR

from ..errors import OptionError, SceneError
from ..nlp.codegen import compiled
from ..problem.reductions import ARM

ITERATIONS = 8  # of a time step: the work is then least to a micrometre
REMEMBERED = 30  # samples of one call
SHARE = 0.2  # [-] deviation of a predicted step, of its way
LEAST_SPREAD = 1e-5  # [m] and at least


@cache
def pushed(shape, free: bool, fingers: int, steps: int, off=False) -> ca.Function:
    """Return (d, p, s, M, P; z, goal_1, goal, rho, known, sensors, sloped), all.

    s (3,): planar way of the body since x_T, d (3,): its last part; p (3 F,) [m]: where
    fingers are; goal_1, goal: where they should be, before and now; M, P: as in the
    page `exploration`; z: theta and x_T; known: as in `pushing`; sensors: alpha,
    sigma, sigma_n; sloped: 1, or 0 for dx_t/dx_T = I.  off: M has columns for an
    offset (3,) of every finger after those of z; where fingers are includes them.
    Gives the first five anew, the probabilities (F,) that a finger feels the body, and
    E (4 F, k): E'E is what the fingers tell.
    """
    return _step(shape, free, fingers, off).mapaccum("pushed", steps, 5)


@cache
def _step(shape, free: bool, fingers: int, off: bool) -> ca.Function:
    sym = shape.symbol
    z, theta, pose = _unknowns(shape, free)
    k = z.numel() + off * 3 * fingers
    p, goal_1, goal, r = (sym(name, 3 * fingers) for name in ("p", "g", "h", "r"))
    rho, known = sym("rho", fingers), sym("known", 5)
    sensors, sloped = sym("sensors", 3), sym("sloped")
    d, s, M = sym("d", 3), sym("s", 3), sym("M", 3, k)
    P = sym("P", 3, 3)
    body, laws = (shape, SPHERE, theta, pose), ca.vertsplit(known)
    here = shape, SPHERE, theta, pushing.moved(pose, s)
    meant = _meant(here, p, goal_1, goal, rho, laws)

    tips = [*zip(*map(_triples, (r, p)), ca.vertsplit(rho), strict=True)]
    rest, given = (tips, [*laws, _foot(*body)]), [d, s, z, p, r, rho, known]
    better = pushing.improved(*body, s, d, *rest)
    better = ca.Function("improved", given, [better], {"cse": True})
    step, at = d, [s, z, p, ca.vertcat(*meant), rho, known]
    for _ in range(ITERATIONS):
        step = better(step, *at)
    D_s, D_z, D_r, p_now = _slopes(body, s, d, rest, given)(step, *at)
    D_z = ca.horzcat(D_z, D_r) if off else D_z
    now, A = s + step, ca.DM.eye(3) + D_s
    M_now = M + sloped * (D_s @ M + D_z)
    P_now = sloped * (
        A @ P @ A.T + exploration.process_noise(step, SHARE, LEAST_SPREAD, ARM)
    )
    felt, told, feel = [], [], _feeling(shape, free)
    for f, p_wf in enumerate(meant):
        chance, weights, h, h_s, h_r = feel(z, now, p_wf, rho[f], sensors)
        if off:
            others = [ca.DM.zeros(4, 3) for _ in range(fingers)]
            h = ca.horzcat(h, *others[:f], h_r, *others[f + 1 :])
        felt.append(chance)
        rows, M_now, P_now = _sample_told(M_now, P_now, h, h_s, weights)
        told += rows
    out = [step, p_now, now, M_now, P_now, ca.vertcat(*felt), ca.vertcat(*told)]
    given = [d, p, s, M, P, z, goal_1, goal, rho, known, sensors, sloped]
    out = [ca.densify(v) for v in out]
    return compiled([ca.Function("step", given, out, {"cse": True})])[0]


def _meant(here, p, goal_1, goal, rho, laws) -> list:
    """Return where each finger is meant to be, no deeper than its servo presses."""
    ways = zip(*map(_triples, (p, goal_1, goal)), ca.vertsplit(rho), strict=True)
    deep = laws[4] / laws[3]
    return [
        pushing.reached(*here, p_wf, to, size, deep + ca.norm_2(to - before))
        for p_wf, before, to, size in ways
    ]


def _sample_told(M, P, h, h_s, weights):
    """Return rows of what the four numbers of one sample tell, and M, P after it."""
    rows = []
    for i in range(4):
        e, M, P = exploration.measurement_update(M, P, h[i, :], h_s[i, :], weights[i])
        rows.append(e)
    return rows, M, P


def _triples(column) -> list:
    return ca.vertsplit(column, 3)


def _slopes(body, s, d, rest, given) -> ca.Function:
    """Return how the step d follows s, z and fingers that are elsewhere, and tips.

    By the implicit function theorem.
    """
    loads = body[0].symbol("loads", 1 + len(rest[0]))
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
    s, r, rho, sensors = (shape.symbol("in", n) for n in (3, 3, 1, 3))
    alpha, sigma, sigma_n = ca.vertsplit(sensors)
    at = pushing.moved(pose, s)
    phi = SPHERE.gap(shape, theta, at, r, rho)
    sensed = ca.vertcat(phi, SPHERE.normal(shape, theta, at, r, rho))
    p, w = (
        exploration.probability(phi, alpha),
        exploration.gap_information(phi, alpha, sigma),
    )
    weights = ca.vertcat(w, *[p / sigma_n**2] * 3)
    slopes = [ca.densify(ca.jacobian(sensed, v)) for v in (z, s, r)]
    inputs = [z, s, r, rho, sensors]
    return ca.Function("feeling", inputs, [p, weights, *slopes], {"cse": True})


@cache
def remembered(shape, fingers: int) -> ca.Function:
    """Return (M, P; z, r, rho, c, valid, Q, sensors), REMEMBERED samples backward.

    M, P: as in the page `exploration`, s being the pose of a hull at a sample, as seen
    from now; r (3 F,) [m]: where the fingers were on it as it lies now; c, valid (F,):
    booleans; Q (3,): variance of the step after the sample.  Gives M, P anew and E
    (4 F, k): E'E is what the fingers told.
    """
    return _remembered(shape, fingers).mapaccum("remembered", REMEMBERED, 2)


@cache
def _remembered(shape, fingers: int) -> ca.Function:
    sym, k = shape.symbol, shape.theta
    z, r, rho = sym("z", k), sym("r", 3 * fingers), sym("rho", fingers)
    c, valid, Q = sym("c", fingers), sym("valid", fingers), sym("Q", 3)
    M, P = sym("M", 3, k), sym("P", 3, 3)
    sensors, feel = sym("sensors", 3), _feeling(shape, False)
    alpha, sigma, sigma_n = ca.vertsplit(sensors)
    given = [M, P, z, r, rho, c, valid, Q, sensors]
    P, told = P + ca.diag(Q), []
    for f, p_wf in enumerate(_triples(r)):
        chance, _, h, h_s, _ = feel(z, ca.DM.zeros(3), p_wf, rho[f], sensors)
        gap = alpha**2 * chance * (1 - chance) + c[f] / sigma**2
        weights = valid[f] * ca.vertcat(gap, *[c[f] / sigma_n**2] * 3)
        rows, M, P = _sample_told(M, P, h, h_s, weights)
        told += rows
    out = [ca.densify(v) for v in (M, P, ca.vertcat(*told))]
    return compiled([ca.Function("remembered", given, out, {"cse": True})])[0]


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


def _foot(shape, finger, theta, pose):
    """Return c^2 [m^2] of the page `pushing`."""
    if shape.parameters == "vertices":
        return pushed_hull.legs_squared(theta)
    return pushing.foot_squared(shape, theta, pose[1])


def _unknowns(shape, free: bool):
    """Return z, and the shape and the pose that it means.

    A hull is its vertices where they lie now, about its centroid.
    """
    if shape.parameters == "vertices":
        z = shape.symbol("z", shape.theta)
        return z, z, pushed_hull.HERE
    motion = FREE if free else PLANAR
    z = shape.symbol("z", shape.theta + motion.unknowns)
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
    if shape.inertia is None and shape.parameters == "sizes":
        raise OptionError(
            "no action is predicted for this shape",
            where="estimate.shape",
            got=shape.name,
            expected="a shape with inertia and a foot, as a cuboid has",
            next="estimate a cuboid to choose actions, or explore with "
            "policy='random' or 'farthest'",
        )
