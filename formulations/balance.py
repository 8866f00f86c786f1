r"""The balance of impulse and momentum in every time step: x_{t+1} = f(x_t, lam, r_t).

    force  = m (v_k - v_{k-1}) + m g dt z - sum_c J_c                         [N s]
    moment = change of angular momentum   - sum_c (p_c - p_wm) x J_c          [N s m]
    sum_k (|force|^2 + |moment|^2 / ARM^2) / (2 (sigma w)^2)     w = m g dt

over the contacts of step k, which act with the impulse J_c at the point p_c; p_wm is
the centre of mass, which need not be the centroid (centre_of_mass.py).  It serves every
body (centroid, inertia: rigid_body.MassProperties) and planar as well as free motion.
The changes of momentum are in rigid_body.py.

An instance of a term reads the contacts of its step as named tuples: a Corner of every
ground contact, then a Push of every finger that pushes.  Steps with equally many
pushing fingers share a term.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca

from . import names
from .finger_contact import FingerContact, Push, pushes_of
from .ground_contact import Corner, GroundContact, corners_of
from .rigid_body import ARM, G, momentum_change, steps_of, uniform


@dataclass(frozen=True, eq=False)
class Balance:
    """The balance of a body with the fingers and the ground that touch it.

    body(shape, theta) -> rigid_body.MassProperties; gravity [m/s^2].
    """

    fingers: FingerContact
    ground: GroundContact
    gravity: float
    body: Callable = uniform

    def unbalanced(self, step, centre, contacts):
        """Return force (3,) [N s] and moment (3,) [N s m], zero where balanced.

        step: rigid_body.Step with x_2; centre (3,) [m]: of mass, from the centroid,
        body frame.
        """
        shape, motion = self.fingers.shape, self.fingers.motion
        theta, x, x_1, dt, w, x_2, dt_1 = step
        mass = w / (G * dt)  # data, so that every mass shares this term's function
        body = self.body(shape, theta)
        body = replace(body, centroid=body.centroid + centre)
        poses = [motion.pose(shape, theta, c) for c in (x, x_1, x_2)]
        linear, angular = momentum_change(body, poses, dt, dt_1)
        force = mass * linear + ca.vertcat(0, 0, mass * self.gravity * dt)
        moment = mass * angular
        p_wo, R_wo = poses[0]
        for c in self.named(theta, x, contacts):
            arm = c.point - p_wo - R_wo @ body.centroid
            force, moment = force - c.impulse, moment - ca.cross(arm, c.impulse)
        return force, moment

    def named(self, theta, x, contacts):
        """Return every Corner and Push as a contact.Contact."""
        sides = {Corner: self.ground, Push: self.fingers}
        return [sides[type(c)].contact(theta, x, c) for c in contacts]

    def cost(self, step, centre, sigma, *contacts):
        """Return the cost [nats] of a step; sigma: deviation of a balance [weights]."""
        force, moment = self.unbalanced(step, centre, contacts)
        square = ca.sumsqr(force) + ca.sumsqr(moment) / ARM**2
        return square / (2 * (sigma * step.w) ** 2)


def contacts_of(window, shape):
    """Return the functions of the contacts of a shape with fingers and ground."""
    ground = GroundContact(shape, window.motion)
    return FingerContact(shape, window.motion, window.finger), ground


class Dynamics(NamedTuple):
    """What moves, and by what: body theta, poses x, and the impulses of all contacts.

    w (steps,) [N s]: weights of the steps; centre (3,) [m]: of mass, from the centroid;
    both None where no term reads them.  pushes, corners: friction.Impulses of fingers
    and ground.
    """

    theta: object
    x: object
    w: object
    centre: object
    pushes: object
    corners: object

    def steps(self, window):
        """Yield number of pushing fingers, Step and contacts of all steps with so many.

        A Step has the pose two samples before, and the time from it to the next, too.
        """
        for count, group in window.groups.items():
            step, s = window.step, group.steps
            w = None if self.w is None else self.w[s]
            now = steps_of(step, self.theta, self.x, w, s)
            x_2 = self.x[:, step.before_2[s]]
            now = now._replace(x_2=x_2, dt_1=step.dt_1[s])
            corner, push = window.corner, window.push
            under = [corners_of(corner, self.corners, c) for c in group.corners.T]
            by = [pushes_of(push, self.pushes, j) for j in group.pushes.T]
            yield count, now, (*under, *by)


def add(nlp, window, balance, dynamics):
    """Add the cost of every step."""
    sigma = nlp.parameters["balance sigma"]
    for count, now, contacts in dynamics.steps(window):
        name = f"{names.BALANCE}, {count} pushing"
        of = now, dynamics.centre, sigma, *contacts
        nlp.minimize(name, balance.cost, *of, role="physics")
