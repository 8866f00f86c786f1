"""Compile the functions of a predicted push: its steps and the samples' information."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from formulations import exploration, pushed_hull, pushing
from formulations.finger import SPHERE
from formulations.implicit import solve_3
from formulations.rigid_body import ARM, FREE, PLANAR

from ..errors import OptionError, SceneError
from ..nlp.codegen import compiled

# of a time step; of six actions, three are within 1 um of the minimum on the whole way,
# squeezes within 0.5 mm
PUSH_ITERATIONS = 8
SAMPLES_PER_CALL = 30  # of backward_filter_function
STEP_SIGMA_SHARE = 0.2  # [-] standard deviation of a predicted step over its length
MIN_STEP_SIGMA = 1e-5  # [m], its least value


@cache
def push_function(
    shape, free: bool, fingers: int, steps: int, off=False
) -> ca.Function:
    """Return (d, p, s, M, P; z, goal_1, goal, rho, known, sensors, sloped) -> ...

    The function of all steps of a push.  s (3,): planar displacement of the body since
    x_T, d (3,): that of the last step; p (3 F,) [m]: finger positions; goal_1, goal:
    the commanded ones, of the last step and of this one; M, P: as in the page
    `exploration`; z: theta and x_T; known: as in `pushing`; sensors: alpha, sigma,
    sigma_n; sloped: 1, or 0 for dx_t/dx_T = I.  off: M has columns for the offset (3,)
    of every finger after those of z.

    It returns new d, p, s, M, P, the probability of contact (F,), E (4 F, k), and the
    force and moment (6,) [N, N m] of the fingers on the body: E'E is the information of
    the sample.
    """
    return step_function(shape, free, fingers, off).mapaccum("pushed", steps, 5)


@cache
def step_function(shape, free: bool, fingers: int, off: bool) -> ca.Function:
    """Return the function of one time step, with the arguments of `push_function`."""
    sym = shape.symbol
    z, theta, pose = _unknowns(shape, free)
    k = z.numel() + off * 3 * fingers
    p, goal_1, goal, r = (sym(name, 3 * fingers) for name in ("p", "g", "h", "r"))
    rho, constants = sym("rho", fingers), sym("known", 5)
    sensors, sloped = sym("sensors", 3), sym("sloped")
    d, s, M = sym("d", 3), sym("s", 3), sym("M", 3, k)
    P = sym("P", 3, 3)
    laws = ca.vertsplit(constants)
    foot = pushing.foot_squared(shape, theta, pose[1])
    here = shape, SPHERE, theta, pushing.pose_after(pose, s)
    meant = _commanded(here, p, goal_1, goal, rho, laws)

    tips = [*zip(*map(_triples, (r, p)), ca.vertsplit(rho), strict=True)]
    body = pushing.Pushed(shape, SPHERE, theta, pose, tips, (*laws, foot))
    given = [d, s, z, p, r, rho, constants]
    better = ca.Function("improved", given, [body.improved(s, d)], {"cse": True})
    step, at = d, [s, z, p, ca.vertcat(*meant), rho, constants]
    for _ in range(PUSH_ITERATIONS):
        step = better(step, *at)
    D_s, D_z, D_r, p_now, wrench = _step_slopes(body, s, d, given)(step, *at)
    D_z = ca.horzcat(D_z, D_r) if off else D_z
    now, A = s + step, ca.DM.eye(3) + D_s
    M_now = M + sloped * (D_s @ M + D_z)
    P_now = sloped * (
        A @ P @ A.T
        + exploration.process_noise(step, STEP_SIGMA_SHARE, MIN_STEP_SIGMA, ARM)
    )
    feel = _sensing_function(shape, free)
    spheres = [(p_wf, rho[f]) for f, p_wf in enumerate(meant)]
    chances, information, M_now, P_now = _sensed(
        feel, z, now, spheres, sensors, M_now, P_now, off
    )
    sensed = map(ca.vcat, (chances, information))
    out = [step, p_now, now, M_now, P_now, *sensed, wrench]
    given = [d, p, s, M, P, z, goal_1, goal, rho, constants, sensors, sloped]
    out = [ca.densify(v) for v in out]
    return compiled([ca.Function("step", given, out, {"cse": True})])[0]


def _commanded(here, p, goal_1, goal, rho, laws) -> list:
    """Return the commanded positions, no deeper than the servo's force allows."""
    ways = zip(*map(_triples, (p, goal_1, goal)), ca.vertsplit(rho), strict=True)
    deep = laws[4] / laws[3]
    return [
        pushing.reached(*here, p_wf, to, size, deep + ca.norm_2(to - before))
        for p_wf, before, to, size in ways
    ]


def _sensed(feel, z, now, spheres, sensors, M, P, off: bool):
    """Return probabilities of contact, information rows, and M, P after all fingers.

    now: the planar displacement; spheres: position and radius of every finger.
    """
    chances, information = [], []
    for f, (p_wf, radius) in enumerate(spheres):
        chance, weights, h, h_s, h_r = feel(z, now, p_wf, radius, sensors)
        if off:
            others = [ca.DM.zeros(4, 3) for _ in spheres]
            h = ca.horzcat(h, *others[:f], h_r, *others[f + 1 :])
        chances.append(chance)
        rows, M, P = _measurement_updates(M, P, h, h_s, weights)
        information += rows
    return chances, information, M, P


def _measurement_updates(M, P, h, h_s, weights):
    """Return the information rows of a sample's four numbers, and M, P after them."""
    rows = []
    for i in range(4):
        e, M, P = exploration.measurement_update(M, P, h[i, :], h_s[i, :], weights[i])
        rows.append(e)
    return rows, M, P


def _triples(column) -> list:
    return ca.vertsplit(column, 3)


def _step_slopes(body, s, d, given) -> ca.Function:
    """Return the derivatives of the step d by s, z and the fingers, their p and wrench.

    By the implicit function theorem.
    """
    loads = body.loads(s, d)
    pull, _ = body.work_slope(s, d, loads)
    by_d, by_s, by_z, by_p, by_r = (ca.jacobian(pull, v) for v in (d, s, *given[2:5]))
    out = [-solve_3(by_d, by) for by in (by_s, by_z, by_p + by_r)]
    tips, wrench = body.tips(s, d, loads)
    out += [ca.vertcat(*tips), wrench]
    return ca.Function("slopes", given, out, {"cse": True})


@cache
def _sensing_function(shape, free: bool) -> ca.Function:
    """Return (z, s, r, rho, sensors) -> p, weights (4,), derivatives by z, s and r.

    The four rows are gap and normal of one finger's sample; p is the probability of
    contact.
    """
    z, theta, pose = _unknowns(shape, free)
    s, r, rho, sensors = (shape.symbol("in", n) for n in (3, 3, 1, 3))
    alpha, sigma, sigma_n = ca.vertsplit(sensors)
    at = pushing.pose_after(pose, s)
    phi = SPHERE.gap(shape, theta, at, r, rho)
    sensed = ca.vertcat(phi, SPHERE.normal(shape, theta, at, r, rho))
    p = exploration.probability(phi, alpha)
    w = exploration.gap_information(p, p, alpha, sigma)
    weights = ca.vertcat(w, *[p / sigma_n**2] * 3)
    slopes = [ca.densify(ca.jacobian(sensed, v)) for v in (z, s, r)]
    inputs = [z, s, r, rho, sensors]
    return ca.Function("feeling", inputs, [p, weights, *slopes], {"cse": True})


@cache
def backward_filter_function(shape, fingers: int) -> ca.Function:
    """Return (M, P; z, r, rho, c, valid, Q, sensors), SAMPLES_PER_CALL samples back.

    M, P: as in the page `exploration`, s being the pose of a polytope at a sample, as
    seen from now; r (3 F,) [m]: where the fingers were on it as it lies now; c, valid
    (F,): booleans; Q (3,): variance of the step after the sample.  Gives M, P anew and
    E (4 F, k): E'E is what the fingers told.
    """
    sym, k = shape.symbol, shape.theta
    z, r, rho = sym("z", k), sym("r", 3 * fingers), sym("rho", fingers)
    c, valid, Q = sym("c", fingers), sym("valid", fingers), sym("Q", 3)
    M, P = sym("M", 3, k), sym("P", 3, 3)
    sensors, feel = sym("sensors", 3), _sensing_function(shape, False)
    alpha, sigma, sigma_n = ca.vertsplit(sensors)
    arguments = [M, P, z, r, rho, c, valid, Q, sensors]
    P, information = P + ca.diag(Q), []
    for f, p_wf in enumerate(_triples(r)):
        chance, _, h, h_s, _ = feel(z, ca.DM.zeros(3), p_wf, rho[f], sensors)
        gap = exploration.gap_information(chance, c[f], alpha, sigma)
        weights = valid[f] * ca.vertcat(gap, *[c[f] / sigma_n**2] * 3)
        rows, M, P = _measurement_updates(M, P, h, h_s, weights)
        information += rows
    out = [ca.densify(v) for v in (M, P, ca.vertcat(*information))]
    (step,) = compiled([ca.Function("remembered", arguments, out, {"cse": True})])
    return step.mapaccum("remembered", SAMPLES_PER_CALL, 2)


def _unknowns(shape, free: bool):
    """Return z, and the theta and the pose that it stands for.

    Of vertices whose last pose is held, z is where they lie now, about their centroid.
    """
    if shape.of_vertices:
        z = shape.symbol("z", shape.theta)
        return z, z, pushed_hull.HERE
    motion = FREE if free else PLANAR
    z = shape.symbol("z", shape.theta + motion.unknowns)
    theta = z[: shape.theta]
    return z, theta, motion.pose(shape, theta, z[shape.theta :])


def check_workspace(space, scene, radius) -> None:
    """Raise OptionError unless a workspace has the scene's ground and its fingertips.

    radius [m]: of the fingers, a number or (F,); None: not known.  Without a ground in
    the scene, that of the workspace is any plane that fingers stay above.
    """
    known = scene.ground, scene.as_told.ground  # as estimated, as told
    if scene.ground is not None and space.ground not in known:
        raise OptionError(
            "a workspace on another ground", where="workspace.ground",
            got=space.ground, expected=f"{scene.ground}, that of the scene",
            next="give Workspace(ground=scene.ground, ...)",
        )  # fmt: skip
    most = 0.0 if radius is None else float(np.max(radius))
    if most > space.finger_radius:
        raise OptionError(
            "a workspace of smaller fingertips", where="workspace.finger_radius",
            got=f"{space.finger_radius} m", expected=f"at least {most} m, the largest",
            next=f"give Workspace(finger_radius={most}, ...): lines end above the "
            "ground and apart from each other by it",
        )  # fmt: skip


def check_predictable(scene, shape) -> None:
    """Raise an error unless pushes can be predicted.

    SceneError: there is no ground, on which the prediction rests.  OptionError: the
    motion of this shape cannot be predicted.
    """
    if scene.ground is None:
        raise SceneError(
            "actions are not predicted without a ground",
            where="scene.ground",
            got="None",
            expected="a Ground, on which the object lies",
            next="explore with policy='random', 'farthest' or a function",
        )
    if shape.inertia is None and shape.foot_squared is None:
        raise OptionError(
            "actions are not predicted for this shape",
            where="estimate.shape",
            got=shape.name,
            expected="a Shape with `inertia` or `foot_squared`",
            next="estimate a cuboid to choose actions, or explore with "
            "policy='random' or 'farthest'",
        )
