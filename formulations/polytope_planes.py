r"""Poses and observed supporting planes: where a convex body of unknown shape went.

    min  sum_touch  -log( exp(-touch(n_i . R'(r - p) - rho - b_i)
                              - |R n_i - n_m|^2 / 2 sigma_n^2) + exp(-outlier_cost) )
       + sum_links  (|n_i - n_j|^2 / 2 sigma^2 + (b_i - b_j)^2 / 2 sigma_b^2), robust
       + sum_pairs  max(n_j . c_i - b_j, 0)^2 / (2 sigma^2), robust         (behind)
       + sum_free   max(rho - |R'(r - p) - c_i|, 0)^2 / (2 sigma^2), robust (outside)
       + least motion, between actions                          (see quasi_static.py)
       + sum_slips  weight (sqrt(|c_i - c_j|^2 + WAY_EPS^2) - WAY_EPS)
    over x_k, n_i, b_i

Nothing is assumed of the shape but that it is convex: a touch says that the body lies
behind a plane n_i . q <= b_i through the contact point c_i = R'(r - p) - rho n_i.  Most
successive touches of a finger are on one face (a link), some roll over an edge.  The
last pose is held where it starts: the body's axes are the world's at the last sample,
its origin on the ground below its middle.
"""

from __future__ import annotations

import casadi as ca

from . import sensing
from .level import Level
from .quasi_static import HEAVY, WAY_EPS, between_actions, least_motion

ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level(
        "coarse",
        {"touch scale": 1e-3, "normal scale": 0.2, "gap scale": 2e-3, "behind": 1e-3},
    ),
    Level("fine", ipopt={"mu_init": 1e-3}),
)

TOUCH = 0.2e-3  # [m] deviation of a contact point from its plane
NORMAL = 0.02  # [rad] deviation of a measured normal from that of its plane
BEHIND = 0.2e-3  # [m] deviation of a contact point that lies before another plane
FACE = 0.01  # [rad] deviation of the normals of two touches of one face
LEVEL = 0.1e-3  # [m] deviation of their offsets
EDGE = 1.5  # [nats] for two successive touches that are not of one face
MOST = 3.0  # [nats] that one pair of touches can cost: they may be of a wrong pose
SLIP = 100.0  # [nats / m] price of a finger's slip along the body
UNIT = 0.1  # [-] deviation of the length of the vector whose direction is a normal


def build(nlp, window, scene, shape):
    """Fill `nlp` with poses and planes."""
    motion, t, pair, out = window.motion, window.touch, window.behind, window.outside
    sigma_p, sigma_n = window.sigma_position, window.sigma_normal
    x = nlp.variable(
        "x", motion.unknowns, window.poses, lower=window.lower, upper=window.upper,
        guess=0.0, unit=motion.unit, scale=motion.scale,
    )  # fmt: skip
    plane = nlp.variable(
        "plane", 4, window.planes, guess=[1, 0, 0, 0], unit="1, 1, 1, m",
        scale=(0.05, 0.05, 0.05, 1e-3),
    )  # fmt: skip
    touch = nlp.parameter("touch scale", ca.hypot(TOUCH, sigma_p), "m")
    normal = nlp.parameter("normal scale", ca.hypot(NORMAL, sigma_n), "rad")
    behind = nlp.parameter("behind", ca.hypot(BEHIND, sigma_p), "m")

    def pose(x):
        return motion.pose(shape, None, x)

    def touching(x, plane, p_wf, rho, n_m, sigma, sigma_n):
        p, R = pose(x)
        n = outward(plane)
        phi = ca.dot(n, R.T @ (p_wf - p)) - rho - plane[3]
        cost = sensing.touch(phi, sigma) + sensing.normal(R @ n, n_m, sigma_n)
        return sensing.mixture(cost, window.outlier_cost)

    def contact(x, plane, p_wf, rho):
        p, R = pose(x)
        return R.T @ (p_wf - p) - rho * outward(plane)

    def linked(plane, other):
        turn = ca.sumsqr(outward(plane) - outward(other)) / (2 * FACE**2)
        return sensing.mixture(turn + ((plane[3] - other[3]) / LEVEL) ** 2 / 2, EDGE)

    def before(x, plane, other, p_wf, rho, sigma):
        c = contact(x, plane, p_wf, rho)
        return beyond(ca.dot(outward(other), c) - other[3], sigma)

    def inside(x, plane, y, p_wf, rho, r_wf, radius, sigma):
        c = contact(x, plane, p_wf, rho)
        p, R = pose(y)
        return beyond(radius - ca.norm_2(R.T @ (r_wf - p) - c), sigma)

    def slipped(x, x_1, plane, plane_1, p_wf, rho, p_wf_1):
        c, c_1 = contact(x, plane, p_wf, rho), contact(x_1, plane_1, p_wf_1, rho)
        return SLIP * (ca.sqrt(ca.sumsqr(c - c_1) + WAY_EPS**2) - WAY_EPS)

    i, s = window.plane, pair.touch
    nlp.minimize(
        "touch", touching, x[:, t.pose], plane[:, i], t.p_wf, t.radius, t.normal,
        touch, normal, role="likelihood",
    )  # fmt: skip
    link, link_1 = window.link.T
    nlp.minimize("one face", linked, plane[:, link], plane[:, link_1], role="prior")
    nlp.minimize(
        "behind", before, x[:, t.pose[s]], plane[:, i[s]], plane[:, pair.plane],
        t.p_wf[s], t.radius[s], behind, role="likelihood",
    )  # fmt: skip
    s = out.touch
    nlp.minimize(
        "outside", inside, x[:, t.pose[s]], plane[:, i[s]], x[:, out.pose], t.p_wf[s],
        t.radius[s], out.p_wf, out.radius, behind, role="likelihood",
    )  # fmt: skip
    s, s_1 = window.slip.T
    nlp.minimize(
        "slip", slipped, x[:, t.pose[s]], x[:, t.pose[s_1]], plane[:, i[s]],
        plane[:, i[s_1]], t.p_wf[s], t.radius[s], t.p_wf[s_1], role="regulariser",
    )  # fmt: skip
    least_motion(nlp, window, shape, 0.0, x)
    between_actions(nlp, window, shape, 0.0, x, power=HEAVY)
    nlp.minimize(
        "unit length", lambda plane: ((ca.sumsqr(plane[:3]) - 1) / UNIT) ** 2 / 2,
        plane, role="regulariser",
    )  # fmt: skip


def outward(plane):
    """Return the unit normal (3,) of a plane (m, b), n = m / |m|."""
    return plane[:3] / ca.norm_2(plane[:3])


def beyond(d, sigma):
    """Return the cost of a length d [m] that should not be positive; at most MOST."""
    over = (d + ca.sqrt(d * d + (sigma / 2) ** 2)) / 2
    return sensing.mixture(over * over / (2 * sigma**2), MOST)
