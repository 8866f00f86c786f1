r"""Fingers with an unknown orientation error: each normal is turned by a constant w_f.

    n_m - w_f x n_m + w_f x (w_f x n_m) / 2     in place of n_m, everywhere
    sum_f |w_f|^2 / (2 TURN_SIGMA^2)          w_f ~ N(0, TURN_SIGMA^2), world (`prior`)

A tactile sensor that is turned on its finger reports all normals turned by the same
vector; the rotation is exact to second order.  The mean over the fingers about the
vertical turns the world: only the prior determines it.  Where `window.aligned` is true,
w_f is zero and no unknown (reduction "aligned").
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from .names import FINGER_TURN

TURN_SIGMA = 0.05  # [rad] deviation of each component: a sensor fitted by hand


def with_normals_turned_back(nlp, window):
    """Return the window whose measured normals are turned back, if fingers may be.

    Declares the turns w_f (3, fingers) [rad] with their prior.
    """
    if window.aligned:
        return window
    w_f = nlp.variable(
        FINGER_TURN, 3, window.fingers, guess=0.0, unit="rad", scale=0.01
    )
    nlp.minimize(f"{FINGER_TURN} prior", prior, w_f, role="prior")
    touch, finger = window.touch, replace(window.finger, measured=turned_back)
    above_turn = w_f[:, touch.finger].below(touch.normal)
    return replace(window, touch=replace(touch, normal=above_turn), finger=finger)


def prior(w_f):
    """Return the cost of a turn (3,) [rad]."""
    return ca.sumsqr(w_f) / (2 * TURN_SIGMA**2)


def turned_back(normal):
    """Return the normal (3,) of a finger whose measured one has its turn below it."""
    n_m, w_f = normal[:3], normal[3:]
    change = ca.cross(w_f, n_m)
    return n_m - change + ca.cross(w_f, change) / 2
