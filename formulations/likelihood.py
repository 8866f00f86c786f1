r"""eq:loss of every sample: what the fingers felt, robust against wrong samples.

    touch   mixture(touch(phi + delta) + |n - n_m|^2 / (2 sigma_n^2))
    free    mixture(log(1 + exp(-alpha phi)))

    mixture(cost) = -log( exp(-cost) + exp(-outlier_cost) ) + constant     (sensing.py)

Departures from eq:loss, named:
  touch    is two-sided: a felt finger is on the surface, not somewhere inside it
  mixture  bounds the cost of every sample: a boolean may be wrong
  late_gap a finger that feels nothing at the next sample may have left the surface
           already: sigma of its gap grows by the way that it may have moved, and
           sigma of its normal by the angle that this way makes of its radius
  edges    where a finger touches one, the body's normal points to the finger's centre:
           sigma of a normal grows by the angle that the noise of (smoothed) positions
           makes of the radius (`normal_deviation`), whatever is touched
"""

from __future__ import annotations

from math import hypot

import casadi as ca

from . import sensing
from .finger_contact import FingerContact, sensed
from .indentation import NONE
from .names import FREE_TERM, NORMAL_SCALE, TOUCH_SCALE, TOUCH_TERM

ALPHA = 1500.0  # [1/m] steepness of eq:bool
LOGISTIC = 1.7  # [-] a logistic function of steepness 1.7 / sigma is, to 0.01, the
#                     distribution function of a normal variable of deviation sigma


def steepness(sigma):
    """Return alpha [1/m] of eq:bool for positions of a deviation sigma [m]."""
    return 1 / hypot(1 / ALPHA, sigma / LOGISTIC)


def normal_deviation(normal, window):
    """Return the deviation [rad] of a felt normal from the body's; normal: of models.

    By the noise of normals, and by that of positions where a finger meets an edge.
    """
    return hypot(normal, window.sigma_normal, window.sigma_edge)


def add_touches(nlp, window, shape, theta, x, touch, normal, indentation=NONE):
    """Add eq:loss of the samples with contact.

    theta: of the body, or of the part that each touch reads; touch [m], normal [rad]:
    model errors of a sample, added to the sensors' own; indentation: Rigid or Soft
    (indentation.py), of every felt finger.
    """
    finger, t = window.finger, window.touch
    fingers = FingerContact(shape, window.motion, finger)
    sigma = nlp.parameter(TOUCH_SCALE, ca.hypot(touch, window.sigma_position), "m")
    sigma_n = nlp.parameter(NORMAL_SCALE, normal_deviation(normal, window), "rad")

    def touching(theta, x, inside, at, n_m, late_gap, sigma, sigma_n):
        phi, n = fingers.gap_and_normal(theta, x, at)
        phi, n = phi + inside.delta(), finger.felt(n, at.p_wf)
        sigma = inside.widened(ca.hypot(sigma, late_gap))
        sigma_n = ca.hypot(sigma_n, late_gap / at.rho)
        cost = sensing.touch(phi, sigma)
        cost += sensing.normal(n, finger.measured(n_m), sigma_n)
        return sensing.mixture(cost, window.outlier_cost)

    nlp.minimize(
        TOUCH_TERM, touching, theta, x[:, t.pose], indentation, sensed(t), t.normal,
        t.late_gap, sigma, sigma_n, role="likelihood",
    )  # fmt: skip


def add_free(nlp, window, shape, theta, x):
    """Add eq:loss of the samples without contact; theta: as in `add_touches`."""
    fingers, f = FingerContact(shape, window.motion, window.finger), window.free
    alpha = nlp.parameter("alpha", steepness(window.sigma_position), "1/m")

    def free(theta, x, at, alpha):
        cost = sensing.free(fingers.gap(theta, x, at), alpha)
        return sensing.mixture(cost, window.outlier_cost)

    nlp.minimize(
        FREE_TERM, free, theta, x[:, f.pose], sensed(f), alpha, role="likelihood"
    )
