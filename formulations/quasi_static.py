r"""Poses and shape with minimal motion, no impulses: the cheap first stage.

    min  sum_touch  touch(phi), |n - n_m|^2 / (2 sigma_n^2)          (likelihood.py)
       + sum_free   log(1 + exp(-alpha phi))                         (likelihood.py)
       + sum_gaps   2 log(1 + way^2 / gap^2)                    (between_actions.py)
       + (3 + n) / 2 log(1 + |(theta - mean) / deviation|^2 / (3 + n))  (size_prior.py)
       + sum_steps  weight (sqrt(way^2 + WAY_EPS^2) - WAY_EPS)        (least motion)
    over theta, x_k

The first four are what was felt and known; every page has them (`declare_with_loss`).
The last stands for quasi-static dissipation: an object that is pushed moves no more
than it must.  Where a finger that may push is not seen, way is that to x_{k-1} +
(x_{k-1} - x_{k-2}), as motion lasts.
"""

from __future__ import annotations

from functools import partial

import casadi as ca

from . import between_actions, likelihood
from .between_actions import way_squared
from .finger_offset import displaced
from .indentation import NONE
from .level import Level
from .size_prior import size_cost

OFFSETS = True  # of fingers may be unknown
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level(
        "coarse",
        {
            "touch scale": 2e-3,
            "normal scale": 0.4,
            "alpha": 500.0,
            "gap scale": 5e-3,
            "motion weight": 100.0,
        },
    ),
    Level("fine"),
)

TOUCH = 0.3e-3  # [m] model error of a touched gap where motion is only least motion
NORMAL = 0.1  # [rad] model error of a normal, likewise
WAY_EPS = 0.3e-3  # [m] below this, the price of motion is quadratic
WEIGHT = 300.0  # [nats / m] price of motion


def build(nlp, window, scene, shape):
    """Fill `nlp` with what was felt, and least motion."""
    window = displaced(nlp, window, scene)
    theta, x = declare_with_loss(nlp, window, shape)
    least_motion(nlp, window, shape, theta, x)


def declare_with_loss(
    nlp, window, shape, touch=TOUCH, normal=NORMAL, indentation=NONE, coasts=False
):
    """Declare theta and x; add what the fingers felt (eq:loss) and what was known.

    touch [m], normal [rad]: model errors of a sample, added to the sensors' own;
    indentation: Rigid or Soft, of every felt finger (indentation.py);
    coasts: whether poses tell how fast the object is when an action ends.
    """
    theta, x = likelihood.declare(nlp, window, shape)
    likelihood.add(nlp, window, shape, (theta, theta), x, touch, normal, indentation)
    link = between_actions.coasting if coasts else between_actions.fixed
    link(nlp, window, shape, theta, x)
    nlp.minimize("size prior", partial(size_cost, shape), theta, role="prior")
    return theta, x


def least_motion(nlp, window, shape, theta, x):
    """Add the price of motion: an object that is pushed moves no more than it must.

    While a finger that may push is not seen, motion lasts: its change has that price.
    """
    weight = nlp.parameter("motion weight", WEIGHT, "nats/m")
    step = window.step

    def moved(theta, x, expected, weight):
        way = way_squared(window.motion, shape, theta, x, expected)
        return weight * (ca.sqrt(way + WAY_EPS**2) - WAY_EPS)

    def changed(theta, x, x_1, x_2, weight):
        return moved(theta, x, 2 * x_1 - x_2, weight)

    unseen = window.unseen_steps.tolist()
    seen = sorted({*range(len(step))} - {*unseen})
    nlp.minimize(
        "least motion", moved, theta, x[:, step.pose[seen]], x[:, step.before[seen]],
        weight, role="regulariser",
    )  # fmt: skip
    if len(unseen):
        nlp.minimize(
            "lasting motion", changed, theta, x[:, step.pose[unseen]],
            x[:, step.before[unseen]], x[:, step.before_2[unseen]], weight,
            role="regulariser",
        )  # fmt: skip
