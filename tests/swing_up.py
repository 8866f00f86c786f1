"""A pendulum, a fit and a cone: problems for the machine that solves."""

import casadi as ca
import numpy as np

from tactilenlp.nlp.problem import Problem
from tactilenlp.solvers.options import SolverOptions

GRAVITY, LENGTH, MASS = 9.81, 0.5, 1.0  # [m/s^2] [m] [kg]
STEPS, DT = 40, 0.05  # swing up in two seconds
TORQUE = 2.5  # [N m], less than the 4.9 that would lift the pendulum at once
TIGHT = SolverOptions(tolerance=1e-9)


def faster(state, torque):
    """Return the rate of (angle, speed) of a pendulum, angle 0 hanging down."""
    arm = MASS * LENGTH**2
    return -GRAVITY / LENGTH * np.sin(state[0]) + torque / arm


def pendulum(scale=1.0):
    """Swing a pendulum up with little torque: trapezoidal rule, state by state."""
    problem = Problem()
    way = np.linspace(0, np.pi, STEPS + 1)
    state = problem.variable(
        "state", 2, STEPS + 1, guess=[way, 0 * way], unit="rad, rad/s",
        scale=np.array([1.0, 5.0]) * scale,
    )  # fmt: skip
    torque = problem.variable(
        "torque", 1, STEPS + 1, lower=-TORQUE, upper=TORQUE, guess=0.1, unit="N m",
        scale=scale,
    )  # fmt: skip
    dt = problem.parameter("dt", DT, "s")

    def rate(s, u):
        arm = MASS * LENGTH**2
        return ca.vertcat(s[1], -GRAVITY / LENGTH * ca.sin(s[0]) + u / arm)

    def defect(s, s_1, u, u_1, dt):
        return s - s_1 - dt / 2 * (rate(s, u) + rate(s_1, u_1))

    now, before = np.arange(1, STEPS + 1), np.arange(STEPS)
    problem.minimize(
        "effort", lambda u, dt: dt * ca.sumsqr(u), torque, dt, role="regulariser"
    )
    problem.subject_to(
        "dynamics", defect, state[:, now], state[:, before], torque[:, now],
        torque[:, before], dt, lower=0, upper=0,
    )  # fmt: skip
    problem.subject_to("start", lambda s: s, state[:, 0], lower=0, upper=0)
    problem.subject_to("end", lambda s: s, state[:, -1], lower=[np.pi, 0],
                       upper=[np.pi, 0])  # fmt: skip
    return problem


def decay():
    """Fit a decay with an offset to noisy samples."""
    rng = np.random.default_rng(4)
    t = np.linspace(0, 3, 30)
    y = 2.0 * np.exp(-1.3 * t) + 0.5 + 0.02 * rng.normal(size=30)
    problem = Problem()
    c = problem.variable("c", 3, guess=[1, 1, 0], unit="V, 1/s, V", scale=[1, 1, 0.1])

    def misfit(c, t, y):
        return (c[0] * ca.exp(-c[1] * t) + c[2] - y) ** 2 / 2

    problem.minimize("misfit", misfit, c, t, y, role="likelihood")
    return problem, t, y


def cone(target, rounding=1e-3):
    """Find the vector of a friction cone that is nearest to `target`."""
    problem = Problem()
    f = problem.variable("f", 3, guess=[1.0, 0, 0], lower=[0, -np.inf, -np.inf],
                         unit="N", scale=1)  # fmt: skip
    goal = problem.parameter("target", target, "N")
    problem.minimize(
        "apart", lambda f, g: ca.sumsqr(f - g) / 2, f, goal, role="physics"
    )
    problem.subject_to(
        "cone", lambda f: f[0] - ca.sqrt(ca.sumsqr(f[1:]) + rounding**2), f, lower=0
    )
    return problem


def stationarity(problem, solution):
    """Return the slope of the Lagrangian at a solution, from its named multipliers."""
    x, data = solution.at(problem)
    slope = problem.pack(solution.bound_multipliers)
    for name in problem.costs:
        slope += np.asarray(problem.jacobian(name, x, data).sum(axis=0)).ravel()
    for name in problem.constraints:
        slope += problem.jacobian(name, x, data).T @ solution.multipliers[name].ravel()
    return slope * problem.scale
