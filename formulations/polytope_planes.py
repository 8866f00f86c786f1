r"""Poses and observed supporting planes: the path of a convex body of unknown shape.

    min  sum_touch  touch(n_i . R'(r - p) - rho - b_i) + |R n_i - n_m|^2 / (2 sigma_n^2)
       + sum_links  link(n_i - n_j, b_i - b_j, c_i - c_j)     (one face, or one point)
       + sum_pairs  max(n_j . c_i - b_j, 0)^2 / (2 sigma^2)                   (behind)
       + sum_free   max(rho - |R'(r - p) - c_i|, 0)^2 / (2 sigma^2)           (outside)
       + sum_slips  SLIP_WEIGHT (sqrt(|c_i - c_j|^2 + WAY_EPS^2) - WAY_EPS)   (slip)
       + motion other than predicted, motion between actions
                                               (quasi_static.py, between_actions.py)
       + ((|m_i|^2 - 1) / UNIT)^2 / 2,   n_i = m_i / |m_i|             (unit length)
    over x_k, m_i, b_i

The first five lines are in touched_planes.py, all bounded but for slip.  Of the shape
only convexity is assumed: a touch says that the body lies behind a plane n_i . q <= b_i
through the contact point c_i = R'(r - p) - rho n_i.  Most successive touches are on one
face, or at one point of an edge about which the body turns (a link).  The last pose is
held: the body's axes are the world's at the last sample, its origin on the ground.
"""

from __future__ import annotations

import casadi as ca

from .between_actions import HEAVY, add_fixed_width
from .level import Level
from .names import NORMAL_SCALE, TOUCH_SCALE, TOUCH_TERM
from .quasi_static import add_unpredicted_motion
from .rigid_body import declare_poses
from .touched_planes import Touched

ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level("coarse", {"touch scale": 1e-3, "normal scale": 0.2, "gap scale": 2e-3,
                     "behind": 1e-3}),
    Level("fine", ipopt={"mu_init": 1e-3}),
)  # fmt: skip

TOUCH = 0.2e-3  # [m] deviation of a contact point from its plane
NORMAL = 0.02  # [rad] deviation of a measured normal from that of its plane
BEHIND = 0.5e-3  # [m] deviation of a contact point that lies before another plane
UNIT = 0.1  # [-] deviation of the length of the vector whose direction is a normal


def build(nlp, window, scene, shape):
    """Fill `nlp` with poses and planes."""
    motion, t, i = window.motion, window.touch, window.plane
    sigma_p, sigma_n = window.sigma_position, window.sigma_normal
    x = declare_poses(nlp, window)
    plane = nlp.variable(
        "plane", 4, window.planes, guess=[1, 0, 0, 0], unit="1, 1, 1, m",
        scale=(0.05, 0.05, 0.05, 1e-3),
    )  # fmt: skip
    touch = nlp.parameter(TOUCH_SCALE, ca.hypot(TOUCH, sigma_p), "m")
    normal = nlp.parameter(NORMAL_SCALE, ca.hypot(NORMAL, sigma_n), "rad")
    nlp.parameter("behind", ca.hypot(BEHIND, sigma_p), "m")
    body = Touched(shape, motion, window.outlier_cost)
    nlp.minimize(
        TOUCH_TERM, body.touch, x[:, t.pose], plane[:, i], t.p_wf, t.radius, t.normal,
        touch, normal, role="likelihood",
    )  # fmt: skip
    s, s_1 = window.link.T
    nlp.minimize(
        "link", body.link, x[:, t.pose[s]], x[:, t.pose[s_1]], plane[:, i[s]],
        plane[:, i[s_1]], t.p_wf[s], t.radius[s], t.p_wf[s_1], role="prior",
    )  # fmt: skip
    add_pairs(nlp, window, body, x, plane)
    add_unpredicted_motion(nlp, window, shape, 0.0, x)
    add_fixed_width(nlp, window, shape, 0.0, x, HEAVY)
    nlp.minimize(
        "unit length", lambda plane: ((ca.sumsqr(plane[:3]) - 1) / UNIT) ** 2 / 2,
        plane, role="regulariser",
    )  # fmt: skip


def add_pairs(nlp, window, body, x, plane):
    """Add the costs of contact points with other planes, fingers and contact points."""
    t, i, pair, out = window.touch, window.plane, window.behind, window.outside
    sigma, s = nlp.parameters["behind"], pair.touch
    nlp.minimize(
        "behind", body.behind, x[:, t.pose[s]], plane[:, i[s]], plane[:, pair.plane],
        t.p_wf[s], t.radius[s], sigma, role="likelihood",
    )  # fmt: skip
    s = out.touch
    nlp.minimize(
        "outside", body.outside, x[:, t.pose[s]], plane[:, i[s]], x[:, out.pose],
        t.p_wf[s], t.radius[s], out.p_wf, out.radius, sigma, role="likelihood",
    )  # fmt: skip
    s, s_1 = window.slip.T
    nlp.minimize(
        "slip", body.slip, x[:, t.pose[s]], x[:, t.pose[s_1]], plane[:, i[s]],
        plane[:, i[s_1]], t.p_wf[s], t.radius[s], t.p_wf[s_1], role="regulariser",
    )  # fmt: skip
