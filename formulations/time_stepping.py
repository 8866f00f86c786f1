r"""One implicit time step of a body that slides: x_{t+1} = f_theta(x_t, x_{t-1}, r).

The step of eq:loss_const, by Stewart and Trinkle, fully implicit: poses, gaps, normals
and arms are those of its end.  With w = m g dt and the unknown x = x_{t+1}

    F(x) = momentum_change(x, x_1, x_2) - finger impulses - friction of the ground = 0

in x, y and yaw, in weights.  The impulses are in sliding_contact.py: complementarity
and Coulomb's law, rounded over one speed s [m/s].

F = 0 is solved by a fixed number of steps while s falls to v_eps: those of Newton's
method with the slope A of F, and of pseudo-transient continuation (Kelley and Keyes,
SIAM J. Numer. Anal. 35, 1998), which bodies that fingers squeeze need,

    (A + |F| / l) d = -F,        d of about l where A is small, Newton's at the root

with yaw counted at ARM; taken is the step that leaves least.  Where roots are noted
(implicit.py), x is one; else its end and A there are constants to any derivative, and
each Newton step from there, x - A^-1 F(x, .), gives x one exact derivative with respect
to all the rest: two steps, two derivatives.

A body that is pressed to the ground from above cannot give way, and so stays where it
is or follows the finger; one that is squeezed stays between its fingers.  It cannot
tip, and the fingers do not give way: they are where their path says.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca

from .finger import Finger, frozen
from .implicit import are_noted, root
from .rigid_body import ARM, PLANAR, G, Step, momentum_change, uniform
from .shape import Shape
from .sliding_contact import Pusher, drag, push

STEP_V_EPS = 2e-3  # [m/s] rounds contact and friction: 0.07 mm in a step of 1/30 s
LONGEST_STEP = 5e-3  # [m] of a Newton step
FIRST_SPEED = 64e-3  # [m/s] the speed s at which Newton's steps begin
EASING, LAST = 8, 14  # steps while s falls, and at its value
LENGTHS = (1e-3, 1e-4)  # [m] l of pseudo-transient steps, besides Newton's
EXACT_STEPS = 2  # Newton steps with exact derivatives, where they are written out
GRAIN = 2.0**-50  # [m, rad] of a pose, [weights/m] of a slope, that are constants


@dataclass(frozen=True)
class Sliding:
    """A body that slides flat on the ground, and the fingers that push it.

    shape, finger: as in shape.py and finger.py; mass [kg]; gravity [m/s^2].
    """

    shape: Shape
    finger: Finger
    mass: float
    gravity: float

    def step(self, theta, x_1, x_2, dt, mu, mu_g, v_eps, *fingers):
        """Return the pose (3,) after a step dt [s] from x_1, before which it was x_2.

        mu, mu_g: friction of the fingers, of the ground; v_eps [m/s]; fingers: a Pusher
        of each.  From rest, x_2 = x_1.
        """
        inputs = theta, x_1, x_2, dt, mu, mu_g, *numbers_of(fingers)
        balance, slope, end_of = step_functions(self, len(fingers))
        if are_noted():
            return root(lambda x: balance(x, v_eps, *inputs), end_of, v_eps, *inputs)
        x = frozen(end_of(v_eps, *inputs), GRAIN)
        A = frozen(slope(x, v_eps, *inputs), GRAIN)
        for _ in range(EXACT_STEPS):
            x -= ca.inv_minor(A) @ balance(x, v_eps, *inputs)
        return x

    def impulse_response(self, x, theta, x_1, x_2, dt, mu, mu_g, v_eps, *fingers):
        """Return by how much the end x (3,) of a step gives way to an impulse (3, 3).

        For one weight in x, in y, and about yaw at ARM: the inverse slope of F.
        """
        _, slope, _ = step_functions(self, len(fingers))
        inputs = theta, x_1, x_2, dt, mu, mu_g, *numbers_of(fingers)
        return ca.inv_minor(slope(x, v_eps, *inputs))

    def imbalance(self, x, s, theta, x_1, x_2, dt, mu, mu_g, *fingers):
        """Return F: change of momentum less impulses in x, y, yaw (3,) [weights]."""
        step = Step(theta, x, x_1, dt, self.mass * G * dt)
        poses = [self.pose(theta, c) for c in (x, x_1, x_2)]
        linear, angular = momentum_change(uniform(self.shape, theta), poses, dt)
        force = self.mass * (linear + ca.vertcat(0, 0, self.gravity * dt))
        moment = self.mass * angular
        for f in fingers:
            p_w, impulse = push(self, step, mu, s, f)
            force -= impulse
            moment -= ca.cross(p_w - poses[0][0], impulse)
        f, m = drag(self, step, mu_g, s, force, moment)
        off = ca.vertcat(force[0] - f[0], force[1] - f[1], (moment[2] - m) / ARM)
        return off / step.w

    def pose(self, theta, x):
        """Return p_wo (3,) [m] and R_wo (3, 3)."""
        return PLANAR.pose(self.shape, theta, x)


@cache
def step_functions(body: Sliding, fingers: int):
    """Return (x, s, *inputs) -> F (3,); -> dF/dx (3, 3); (v_eps, *inputs) -> x.

    inputs: theta, x_1, x_2, dt, mu, mu_g and the numbers of the fingers, one after
    another.  The last two are constants to any derivative.
    """
    x, s, v_eps = ca.SX.sym("x", PLANAR.unknowns), ca.SX.sym("s"), ca.SX.sym("v")
    sizes = body.shape.theta, PLANAR.unknowns, PLANAR.unknowns, 1, 1, 1
    symbols = [ca.SX.sym("a", size) for size in sizes]
    sizes = body.finger.numbers, body.finger.numbers, 1
    pushers = [Pusher(*(ca.SX.sym("f", n) for n in sizes)) for _ in range(fingers)]
    inputs, cse = [*symbols, *numbers_of(pushers)], {"cse": True}
    F = body.imbalance(x, s, *symbols, *pushers)
    A = ca.densify(ca.jacobian(F, x))
    balance = ca.Function("balance", [x, s, *inputs], [F], cse)
    in_metres = ca.diag([1, 1, ARM])  # of a step of x
    newton, size = ca.inv_minor(A) @ F, ca.norm_2(F) * in_metres
    share = ca.fmin(1, LONGEST_STEP / ca.norm_2(in_metres @ newton))
    ends = [x - share * newton]
    ends += [x - ca.inv_minor(A + size / length) @ F for length in LENGTHS]
    end = best(ends, [balance(x, s, *inputs) for x in ends])
    constant = cse | {"never_inline": True, "is_diff_out": [False]}
    slope = ca.Function("slope", [x, s, *inputs], [A], constant)
    nearer = ca.Function("nearer", [x, s, *inputs], [end], constant)
    x = symbols[1]
    for k in range(EASING + LAST):
        s = v_eps * ca.fmax(1, FIRST_SPEED / v_eps) ** max(0.0, 1 - k / EASING)
        x = nearer(x, s, *inputs)
    end_of = ca.Function("found", [v_eps, *inputs], [x], cse)
    return balance, slope, end_of


def numbers_of(fingers):
    """Return the entries of all Pushers, one after another."""
    return [a for finger in fingers for a in finger]


def best(candidates, residuals):
    """Return the candidate whose residual is the smallest."""
    chosen, lowest = candidates[0], ca.sumsqr(residuals[0])
    for x, residual in zip(candidates[1:], residuals[1:], strict=True):
        size = ca.sumsqr(residual)
        chosen = ca.if_else(size < lowest, x, chosen)
        lowest = ca.fmin(size, lowest)
    return chosen
