r"""The functions of a body that the printed problem (paper.py) is made of.

    felt         c_t = 1: |n_m - n|^2_{Sigma_n^-1} / 2 + log(1 + e^(alpha phi))
    free         c_t = 0: log(1 + e^(-alpha phi))                      eq:loss
    unpredicted  |x_t - f_theta(x_{t-1}, lam_t, r_t)|^2 / (2 deviation^2)

f is one step of impulse and momentum, where d_1 is the rotation vector of the last step
and J the inertia per unit mass, world frame:

    p_f = p + (p - p_1) + (sum lam / m + g dt) dt
    R_f = exp(d) R,     d = d_1 + J^-1 (dt sum r x lam / m - d_1 x J d_1)
"""

from __future__ import annotations

import casadi as ca

from . import sensing
from .balance import Balance
from .between_actions import way_squared
from .finger_contact import FingerContact
from .ground_contact import GroundContact
from .rigid_body import ARM, rotation, turn


class Physics:
    """The functions of one body, its fingers and the ground."""

    def __init__(self, window, scene, shape):
        self.motion, self.scene, self.shape = window.motion, scene, shape
        self.fingers = FingerContact(shape, window.motion, window.finger)
        self.ground = GroundContact(shape, window.motion)
        self.balance = Balance(self.fingers, self.ground, scene.gravity)

    def felt(self, theta, x, at, n_m, alpha, information):
        """Return eq:loss of a sample with contact of a finger `at` (a Push)."""
        phi, n = self.fingers.gap_and_normal(theta, x, at)
        cost = sensing.normal_within(n, n_m, ca.reshape(information, 3, 3))
        return cost + sensing.logistic_contact(phi, alpha)

    def free(self, theta, x, at, alpha):
        """Return eq:loss of a sample without contact."""
        return sensing.free(self.fingers.gap(theta, x, at), alpha)

    def unpredicted(self, step, deviation, *contacts):
        """Return |x_t - f(x_{t-1}, lam_t, r_t)|^2 over 2 deviation^2."""
        theta, x, x_1, dt, _, x_2, dt_1 = step
        poses = (self.motion.pose(self.shape, theta, c) for c in (x, x_1, x_2))
        (p, R), (p_1, R_1), (p_2, R_2) = poses
        force, moment = ca.DM.zeros(3), ca.DM.zeros(3)
        for c in self.balance.named(theta, x, contacts):
            force += c.impulse
            moment += ca.cross(c.point - p, c.impulse)
        m, g = self.scene.mass, ca.vertcat(0, 0, -self.scene.gravity)
        p_f = p_1 + dt / dt_1 * (p_1 - p_2) + (force / m + g * dt) * dt
        J = R_1 @ ca.densify(self.shape.inertia(theta)) @ R_1.T
        d_1 = dt / dt_1 * turn(R_1, R_2)
        d = d_1 + ca.inv_minor(J) @ (dt * moment / m - ca.cross(d_1, J @ d_1))
        turn_squared = ca.sumsqr(R - rotation(d) @ R_1) / 2
        return (ca.sumsqr(p - p_f) + ARM**2 * turn_squared) / (2 * deviation**2)

    def between_actions(self, theta, x, x_1, deviation):
        """Return |x_t - x_{t-1}|^2 over 2 deviation^2."""
        return way_squared(self.motion, self.shape, theta, x, x_1) / (2 * deviation**2)
