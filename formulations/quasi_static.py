r"""Poses and shape with minimal motion, no impulses: the cheap first stage.

    min  sum_touch  touch(phi), |n - n_m|^2 / (2 sigma_n^2)          (likelihood.py)
       + sum_free   log(1 + exp(-alpha phi))                         (likelihood.py)
       + sum_gaps   2 log(1 + way^2 / gap^2)                    (between_actions.py)
       + (3 + n) / 2 log(1 + |(theta - mean) / deviation|^2 / (3 + n))  (size_prior.py)
       + sum_steps  weight (sqrt(way^2 + WAY_EPS^2) - WAY_EPS)        (least motion)
       + sum_f      |e_f|^2 / (2 sigma^2)     where unknown      (finger_offset.py)
       + sum_corners rest(z)                  free motion       (ground_contact.py)
    s.t. height of every corner >= 0          free motion       (ground_contact.py)
    over theta, x_k; where unknown also e_f

Least motion stands for quasi-static dissipation: an object that is pushed moves no more
than it must.  Where a finger that may push is not seen, way is that to x_{k-1} +
(x_{k-1} - x_{k-2}), as motion lasts.  Where motion is predicted, by pushes at the
contacts that are felt, way is that to x_{k-1} + motion_k: what is priced is the motion
other than predicted (`add_unpredicted_motion`).  Fingertips are rigid.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from .between_actions import add_fixed_width, way_squared
from .finger_offset import displaced
from .ground_contact import GroundContact, add_support
from .level import Level
from .likelihood import add_free, add_touches
from .rigid_body import PLANAR, declare_poses
from .size_prior import add_size_prior, declare_sizes

OFFSETS = True  # of fingers may be unknown
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level("coarse", {"touch scale": 2e-3, "normal scale": 0.4, "alpha": 500.0,
                     "gap scale": 5e-3, "motion weight": 100.0}),
    Level("fine"),
)  # fmt: skip

TOUCH = 0.3e-3  # [m] model error of a touched gap where motion is only least motion
NORMAL = 0.1  # [rad] model error of a normal, likewise
WAY_EPS = 0.3e-3  # [m] below this, the price of motion is quadratic
WEIGHT = 300.0  # [nats / m] price of motion
UNPREDICTED = 500.0  # [nats / m] price of motion that pushes do not predict


def build(nlp, window, scene, shape):
    """Fill `nlp` with what was felt, and least motion."""
    window = displaced(nlp, window, scene)
    theta, x = declare_sizes(nlp, shape), declare_poses(nlp, window)
    add_touches(nlp, window, shape, theta, x, TOUCH, NORMAL)
    add_free(nlp, window, shape, theta, x)
    add_fixed_width(nlp, window, shape, theta, x)
    add_size_prior(nlp, shape, theta)
    add_support(nlp, window, GroundContact(shape, window.motion), theta, theta, x)
    add_least_motion(nlp, window, shape, theta, x)


def add_least_motion(nlp, window, shape, theta, x):
    """Add the price of motion: an object that is pushed moves no more than it must."""
    price = Price.of(nlp, window, shape, WEIGHT)
    step, seen = window.step, seen_of(window)
    nlp.minimize(
        "least motion", price.way, theta, x[:, step.pose[seen]],
        x[:, step.before[seen]], price.weight, role="regulariser",
    )  # fmt: skip
    add_lasting_motion(nlp, window, price, theta, x)


def add_unpredicted_motion(nlp, window, shape, theta, x):
    """Add the price of motion other than predicted (window.step.motion).

    Planar motion alone is predicted: of a body in free motion, the price of all motion.
    """
    if window.motion is not PLANAR:
        add_least_motion(nlp, window, shape, theta, x)
        return
    price = Price.of(nlp, window, shape, UNPREDICTED)
    step, seen = window.step, seen_of(window)

    def departure(theta, x, x_1, motion, weight):
        return price.way(theta, x, x_1 + motion, weight)

    nlp.minimize(
        "unpredicted motion", departure, theta, x[:, step.pose[seen]],
        x[:, step.before[seen]], step.motion[seen], price.weight, role="regulariser",
    )  # fmt: skip
    add_lasting_motion(nlp, window, price, theta, x)


@dataclass(frozen=True, eq=False)
class Price:
    """The price [nats] of a way from an expected pose; weight: a parameter [nats/m]."""

    motion: object
    shape: object
    weight: object

    @classmethod
    def of(cls, nlp, window, shape, weight):
        """Return the price of a window's motion, its weight declared."""
        return cls(
            window.motion, shape, nlp.parameter("motion weight", weight, "nats/m")
        )

    def way(self, theta, x, expected, weight):
        way = way_squared(self.motion, self.shape, theta, x, expected)
        return weight * (ca.sqrt(way + WAY_EPS**2) - WAY_EPS)

    def change(self, theta, x, x_1, x_2, weight):
        return self.way(theta, x, 2 * x_1 - x_2, weight)


def add_lasting_motion(nlp, window, price, theta, x):
    """Add the price of a change of motion while a finger that may push is not seen."""
    step, unseen = window.step, window.unseen_steps.tolist()
    nlp.minimize(
        "lasting motion", price.change, theta, x[:, step.pose[unseen]],
        x[:, step.before[unseen]], x[:, step.before_2[unseen]], price.weight,
        role="regulariser",
    )  # fmt: skip


def seen_of(window) -> list[int]:
    """Return the steps in which every finger that may push is seen."""
    return sorted({*range(len(window.step))} - {*window.unseen_steps.tolist()})
