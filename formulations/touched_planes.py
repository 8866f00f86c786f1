r"""The costs of touches on supporting planes: the terms of polytope_planes.py.

    link = log(1 + o) - log(f + q - f q + o)
    f = exp(-|n_i - n_j|^2 / (2 FACE^2) - (b_i - b_j)^2 / (2 APART^2))
    q = exp(-|c_i - c_j|^2 / (2 POINT^2)),    o = exp(-OTHER_COST)

Two successive touches of a finger are on one face (f), or at one point of an edge about
which the body turns (q), or neither.  The other costs, n_i and c_i are stated there.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log1p

import casadi as ca

from . import sensing
from .quasi_static import WAY_EPS
from .shape import positive_part

FACE = 0.01  # [rad] deviation of the normals of two touches of one face
APART = 0.1e-3  # [m] deviation of their offsets
POINT = 0.2e-3  # [m] deviation of two contact points that are one
OTHER_COST = 1.5  # [nats] for two successive touches of neither one face nor one point
PAIR_COST = 3.0  # [nats] that one pair of touches can cost: they may be of a wrong pose
SLIP_WEIGHT = 100.0  # [nats / m] price of a finger's slip along the body


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

    def link(self, x, x_1, plane, plane_1, p_wf, rho, p_wf_1):
        c = self.contact(x, plane, p_wf, rho)
        c_1 = self.contact(x_1, plane_1, p_wf_1, rho)
        turn = ca.sumsqr(outward(plane) - outward(plane_1)) / (2 * FACE**2)
        f = ca.exp(-turn - ((plane[3] - plane_1[3]) / APART) ** 2 / 2)
        q = ca.exp(-ca.sumsqr(c - c_1) / (2 * POINT**2))
        o = exp(-OTHER_COST)  # as a mixture, without the logarithm of f + q - f q = 0
        return log1p(o) - ca.log(f + q - f * q + o)

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


def outward(plane):
    """Return the unit normal (3,) of a plane (m, b), n = m / |m|."""
    return plane[:3] / ca.norm_2(plane[:3])


def beyond(d, sigma):
    """Return the cost of a length d [m] above zero, at most PAIR_COST."""
    over = positive_part(d, sigma / 2)
    return sensing.mixture(over * over / (2 * sigma**2), PAIR_COST)
