"""A made-up problem with every kind of coupling, for tests of the machine."""

import casadi as ca
import numpy as np

from tactilenlp.nlp.problem import Problem


def swing(x, x_1, x_2, pull, stiffness, d):
    """A made-up nonlinear cost of three poses, two data and two settings."""
    speed_up = x - 2 * x_1 + x_2
    return (
        stiffness * ca.sumsqr(speed_up) / (1 + ca.sumsqr(x - d))
        + ca.sin(x[0] * x_2[1] * 3) * pull
        + ca.exp(x_1[0] - x[1]) * x_2[2] ** 2
    )


def lever(theta, x, x_1):
    """Three made-up rows of a size and two poses."""
    return ca.vertcat(
        theta[0] * ca.cos(x[2]) + theta[1] * x_1[1] ** 2,
        ca.dot(x, x_1) * theta[1],
        x[0] * x_1[2] - theta[0] ** 3,
    )


def merged():
    """Make a problem in which one instance reads the same pose twice, and thrice."""
    rng = np.random.default_rng(1)
    problem = Problem()
    theta = problem.variable("theta", 2, guess=[0.3, 0.7], unit="m", scale=[0.1, 2.0])
    x = problem.variable(
        "x", 3, 4, guess=rng.normal(size=(3, 4)), unit="m", scale=[1.0, 0.5, 3.0]
    )
    stiffness = problem.parameter("stiffness", 2.5, "N/m")
    target = problem.parameter("target", [0.1, -0.2, 0.3], "m")
    now, before, before_2 = np.array([[1, 0, 0], [2, 1, 1], [3, 3, 3], [3, 1, 0]]).T
    pull = rng.normal(size=4)
    problem.minimize(
        "swing", swing, x[:, now], x[:, before], x[:, before_2], pull, stiffness,
        target, role="physics",
    )  # fmt: skip
    problem.minimize(
        "size", lambda theta: ca.sumsqr(theta - 1) ** 2, theta, role="prior"
    )
    problem.subject_to(
        "lever",
        lever,
        theta,
        x[:, [2, 1, 1]],
        x[:, [2, 2, 0]],
        lower=[-1, 0, 0],
        upper=1,
    )
    problem.subject_to("sum", lambda x: ca.sum1(x), x[:, 1:3], lower=0, upper=0)
    return problem
