r"""eq:loss of every sample: what the fingers felt, robust against wrong samples.

    touch   mixture(touch(phi + delta) + |n - n_m|^2 / (2 sigma_n^2))
    free    mixture(log(1 + exp(-alpha phi)))

    mixture(cost) = -log( exp(-cost) + exp(-outlier_cost) ) + constant     (sensing.py)

Departures from eq:loss, named:
  touch    is two-sided: a felt finger is on the surface, not somewhere inside it
  mixture  bounds the cost of every sample: a boolean may be wrong
  latency  a finger that feels nothing at the next sample may have left the surface
           already: sigma of its gap grows by the way that it may have moved, and
           sigma of its normal by the angle that this way makes of its radius
"""

from __future__ import annotations

from math import hypot

import casadi as ca

from . import sensing
from .finger_contact import FingerContact, sensed
from .names import FREE_TERM, NORMAL_SCALE, TOUCH_SCALE, TOUCH_TERM

LENGTH, OTHER = 1e-3, 1e-2  # [m], [unit] typical change of an entry of theta
ALPHA = 1500.0  # [1/m] steepness of eq:bool
LOGISTIC = 1.7  # [-] a logistic function of steepness 1.7 / sigma is, to 0.01, the
#                     distribution function of a normal variable of deviation sigma


def steepness(sigma):
    """Return alpha [1/m] of eq:bool for positions of a deviation sigma [m]."""
    return 1 / hypot(1 / ALPHA, sigma / LOGISTIC)


def declare(nlp, window, shape):
    """Declare shape and poses: theta (n,), x (unknowns, poses)."""
    motion, (low, high) = window.motion, shape.bounds
    units = shape.units or ("m",)
    theta = nlp.variable(
        "theta", shape.theta, lower=low, upper=high, guess=shape.size_prior[0],
        unit=", ".join(dict.fromkeys(units)),
        scale=[LENGTH if u == "m" else OTHER for u in units] if shape.units else LENGTH,
    )  # fmt: skip
    x = nlp.variable(
        "x", motion.unknowns, window.poses, guess=0.0, unit=motion.unit,
        scale=motion.scale,
    )  # fmt: skip
    return theta, x


def add(nlp, window, shape, theta, x, touch, normal, indentation):
    """Add eq:loss of every sample.

    theta: of the body, or of the parts that (touches, free samples) read; touch [m],
    normal [rad]: model errors of a sample, added to the sensors' own; indentation:
    Rigid or Soft (indentation.py), of every felt finger.
    """
    finger = window.finger
    fingers = FingerContact(shape, window.motion, finger)
    sigma_p, sigma_n = window.sigma_position, window.sigma_normal
    touch_scale = nlp.parameter(TOUCH_SCALE, ca.hypot(touch, sigma_p), "m")
    normal_scale = nlp.parameter(NORMAL_SCALE, ca.hypot(normal, sigma_n), "rad")
    alpha = nlp.parameter("alpha", steepness(sigma_p), "1/m")

    def touching(theta, x, inside, at, n_m, latency, sigma, sigma_n):
        phi, n = fingers.gap_and_normal(theta, x, at)
        phi, n = phi + inside.delta(), finger.felt(n, at.p_wf)
        off = inside.widened(ca.hypot(sigma, latency))
        turned = ca.hypot(sigma_n, latency / at.rho)
        cost = sensing.touch(phi, off) + sensing.normal(n, finger.measured(n_m), turned)
        return sensing.mixture(cost, window.outlier_cost)

    def free(theta, x, at, alpha):
        cost = sensing.free(fingers.gap(theta, x, at), alpha)
        return sensing.mixture(cost, window.outlier_cost)

    t, f = window.touch, window.free
    nlp.minimize(
        TOUCH_TERM, touching, theta[0], x[:, t.pose], indentation, sensed(t), t.normal,
        t.latency, touch_scale, normal_scale, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        FREE_TERM, free, theta[1], x[:, f.pose], sensed(f), alpha, role="likelihood"
    )
