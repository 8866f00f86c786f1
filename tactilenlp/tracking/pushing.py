r"""Quasi-static pushing of an upright body: its motion in one sample, as expressions.

The body lies on four feet, the corners of its support.  With forces in weights and the
motion D of a sample,

    ground    f_i = -mu_g N_i v_i / |v_i|         foot i; N_i: its share of the load
    finger    side, rim: l_n >= 0, no overlap, |l_t| <= mu l_n   (unilateral contact)
              top:       |(l_1, l_2)| <= mu P                     (P: it presses down)
    balance   sum of all forces and moments in the plane = 0

|v_i| is that of the sample before, which makes the ground's law linear (one step of
iteratively reweighted least squares, warm-started); the fingers' complementarity
problem is solved by projected block Gauss-Seidel, a finger a block.  The loads N_i
follow from where fingers press.  Lynch and Mason, "Stable
pushing" (1996), with four supports in place of a limit surface.

Fingers are where they were measured, and hundreds of tracks are moved at once.  The law
of formulations/pushing.py is another one: it follows paths that are only planned, on
which servos give way, and its slopes enter the expected gain.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import casadi as ca

from formulations.rigid_body import ARM

from .geometry import feet_of, in_body, rotated, upright_contact

STEEP = 0.35  # [-] horizontal part of a normal from which a finger pushes by its gap
SWEEPS = 3  # of Gauss-Seidel with several fingers; one finger needs one
# Of a body that is known where it is felt, few at a time: errors of a step fall by half
# where two fingers pinch it (24 bodies in MuJoCo).  Tracks are hundreds.
FELT_SWEEPS = 12
LEAST_SPEED = 5e-5  # [m] way of a foot in a sample, rounded
SLOW = 2e-4  # [m] a slower body has no direction of sliding yet
START = 1e-3  # [m] way of every foot then: the friction is isotropic
LEAST_LOAD = 0.02  # [weights] of a foot
MOST_OVERLAP = 1e-4  # [m] more than a finger approached in a sample is not pushed out
APPROACHING = 1e-6  # [m] a shorter approach meets the body all the way
LONGEST_MOVE = ca.DM([8e-3, 8e-3, 0.3])  # [m, m, rad] in a sample
TINY = 1e-24  # in roots, whose slopes at zero would have no number


class Move(NamedTuple):
    """A finger that touches during a sample: from p_0 to p_1 (3,) [m], its radius.

    press [weights]: its force if it is on the top.
    """

    p_0: ca.SX
    p_1: ca.SX
    radius: ca.SX
    press: ca.SX


class _Push:
    """One finger at a body z (n + 3,): two directions of force and what they ask for.

    direction: generalised forces (3,) per force; wanted [m]; force [weights] so far;
    at: where it touches, x, y [m], body frame.  q (2,), n (3,): the finger's centre and
    the outward normal there, body frame; gap [m].
    """

    def __init__(self, z, move: Move, q, gap, n):
        u = in_body(z, move.p_1) - in_body(z, move.p_0)
        level = ca.sqrt(n[0] ** 2 + n[1] ** 2 + TINY)
        self.steep, self.press = level > STEEP, move.press
        approach = approach_of(z, move, n)
        depth = ca.fmin(-gap, ca.fmax(approach, 0) + MOST_OVERLAP)
        met = ca.fmin(ca.fmax(-gap / ca.fmax(approach, APPROACHING), 0), 1)
        met = ca.if_else(approach > APPROACHING, met, 1)
        self.at = q[:2] - move.radius * n[:2]
        inward, along = -n[:2], ca.vertcat(-n[1], n[0]) / level
        forces = (
            ca.if_else(self.steep, inward, ca.DM([1, 0])),
            ca.if_else(self.steep, along, ca.DM([0, 1])),
        )
        x, y = ca.vertsplit(self.at)
        self.direction = [ca.vertcat(f, x * f[1] - y * f[0]) for f in forces]
        self.wanted = (
            ca.if_else(self.steep, depth, u[0]),
            ca.if_else(self.steep, met, 1) * ca.dot(forces[1], u),
        )
        self.force = [ca.SX(0), ca.SX(0)]

    @property
    def load(self):
        """The weight that it adds before it has pushed."""
        return ca.if_else(self.steep, 0, self.press)

    def meet(self, compliance):
        """Prepare: the motions that unit forces cause, and their part at the finger."""
        self.motion = [compliance @ d for d in self.direction]
        (d_1, d_2), (m_1, m_2) = self.direction, self.motion
        self.w_11, self.w_12 = ca.dot(d_1, m_1) + 1e-12, ca.dot(d_1, m_2)
        self.w_22 = ca.dot(d_2, m_2) + 1e-12

    def solve(self, D, mu):
        """Update the force, all others kept; return the motion D (3,) with it."""
        b_1, b_2 = (
            w - ca.dot(d, D) for w, d in zip(self.wanted, self.direction, strict=True)
        )
        b_1 += self.w_11 * self.force[0] + self.w_12 * self.force[1]
        b_2 += self.w_12 * self.force[0] + self.w_22 * self.force[1]
        det = ca.fmax(self.w_11 * self.w_22 - self.w_12**2, 1e-18)
        l_1 = (self.w_22 * b_1 - self.w_12 * b_2) / det
        l_2 = (self.w_11 * b_2 - self.w_12 * b_1) / det
        # A finger on the side slips where its cone ends, one on the top all around.
        side = ca.if_else(l_2 >= 0, mu, -mu)
        slipping = ca.fmax(self.w_11 + side * self.w_12, 0.1 * self.w_11)
        slips = ca.fabs(l_2) > mu * ca.fmax(l_1, 0)
        pushed = ca.fmax(ca.if_else(slips, b_1 / slipping, l_1), 0)
        dragged = ca.if_else(slips, side * pushed, l_2)
        scale = ca.fmin(1, mu * self.press / ca.sqrt(l_1**2 + l_2**2 + TINY))
        new = [ca.if_else(self.steep, pushed, scale * l_1),
               ca.if_else(self.steep, dragged, scale * l_2)]  # fmt: skip
        for m, now, before in zip(self.motion, new, self.force, strict=True):
            D += (now - before) * m
        self.force = new
        return D


def push_motion(shape, z, moves: list[Move], before, friction):
    """Return the motion (3,) [m, m, rad] of a body z (n + 3,) in one sample.

    moves: of the fingers that touch; before (3,): the motion of the sample before;
    friction: of the ground, of the fingers.
    """
    contacts = [upright_contact(shape, z, move.p_1, move.radius) for move in moves]
    pushes = [_Push(z, m, *met) for m, met in zip(moves, contacts, strict=True)]
    return _motion(z, feet_of(shape, z), pushes, before, friction)


def felt_push_motion(z, moves: list[Move], normals, shares, before, friction):
    """Return the motion (3,) of a body whose surface is known where it is felt alone.

    z (4,): half the width of its support [m], pose of its centre of mass; normals
    [(3,)]: outward, world frame, as felt; shares [-]: of the way of each finger during
    which it touches.  The others as of `push_motion`.
    """
    pushes = []
    for move, normal, share in zip(moves, normals, shares, strict=True):
        n = rotated(normal, -z[-1])
        gap = -share * ca.fmax(approach_of(z, move, n), 0)
        pushes.append(_Push(z, move, in_body(z, move.p_1), gap, n))
    return _motion(z, (z[0], z[0]), pushes, before, friction, FELT_SWEEPS)


def approach_of(z, move: Move, n):
    """Return the way [m] of a finger against an outward normal n (3,), body frame."""
    u = in_body(z, move.p_1) - in_body(z, move.p_0)
    return -(n[0] * u[0] + n[1] * u[1] + n[2] * (move.p_1 - move.p_0)[2])


def _motion(z, feet, pushes, before, friction, sweeps=SWEEPS):
    """Return the motion (3,) [m, m, rad] of a body on its feet, world frame."""
    mu_g, mu_f = friction
    compliance = _compliance(feet, pushes, rotated(before, -z[-1]), mu_g)
    for push in pushes:
        push.meet(compliance)
    D = ca.SX.zeros(3)
    for _ in range(sweeps if len(pushes) > 1 else 1):
        for push in pushes:
            D = push.solve(D, mu_f)
    return ca.fmin(ca.fmax(rotated(D, z[-1]), -LONGEST_MOVE), LONGEST_MOVE)


def _compliance(feet, pushes, before, mu_g):
    """Return the matrix (3, 3) from a generalised force to the motion, body frame.

    The inverse of sum_i w_i (1, 0, -y_i; 0, 1, x_i; -y_i, x_i, r_i^2) over the feet, w
    the friction of a foot over its speed.
    """
    x, y = feet
    load = 1 + sum(p.load for p in pushes)
    tilt_x = sum(p.load * p.at[0] for p in pushes) / x
    tilt_y = sum(p.load * p.at[1] for p in pushes) / y
    vx, vy, turn = before[0], before[1], before[2]
    travel = ca.sqrt(vx**2 + vy**2 + TINY) + ARM * ca.fabs(turn)
    rounding = (0.1 * travel) ** 2 + LEAST_SPEED**2
    total, first, second = 0, 0, 0
    for i, k in product((1, -1), (1, -1)):
        way = (vx - k * y * turn) ** 2 + (vy + i * x * turn) ** 2
        way = ca.if_else(travel <= SLOW, START, ca.sqrt(way + rounding))
        share = ca.fmax((load + i * tilt_x + k * tilt_y) / 4, LEAST_LOAD)
        w = mu_g * share / way
        total, first, second = total + w, first + i * w, second + k * w
    a, b = -y * second, x * first  # [0, 2] and [1, 2] of the matrix
    polar = (x**2 + y**2) * total + 1e-12
    along = ca.vertcat(-a / total, -b / total, 1)
    inverse = along @ along.T / (polar - (a**2 + b**2) / total)
    return inverse + ca.diag(ca.vertcat(1 / total, 1 / total, 0))
