r"""Poses and observed supporting planes: the path of a convex body of unknown shape.

    min  sum_touch  touch(n_i . R'(r - p) - rho - b_i) + |R n_i - n_m|^2 / (2 sigma_n^2)
       + sum_links  |n_i - n_j|^2 / (2 FACE^2) + (b_i - b_j)^2 / (2 APART^2) (one face)
       + sum_pairs  max(n_j . c_i - b_j, 0)^2 / (2 sigma^2)                   (behind)
       + sum_free   max(rho - |R'(r - p) - c_i|, 0)^2 / (2 sigma^2)           (outside)
       + sum_slips  SLIP_WEIGHT (sqrt(|c_i - c_j|^2 + WAY_EPS^2) - WAY_EPS)   (slip)
       + motion other than predicted, motion between actions
                                               (quasi_static.py, between_actions.py)
       + ((|m_i|^2 - 1) / UNIT)^2 / 2,   n_i = m_i / |m_i|             (unit length)
    over x_k, m_i, b_i

The cost of an instance of the first four lines is bounded (sensing.mixture).  Of the
shape only convexity is assumed: a touch says that the body lies behind a plane
n_i . q <= b_i through the contact point c_i = R'(r - p) - rho n_i.  Most successive
touches are on one face (a link).  The last pose is held: the body's axes are the
world's at the last sample, its origin on the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from . import sensing
from .between_actions import HEAVY, add_fixed_width
from .level import Level
from .names import NORMAL_SCALE, TOUCH_SCALE, TOUCH_TERM
from .quasi_static import WAY_EPS, add_unpredicted_motion
from .rigid_body import declare_poses
from .shape import positive_part

ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level("coarse", {"touch scale": 1e-3, "normal scale": 0.2, "gap scale": 2e-3,
                     "behind": 1e-3}),
    Level("fine", ipopt={"mu_init": 1e-3}),
)  # fmt: skip

TOUCH = 0.2e-3  # [m] deviation of a contact point from its plane
NORMAL = 0.02  # [rad] deviation of a measured normal from that of its plane
BEHIND = 0.2e-3  # [m] deviation of a contact point that lies before another plane
FACE = 0.01  # [rad] deviation of the normals of two touches of one face
APART = 0.1e-3  # [m] deviation of their offsets
FACE_COST = 1.5  # [nats] for two successive touches that are not of one face
PAIR_COST = 3.0  # [nats] that one pair of touches can cost: they may be of a wrong pose
SLIP_WEIGHT = 100.0  # [nats / m] price of a finger's slip along the body
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
    link, link_1 = window.link.T
    nlp.minimize("one face", one_face, plane[:, link], plane[:, link_1], role="prior")
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


@dataclass(frozen=True, eq=False)
class Touched:
    """The functions of a body that is touched, each the cost [nats] of an instance."""

    shape: object
    motion: object
    outlier_cost: float

    def contact(self, x, plane, p_wf, rho):
        """Return the contact point c (3,) [m], body frame."""
        p, R = self.motion.pose(self.shape, None, x)
        return R.T @ (p_wf - p) - rho * outward(plane)

    def touch(self, x, plane, p_wf, rho, n_m, sigma, sigma_n):
        p, R = self.motion.pose(self.shape, None, x)
        n = outward(plane)
        phi = ca.dot(n, R.T @ (p_wf - p)) - rho - plane[3]
        cost = sensing.touch(phi, sigma) + sensing.normal(R @ n, n_m, sigma_n)
        return sensing.mixture(cost, self.outlier_cost)

    def behind(self, x, plane, other, p_wf, rho, sigma):
        c = self.contact(x, plane, p_wf, rho)
        return beyond(ca.dot(outward(other), c) - other[3], sigma)

    def outside(self, x, plane, y, p_wf, rho, r_wf, radius, sigma):
        c = self.contact(x, plane, p_wf, rho)
        p, R = self.motion.pose(self.shape, None, y)
        return beyond(radius - ca.norm_2(R.T @ (r_wf - p) - c), sigma)

    def slip(self, x, x_1, plane, plane_1, p_wf, rho, p_wf_1):
        c = self.contact(x, plane, p_wf, rho)
        c_1 = self.contact(x_1, plane_1, p_wf_1, rho)
        return SLIP_WEIGHT * (ca.sqrt(ca.sumsqr(c - c_1) + WAY_EPS**2) - WAY_EPS)


def one_face(plane, other):
    """Return the cost of two touches that may be of one face."""
    turn = ca.sumsqr(outward(plane) - outward(other)) / (2 * FACE**2)
    cost = turn + ((plane[3] - other[3]) / APART) ** 2 / 2
    return sensing.mixture(cost, FACE_COST)


def outward(plane):
    """Return the unit normal (3,) of a plane (m, b), n = m / |m|."""
    return plane[:3] / ca.norm_2(plane[:3])


def beyond(d, sigma):
    """Return the cost of a length d [m] above zero, at most PAIR_COST."""
    over = positive_part(d, sigma / 2)
    return sensing.mixture(over * over / (2 * sigma**2), PAIR_COST)
