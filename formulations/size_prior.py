r"""Prior of sizes: multivariate Student's t of three degrees of freedom.

    p(theta) = C / (1 + |z|^2 / (3 + n))^((3 + n) / 2) / P,  z_i = (theta_i - m_i) / s_i

with mean m and deviation s of `Shape.size_prior`, n sizes, and P the probability
between the `bounds`.  A page's cost is -log p up to a constant,

    (3 + n) / 2 log(1 + |z|^2 / (3 + n)):

the mode's curvature is that of Gaussians of deviations s, and what is ten deviations
off is rare, not impossible.  All sizes of a body have one scale: where some are far
from the mean, the others may be, since t is a Gaussian with a deviation s sqrt(w) of
which only

    w = (3 + n) / (3 u),   u ~ chi^2_3 / 3

is known.  Evidences of classes of shapes are compared with the constant, which has the
units of 1 / theta^n.
"""

from __future__ import annotations

from functools import partial
from math import erf, exp, lgamma, log, pi, prod, sqrt

import casadi as ca

from .sensing import FREEDOM, heavy_tailed

LENGTH, OTHER = 1e-3, 1e-2  # [m], [unit] typical change of an entry of theta
NODES, FAR = 400, 40.0  # midpoints up to chi^2 = FAR, of the probability within bounds


def declare_sizes(nlp, shape):
    """Declare the sizes theta (n,)."""
    units, (low, high) = shape.units or ("m",), shape.bounds
    return nlp.variable(
        "theta", shape.theta, lower=low, upper=high, guess=shape.size_prior[0],
        unit=", ".join(dict.fromkeys(units)),
        scale=[LENGTH if u == "m" else OTHER for u in units] if shape.units else LENGTH,
    )  # fmt: skip


def add_size_prior(nlp, shape, theta):
    """Add the prior of the sizes."""
    nlp.minimize("size prior", partial(size_cost, shape), theta, role="prior")


def size_cost(shape, theta):
    """Return the cost [nats] of theta, zero at the mean of the prior."""
    mean, deviation = (entries(shape, pair) for pair in shape.size_prior)
    return heavy_tailed(ca.sumsqr((theta - mean) / deviation), shape.theta)


def log_size_prior(shape, theta) -> float:
    """Return log p(theta) [log of 1 / units^n], normalised within the bounds."""
    n, total = shape.theta, FREEDOM + shape.theta
    constant = lgamma(total / 2) - lgamma(FREEDOM / 2) - n / 2 * log(total * pi)
    (low, high), (mean, deviation) = (
        [[float(v) for v in ca.vertsplit(entries(shape, p))] for p in pair]
        for pair in (shape.bounds, shape.size_prior)
    )
    sides = list(zip(low, high, mean, deviation, strict=True))
    ends = [((least - m) / s, (most - m) / s) for least, most, m, s in sides]
    constant -= sum(log(s) for s in deviation) + log(_within(ends))
    return constant - float(size_cost(shape, ca.DM(theta)))


def entries(shape, value):
    """Return one number, or one for each entry of theta, as (n,)."""
    value = ca.DM(value)
    return ca.repmat(value, shape.theta, 1) if value.numel() == 1 else value


def _within(ends) -> float:
    """Return the probability that all z_i are between their ends [deviations]."""
    total, width = FREEDOM + len(ends), FAR / NODES
    probability = 0.0
    for k in range(NODES):
        chi = (k + 0.5) * width
        density = sqrt(chi / (2 * pi)) * exp(-chi / 2)  # of chi^2_3
        scale = sqrt(chi / total / 2)
        inside = prod((erf(b * scale) - erf(a * scale)) / 2 for a, b in ends)
        probability += width * density * inside
    return probability
