r"""Where to touch next: the paper's action space, and expected information (eq:eig).

Action space.  Each finger comes along a straight line from a fixed radius towards the
body's centroid r_c, with right ascension a about +Z and declination b towards +Z:

    r(t) = r_c + l(t) (cos b cos(h + a), cos b sin(h + a), sin b)  (`line`, `direction`)

h = 0 for the finger of the +X side, pi for that of -X (h = 2 pi f / F for F fingers),
l(t) falls from the radius to an end before the centroid with least jerk.  A finger
stays in its own sector, half a gap off the border, and above the ground (`kept_apart`).

Expected information.  Omega = (theta, x_T); the body has moved by s_t(omega) since, and
a future sample has phi(omega, s_t, r_t) and n(omega, s_t, r_t).  In expectation over
c ~ eq:bool and n_m ~ eq:norm the second derivatives vanish and eq:obsinfo holds with
equality: with p = 1 / (1 + e^{alpha phi}), J total slopes by omega,

    F = sum_t  w J_phi' J_phi + p / sigma_n^2 J_n' J_n           (`sample_information`)
    w = alpha^2 p (1 - p) + p / sigma^2                          (`gap_information`)

Departures.  A felt finger is *on* the surface (sensing.py), hence p / sigma^2;
sigma = inf gives the paper's.  The motion s_t is predicted by the page `pushing`, with
process noise: s_{t+1} = f(s_t, omega) + q_t, Cov q = Q (`process_noise`), and F is that
of the samples' marginal distribution, as a Kalman filter of s finds it
(`measurement_update`): e is the slope of an innovation, M = d mean(s) / d omega,
P = Cov(s | omega).  M = P = 0 is dx_t/dx_T = I, as in the paper.

    EIG = (logdet(I + F) - logdet(I)) / 2     [nats], I: the information so far

The logdet is `tactilenlp.information_gain`.
"""

from __future__ import annotations

import casadi as ca


def direction(heading, ascension, declination):
    """Return the unit vector from the centroid to a finger, world frame."""
    azimuth = heading + ascension
    level = ca.cos(declination)
    return ca.vertcat(
        level * ca.cos(azimuth), level * ca.sin(azimuth), ca.sin(declination)
    )


def least_jerk(s):
    """Return the minimum-jerk profile from 0 to 1, s from 0 to 1."""
    return s**3 * (10 - 15 * s + 6 * s**2)


def line(s, toward, radius, end):
    """Return the finger's place relative to the centroid (3,) [m] at time share s."""
    return (radius + (end - radius) * least_jerk(s)) * toward


def kept_apart(offset, heading, half_width, half_gap):
    """Return an offset (3,) [m] pushed out of the other fingers' sectors.

    The sector |angle - heading| < half_width, shrunk by half_gap [m]; half_width =
    pi / 2 is the half-space of the paper.
    """
    c, s = ca.cos(heading), ca.sin(heading)
    along, across = c * offset[0] + s * offset[1], c * offset[1] - s * offset[0]
    border = half_gap + ca.fabs(across) * ca.cos(half_width)
    along = ca.fmax(along, border / ca.sin(half_width))
    return ca.vertcat(c * along - s * across, s * along + c * across, offset[2])


def above_ground(p_wf, lowest):
    """Return the place (3,) [m] of a finger, its centre no lower than `lowest` [m]."""
    return ca.vertcat(p_wf[0], p_wf[1], ca.fmax(p_wf[2], lowest))


def probability(phi, alpha):
    """Return p(c = 1) of a gap phi [m] (eq:bool)."""
    z = alpha * phi
    small = ca.exp(-ca.fabs(z))
    return ca.if_else(z > 0, small, 1) / (1 + small)


def gap_information(p, c, alpha, sigma):
    """Return w [1 / m^2] of a gap: sigma [m] where felt, alpha [1/m].

    p: its probability of contact; c: its boolean, p for the expectation.
    """
    return alpha**2 * p * (1 - p) + c / sigma**2


def sample_information(c, phi, J_phi, J_n, alpha, sigma, sigma_n):
    """Return the information (k, k) of one finger's sample with boolean c (eq:obsinfo).

    J_phi (1, k), J_n (3, k): slopes of gap and normal; c = p gives the expectation.
    """
    p = probability(phi, alpha)
    gap = gap_information(p, c, alpha, sigma)
    return gap * J_phi.T @ J_phi + c / sigma_n**2 * J_n.T @ J_n


def measurement_update(M, P, h, h_s, w):
    """Return e, M, P after a measurement of information w, slopes h (1, k), h_s (1, 3).

    e (1, k): e'e is its information about omega; M (3, k), P (3, 3): mean's slope and
    covariance of s.
    """
    e = h + h_s @ M
    lag = P @ h_s.T
    gain = w / (1 + w * (h_s @ lag))
    return ca.sqrt(gain) * e, M - gain * lag @ e, P - gain * lag @ lag.T


def process_noise(d, share, least, arm):
    """Return Q (3, 3) of a step d = (dx, dy, dyaw): a share of it, and `least` [m].

    arm [m]: a radian of turn counts as this much way.
    """
    way = d[0] ** 2 + d[1] ** 2 + (arm * d[2]) ** 2
    return (share**2 * way + least**2) * ca.diag(ca.vertcat(1, 1, 1 / arm**2))
