r"""How a body that lies on the ground follows the fingers that push it, step by step.

Motion is quasi-static: over one time step the body moves by d = (dx, dy, dyaw), so that
the work of friction and springs is least,

    min_d  mu_g N sqrt(dx^2 + dy^2 + c^2 dyaw^2 + SLIP^2)          ground, limit surface
         + sum_f  U(-phi_f(s + d))  +  V(u_f(d))                    fingers

with U' = lam and V' = f_t of finger_spring.py.  `work_slope` has the gradient of these
terms.  N = m g + sum_f (lam_f n - f_t)_z is what presses down, with fingers that slide
down a side (`loads`); c^2 = 3 I_zz / m is the square of half the diagonal of a
rectangular foot (`foot_squared`).  Where the servo of a finger saturates, r goes on no
deeper than a step beyond f_max / k (`reached`).

N and lam_f in the friction terms are those of the iterate before: then each term is
convex, and `improved`, a Newton step on a convex quadratic bound of the work
(majorisation), descends.

s = (x, y, yaw) is the displacement of the body from a given pose.  Inertia is left
out: at 0.2 m/s a body slides 7 mm on its own where mu_g = 0.3, but a finger that slows
down over 0.5 s never lets go of it.  Nothing tips here; whether a body would follows
from the force and the moment of its fingers (tactilenlp/geometry/support.py).

`time_stepping` follows fingers that are where their path says; this page follows paths
that are only planned, on which fingers meet bodies and are held back.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from .finger_spring import (
    SOFT,
    contact_of,
    held_back,
    positive_slope,
    press,
    sticking,
)
from .implicit import solve_3
from .shape import positive_part

SLIP = 3e-5  # [m] a shorter step is sticking: in a second a body creeps less than 1 mm
LIGHTEST = 0.1  # [m g] the least load on the ground: a finger may lift


def pose_after(pose, s):
    """Return the pose after a planar motion s = (x, y, yaw) from a pose (p, R)."""
    p_wo, R_wo = pose
    c, s_ = ca.cos(s[2]), ca.sin(s[2])
    turn = ca.blockcat([[c, -s_, 0], [s_, c, 0], [0, 0, 1]])
    return p_wo + ca.vertcat(s[0], s[1], 0), turn @ R_wo


def reached(shape, finger, theta, pose, p_wf, goal, rho, depth):
    """Return where a finger at p_wf is meant to be on its way to a goal (3,) [m].

    All the way, unless that is more than depth [m] inside the body.
    """
    phi, n, _ = contact_of(shape, finger, theta, pose, p_wf, rho)
    behind = phi + ca.dot(n, goal - p_wf)  # of the tangent plane: no less
    phi_goal = ca.fmax(finger.gap(shape, theta, pose, goal, rho), behind)
    room = ca.fmax(phi, 0)
    share = ca.fmin(1, (room + depth) / (room + ca.fmax(-phi_goal, depth)))
    return p_wf + share * (goal - p_wf)


def foot_squared(shape, theta, R_wo):
    """Return c^2 [m^2]: a moment over c is to the ground what a force is."""
    if shape.foot_squared is not None:
        return shape.foot_squared(theta, R_wo)
    return 3 * (R_wo @ shape.inertia(theta) @ R_wo.T)[2, 2]


@dataclass(frozen=True, eq=False)
class Pushed:
    """A body (shape, theta) that fingers push, from the pose where s = 0.

    finger: as in finger.py; fingers: (r, p, rho) of each; law: mu_g, mu_f, weight [N],
    stiffness [N/m], max_force [N], foot c^2 [m^2].
    """

    shape: object
    finger: object
    theta: object
    pose: tuple
    fingers: list
    law: tuple

    def touched(self, s, d):
        """Return r, gap, slope of the gap, n, across and u of each finger at s + d."""
        at, contacts = pose_after(self.pose, s + d), []
        for r, p, rho in self.fingers:
            phi, n, slope = contact_of(self.shape, self.finger, self.theta, at, r, rho)
            contacts.append((r, phi, slope, n, *held_back(at, d, r, p, rho, n)))
        return contacts

    def loads(self, s, d):
        """Return N and lam_f [N] where the body is at s + d, after a step d."""
        _, mu_f, weight, stiffness, max_force, _ = self.law
        forces, down = [], weight
        for _, phi, _, n, _, u in self.touched(s, d):
            load = press(phi, stiffness, max_force)
            rub = stiffness * sticking(u, mu_f * load, stiffness)
            down += load * n[2] - rub * u[2]
            forces.append(load)
        return [ca.fmax(down, LIGHTEST * weight), *forces]

    def improved(self, s, d):
        """Return a better step d (3,): one majorised Newton step."""
        g, H = self.work_slope(s, d, self.loads(s, d))
        return d - solve_3(H, g)

    def work_slope(self, s, d, loads):
        """Return gradient (3,) [N, N, N m] and majorised Hessian of the work by d.

        The gradient is zero at the step.  loads: N, lam_f, held fixed.
        """
        mu_g, mu_f, _, stiffness, max_force, foot = self.law
        metric = ca.diag(ca.vertcat(1, 1, foot))
        drag = mu_g * loads[0] / ca.sqrt(ca.bilin(metric, d, d) + SLIP**2)
        g, H = drag * metric @ d, drag * metric
        for load, touch in zip(loads[1:], self.touched(s, d), strict=True):
            _, phi, slope, _, across, u = touch
            g -= slope.T * press(phi, stiffness, max_force)
            H += stiffness * positive_slope(-phi) * slope.T @ slope
            rub = stiffness * sticking(u, mu_f * load, stiffness)
            g -= rub * across.T @ u
            H += rub * across.T @ across
        return g, H

    def tips(self, s, d, loads):
        """Return where every finger is after the step, p (3,) [m], and their wrench.

        That is force [N] and moment [N m] of all fingers on the body, (6,), the moment
        about the origin of positions.
        """
        _, mu_f, _, stiffness, _, _ = self.law
        out, wrench = [], ca.DM.zeros(6)
        touched = zip(self.fingers, loads[1:], self.touched(s, d), strict=True)
        for (_, _, rho), load, (r, phi, _, n, _, u) in touched:
            u *= sticking(u, mu_f * load, stiffness)
            out.append(r + n * positive_part(-phi, SOFT) - u)
            force = stiffness * u - load * n
            wrench += ca.vertcat(force, ca.cross(out[-1] - rho * n, force))
        return out, wrench
