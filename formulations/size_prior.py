r"""Prior of sizes: Student's t of three degrees of freedom, for every entry of theta.

    p(theta) = prod_i 1 / (pi s_i (1 + z_i^2 / 4)^2 P_i),   z_i = (theta_i - m_i) / s_i

with mean m and deviation s of `Shape.size_prior`, and P the probability between the
`bounds`.  A page's cost is -log p up to a constant, 2 log(1 + z^2 / 4): the mode's
curvature is that of a Gaussian of deviation s, and what is ten deviations off is rare,
not impossible.  Evidences of classes of shapes are compared with the constant, which
has the units of 1 / theta.
"""

from __future__ import annotations

from math import atan, pi

import casadi as ca

from .sensing import heavy_tailed


def size_cost(shape, theta):
    """Return the cost [nats] of theta, zero at the mean of the prior."""
    mean, deviation = (entries(shape, pair) for pair in shape.size_prior)
    return ca.sum1(heavy_tailed((theta - mean) / deviation))


def log_size_prior(shape, theta) -> float:
    """Return log p(theta) [log of 1 / units], normalised within the bounds."""
    cost = float(size_cost(shape, ca.DM(theta)))
    (low, high), (mean, deviation) = (
        [ca.vertsplit(entries(shape, p)) for p in pair]
        for pair in (shape.bounds, shape.size_prior)
    )
    for least, most, m, s in zip(low, high, mean, deviation, strict=True):
        least, most, m, s = (float(v) for v in (least, most, m, s))
        inside = _cumulative((most - m) / s) - _cumulative((least - m) / s)
        cost += float(ca.log(pi * s * inside))
    return -cost


def entries(shape, value):
    """Return one number, or one for each entry of theta, as (n,)."""
    value = ca.DM(value)
    return ca.repmat(value, shape.theta, 1) if value.numel() == 1 else value


def _cumulative(z: float) -> float:
    """Return the cumulative probability of 1 / (pi (1 + z^2 / 4)^2)."""
    return 0.5 + (atan(z / 2) + (z / 2) / (1 + z * z / 4)) / pi
