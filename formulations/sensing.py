r"""Negative log-likelihoods [nats] of what a finger feels.

eq:bool   p(c = 0) = 1 / (1 + exp(-alpha phi))          a sample without contact
eq:norm   |n_m - n|^2 / (2 sigma_n^2)                   a measured normal
touch     4 (sqrt(1 + (phi / 2 sigma)^2) - 1)           a sample with contact
mixture   -log(exp(-cost) + exp(-outlier_cost)) + const  a sample that may be wrong

Departure from eq:bool for c = 1: the logistic is satisfied by any penetration, but a
finger that is felt is *on* the surface.  The touch cost is two-sided, quadratic within
two sigma and linear beyond.  A fraction of the booleans is wrong; `mixture` bounds what
a single sample can cost, by a density that is a mixture with a constant one.
"""

from __future__ import annotations

import casadi as ca

FREEDOM = 3  # degrees of freedom of heavy tails
LEAST_UNDER = 2.0**-52  # [nats] by which a cost is under its bound: rounding


def softplus(z):
    """Return log(1 + exp(z)) without overflow."""
    return ca.fmax(z, 0) + ca.log1p(ca.exp(-ca.fabs(z)))


def touch(phi, sigma):
    """Return the cost of a gap phi [m] where contact is felt; sigma [m]."""
    return 4 * (ca.sqrt(1 + (phi / (2 * sigma)) ** 2) - 1)


def free(phi, alpha):
    """Return the cost of a gap phi [m] where nothing is felt (eq:bool, c = 0)."""
    return softplus(-alpha * phi)


def logistic_contact(phi, alpha):
    """Return the cost of a gap phi [m] where contact is felt (eq:bool, c = 1)."""
    return softplus(alpha * phi)


def normal(n, n_m, sigma):
    """Return the cost of the normal n where n_m was measured (eq:norm); sigma [rad]."""
    return ca.sumsqr(n_m - n) / (2 * sigma**2)


def heavy_tailed(square, n=1):
    """Return (3 + n) / 2 log(1 + square / (3 + n)): square / 2 near zero, then flatter.

    Student's t of FREEDOM degrees of freedom, n-variate; square: the sum of n squares,
    each in the deviations that its mode's curvature has: what is ten deviations off is
    rare, not impossible.
    """
    total = FREEDOM + n
    return total / 2 * ca.log1p(square / total)


def mixture(cost, outlier_cost):
    """Return -log((exp(-cost) + exp(-outlier_cost)) / (1 + exp(-outlier_cost))).

    Zero where the cost is zero; a wrong sample costs little more than `outlier_cost`.
    """
    return outlier_cost - softplus(outlier_cost - cost) + softplus(-outlier_cost)


def without_bound(cost, outlier_cost):
    """Return the cost of which `mixture` is `cost`, a large one near its bound."""
    under = ca.fmax(outlier_cost + softplus(-outlier_cost) - cost, LEAST_UNDER)
    return outlier_cost - ca.log(ca.expm1(under))


def normal_within(n, n_m, information):
    """Return |n_m - n|^2 / 2 in the norm of Sigma_n^-1 (3, 3) [1 / rad^2] (eq:norm)."""
    return ca.bilin(information, n_m - n, n_m - n) / 2
