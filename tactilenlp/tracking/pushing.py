r"""Quasi-static pushing of many upright boxes at once: the motion in one sample.

The box lies on its four corners.  With forces in weights and the motion D of a sample,

    ground    f_i = -mu_g N_i v_i / |v_i|         corner i; N_i: its share of the load
    finger    side, rim: l_n >= 0, no overlap, |l_t| <= mu l_n   (unilateral contact)
              top:       |(l_1, l_2)| <= mu P                     (P: it presses down)
    balance   sum of all forces and moments in the plane = 0

|v_i| is that of the sample before, which makes the ground's law linear (one step of
iteratively reweighted least squares, warm-started); the fingers' complementarity
problem is solved by projected block Gauss-Seidel, a finger a block.  The loads N_i
follow from where fingers press.  Lynch and Mason, "Stable
pushing" (1996), with four supports in place of a limit surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formulations.rigid_body import ARM

from .box_contact import in_body
from .geometry import Geometry

STEEP = 0.35  # [-] horizontal part of a normal from which a finger pushes by its gap
SWEEPS = 3  # of Gauss-Seidel with several fingers; one finger needs one
LEAST_SPEED = 5e-5  # [m] way of a corner in a sample, rounded
SLOW = 2e-4  # [m] a slower body has no direction of sliding yet
START = 1e-3  # [m] way of every corner then: the friction is isotropic
LEAST_LOAD = 0.02  # [weights] of a corner
MOST_OVERLAP = 1e-4  # [m] more than a finger approached in a sample is not pushed out
LONGEST_MOVE = np.array([8e-3, 8e-3, 0.3])[:, None, None]  # [m, m, rad] in a sample


@dataclass(frozen=True)
class Move:
    """A finger that touches during a sample: from p_0 to p_1 (3,) [m], its radius."""

    p_0: np.ndarray
    p_1: np.ndarray
    radius: float


class _Push:
    """One finger at boxes z (6, k, S): two directions of force and what they ask for.

    direction (2, 3, ...): generalised force per force; wanted (2, ...) [m].
    """

    def __init__(self, geometry, z, move, press, heading):
        gap, n = geometry.contact(z, move.p_1, move.radius)
        c, s = heading
        ux, uy, uz = move.p_1 - move.p_0
        u = c * ux + s * uy, c * uy - s * ux
        level = np.sqrt(n[0] ** 2 + n[1] ** 2)
        self.steep, self.press, self.n_z = level > STEEP, press, n[2]
        approach = -(n[0] * u[0] + n[1] * u[1] + n[2] * uz)
        depth = np.minimum(-gap, np.maximum(approach, 0.0) + MOST_OVERLAP)
        share = np.where(
            self.steep & (approach > 1e-6),
            np.clip(-gap / np.maximum(approach, 1e-6), 0.0, 1.0), 1.0,
        )  # fmt: skip
        q = in_body(z, move.p_1)
        self.x, self.y = q[0] - move.radius * n[0], q[1] - move.radius * n[1]
        level = np.maximum(level, 1e-9)
        first = np.where(self.steep, -n[0], 1.0), np.where(self.steep, -n[1], 0.0)
        second = (
            np.where(self.steep, -n[1] / level, 0.0),
            np.where(self.steep, n[0] / level, 1.0),
        )
        self.direction = [
            (fx, fy, self.x * fy - self.y * fx) for fx, fy in (first, second)
        ]
        self.wanted = (
            np.where(self.steep, depth, u[0]),
            share * (second[0] * u[0] + second[1] * u[1]),
        )
        self.force = [np.zeros(z.shape[1:]), np.zeros(z.shape[1:])]

    @property
    def load(self):
        """The weight that it adds, by the force so far."""
        return np.where(self.steep, self.force[0] * self.n_z, self.press)

    def meet(self, compliance):
        """Prepare: the motions that unit forces cause, and their part at the finger."""
        self.motion = [compliance(d) for d in self.direction]
        (d_1, d_2), (m_1, m_2) = self.direction, self.motion
        self.w_11 = _dot(d_1, m_1) + 1e-12
        self.w_12 = _dot(d_1, m_2)
        self.w_22 = _dot(d_2, m_2) + 1e-12

    def solve(self, D, mu):
        """Update the force, all others kept; return the motion D (3, ...) with it."""
        b_1 = self.wanted[0] - _dot(self.direction[0], D)
        b_2 = self.wanted[1] - _dot(self.direction[1], D)
        b_1 = b_1 + self.w_11 * self.force[0] + self.w_12 * self.force[1]
        b_2 = b_2 + self.w_12 * self.force[0] + self.w_22 * self.force[1]
        det = np.maximum(self.w_11 * self.w_22 - self.w_12**2, 1e-18)
        l_1 = (self.w_22 * b_1 - self.w_12 * b_2) / det
        l_2 = (self.w_11 * b_2 - self.w_12 * b_1) / det
        # A finger on the side slips where its cone ends, one on the top all around.
        side = np.where(l_2 >= 0, mu, -mu)
        slipping = np.maximum(self.w_11 + side * self.w_12, 0.1 * self.w_11)
        slips = np.abs(l_2) > mu * np.maximum(l_1, 0.0)
        pushed = np.maximum(np.where(slips, b_1 / slipping, l_1), 0.0)
        dragged = np.where(slips, side * pushed, l_2)
        limit = mu * self.press
        scale = np.minimum(1.0, limit / np.maximum(np.hypot(l_1, l_2), 1e-12))
        new = [np.where(self.steep, pushed, scale * l_1),
               np.where(self.steep, dragged, scale * l_2)]  # fmt: skip
        change = new[0] - self.force[0], new[1] - self.force[1]
        self.force = new
        return [
            d + change[0] * m_1 + change[1] * m_2
            for d, m_1, m_2 in zip(D, *self.motion, strict=True)
        ]


def pushed(geometry: Geometry, z, moves, press, before, friction):
    """Return the motion (3, ...) [m, m, rad] of bodies z (n + 3, ...) in one sample.

    moves: the fingers that touch, each a Move; press (moves, ...): their force on a top
    [weights]; before (3, ...): the motion of the sample before; friction: of the
    ground, of the fingers.
    """
    mu_g, mu_f = friction
    heading = c, s = np.cos(z[-1]), np.sin(z[-1])
    pairs = zip(moves, press, strict=True)
    pushes = [_Push(geometry, z, move, p, heading) for move, p in pairs]
    compliance = _compliance(geometry.feet(z), pushes, before, heading, mu_g)
    for push in pushes:
        push.meet(compliance)
    D = [np.zeros(z.shape[1:])] * 3
    for _ in range(SWEEPS if len(pushes) > 1 else 1):
        for push in pushes:
            D = push.solve(D, mu_f)
    motion = np.stack([c * D[0] - s * D[1], s * D[0] + c * D[1], D[2]])
    return np.clip(motion, -LONGEST_MOVE, LONGEST_MOVE)


def _compliance(feet, pushes, before, heading, mu_g):
    """Return the function from a generalised force to the motion, body frame.

    The inverse of sum_i w_i (1, 0, -y_i; 0, 1, x_i; -y_i, x_i, r_i^2) over corners.
    """
    c, s = heading
    x, y = feet
    load = 1.0 + sum(p.load for p in pushes)
    m_x = sum(p.load * p.x for p in pushes)
    m_y = sum(p.load * p.y for p in pushes)
    tilt_x, tilt_y = m_x / x, m_y / y
    vx = c * before[0] + s * before[1]
    vy = c * before[1] - s * before[0]
    turn = before[2]
    moved = np.hypot(vx, vy) + ARM * np.abs(turn)
    rounding = (0.1 * moved) ** 2 + LEAST_SPEED**2
    slow = moved <= SLOW
    squared_x = {k: (vx - k * y * turn) ** 2 for k in (1, -1)}
    squared_y = {k: (vy + k * x * turn) ** 2 for k in (1, -1)}

    def weight(i, k):
        """Return w of the corner (i, k): its friction over the speed."""
        way = np.sqrt(squared_x[k] + squared_y[i] + rounding)
        share = np.maximum((load + i * tilt_x + k * tilt_y) / 4, LEAST_LOAD)
        return mu_g * share / np.where(slow, START, way)

    total, first, second = _corner_sums(weight)
    a, b = -y * second, x * first  # [0, 2] and [1, 2] of the matrix
    polar = (x**2 + y**2) * total + 1e-12
    i_22 = 1.0 / (polar - (a**2 + b**2) / total)
    g_x, g_y = -a / total, -b / total

    def compliance(force):
        """Return the motion (3, ...) that a force (fx, fy, moment) causes."""
        turn = i_22 * (g_x * force[0] + g_y * force[1] + force[2])
        return force[0] / total + g_x * turn, force[1] / total + g_y * turn, turn

    return compliance


def _corner_sums(weight):
    """Return the sums of w, of i w and of k w over the corners (i, k)."""
    total, first, second = 0.0, 0.0, 0.0
    for i in (1, -1):
        for k in (1, -1):
            w = weight(i, k)
            total, first, second = total + w, first + i * w, second + k * w
    return total, first, second


def _dot(u, v):
    """Return the inner product of two triples of arrays."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
