r"""One implicit time step of a body that slides: x_{t+1} = f_theta(x_t, x_{t-1}, r).

The step of eq:loss_const, by Stewart and Trinkle, fully implicit: poses, gaps, normals
and arms are those of its end.  With w = m g dt and the unknown x = x_{t+1}

    momentum_change(x, x_1, x_2) = sum of finger impulses + friction of the ground

in x, y and yaw.  Complementarity and Coulomb's law are steps; both are rounded over
one speed, `v_eps` s [m/s]:

    lam_n = w S(-phi / (s dt))              0 <= lam_n  _|_  phi >= 0      as s -> 0
    lam_t = -mu lam_n v_s / sqrt(|v_s|^2 + s^2)                  maximum dissipation

with S(z) = (z + sqrt(z^2 + ROUND^2)) / 2.  An impulse of one weight overlaps by s dt
and rebounds at two or three s: the energy of body and overlap never grows.
The ground carries the body on the corners of `shape`, which share the load affinely,
N_i = a + b X_i + c Y_i (the least loads that hold it flat: the other three balances,
z, roll, pitch); a corner that would have to pull carries nothing.

Solved by a fixed number of damped Newton steps while s falls to its value.  Their end
x and the slope A of F there are constants to any derivative; each Newton step from
there, x - A^-1 F(x, .), gives x one exact derivative with respect to all the rest
(theorem of implicit functions): two steps, two derivatives.

A body that is pressed to the ground from above cannot give way, and so stays where it
is or follows the finger; one that is squeezed stays between its fingers.  It cannot
tip, and the fingers give no way: they are where their path says.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from .finger import Finger, frozen
from .rigid_body import ARM, PLANAR, G, momentum_change, uniform
from .shape import Shape, positive_part

V_EPS = 2e-3  # [m/s] rounds contact and friction: 0.07 mm in a step of 1/30 s
ROUND = 0.1  # [weights] rounds the normal impulse where the gap closes

NONE = 0.01  # [weights] rounds the load of a corner that would have to pull
LONGEST = 5e-3  # [m] of a Newton step
ROUGH = 64e-3  # [m/s] the speed s at which Newton's steps begin
EASING, LAST = 8, 5  # Newton steps while s falls, and at its value
DAMPING = (1.0, 0.5, 0.25, 0.1)  # of a Newton step: the one that leaves least is taken
GRAIN = 2.0**-50  # [m, rad] of a pose, [weights/m] of a slope, that are constants


@dataclass(frozen=True)
class Sliding:
    """A body that slides flat on the ground, and the fingers that push it.

    shape, finger: what they may be asked (shape.py, finger.py); mass [kg];
    gravity [m/s^2].
    """

    shape: Shape
    finger: Finger
    mass: float
    gravity: float

    def step(self, theta, x_1, x_2, dt, mu, mu_g, v_eps, *fingers):
        """Return the pose (3,) after a step dt [s] from x_1, before which it was x_2.

        mu, mu_g: friction of the fingers, of the ground; v_eps [m/s]; fingers: of each
        p_wf, p_wf_1, rho, one after another: where it is at the end and at the begin of
        the step [m], its radius [m].  From rest, x_2 = x_1.
        """
        given = theta, x_1, x_2, dt, mu, mu_g, *fingers
        balance, slope, damped = self._functions([ca.SX(a).numel() for a in given])
        x = x_1
        for k in range(EASING + LAST):
            s = v_eps * ca.fmax(1, ROUGH / v_eps) ** max(0.0, 1 - k / EASING)
            x = damped(x, s, *given)
        x = frozen(x, GRAIN)
        A = frozen(slope(x, v_eps, *given), GRAIN)
        for _ in range(2):
            x -= ca.inv_minor(A) @ balance(x, v_eps, *given)
        return x

    def gives(self, x, theta, x_1, x_2, dt, mu, mu_g, v_eps, *fingers):
        """Return by how much the end x (3,) of a step gives way to an impulse (3, 3).

        For one weight in x, in y, and about yaw at ARM: the inverse slope of F.
        """
        given = theta, x_1, x_2, dt, mu, mu_g, *fingers
        slope = self._functions([ca.SX(a).numel() for a in given])[1]
        return ca.inv_minor(slope(x, v_eps, *given))

    def _functions(self, sizes):
        """Return (x, s, *given) -> F (3,); -> dF/dx (3, 3); -> x a Newton step further.

        The last two are constants to any derivative, and called, not written out.
        """
        x, s = ca.SX.sym("x", PLANAR.unknowns), ca.SX.sym("s")
        given = [ca.SX.sym(f"a{i}", n) for i, n in enumerate(sizes)]
        inputs, cse = [x, s, *given], {"cse": True}
        F = self.imbalance(x, s, *given)
        A = ca.densify(ca.jacobian(F, x))
        balance = ca.Function("balance", inputs, [F], cse)
        d = ca.inv_minor(A) @ F
        way = ca.sqrt(d[0] ** 2 + d[1] ** 2 + (ARM * d[2]) ** 2)
        d *= ca.fmin(1, LONGEST / way)
        ends = [x - share * d for share in DAMPING]
        end = best(ends, [balance(x, s, *given) for x in ends])
        constant = cse | {"never_inline": True, "is_diff_out": [False]}
        slope = ca.Function("slope", inputs, [A], constant)
        damped = ca.Function("damped", inputs, [end], constant)
        return balance, slope, damped

    def imbalance(self, x, s, theta, x_1, x_2, dt, mu, mu_g, *fingers):
        """Return change of momentum less impulses in x, y, yaw (3,) [weights]."""
        w = self.mass * G * dt
        body, poses = uniform(self.shape, theta, self.mass), (x, x_1, x_2)
        poses = [self.pose(theta, c) for c in poses]
        linear, angular = momentum_change(body, poses, dt)
        force = self.mass * (linear + ca.vertcat(0, 0, self.gravity * dt))
        moment = self.mass * angular
        p = self.pose(theta, x)[0]
        for p_wf, p_wf_1, rho in zip(*(fingers[i::3] for i in range(3)), strict=True):
            p_w, impulse = self.push(theta, x, x_1, dt, w, mu, s, p_wf, p_wf_1, rho)
            force -= impulse
            moment -= ca.cross(p_w - p, impulse)
        f, m = self.drag(theta, x, x_1, dt, w, mu_g, s, force, moment)
        return ca.vertcat(force[0] - f[0], force[1] - f[1], (moment[2] - m) / ARM) / w

    def pose(self, theta, x):
        return PLANAR.pose(self.shape, theta, x)

    def push(self, theta, x, x_1, dt, w, mu, s, p_wf, p_wf_1, rho):
        """Return where a finger touches [m], and its impulse on the body [N s]."""
        (p, R), (p_1, R_1) = self.pose(theta, x), self.pose(theta, x_1)
        phi = self.finger.gap(self.shape, theta, (p, R), p_wf, rho)
        p_w, n = self.finger.touch(self.shape, theta, (p, R), p_wf, rho)
        lam_n = w * positive_part(-phi / (s * dt), ROUND)
        body_before = p_1 + R_1 @ (R.T @ (p_w - p))
        v = (self.finger.before(p_w, p_wf, p_wf_1) - body_before) / dt
        return p_w, -lam_n * n + coulomb(mu * lam_n, v - n * ca.dot(v, n), s)

    def drag(self, theta, x, x_1, dt, w, mu, s, force, moment):
        """Return friction of the ground (2,) [N s], its moment about z [N s m].

        force, moment (3,): what the ground has to bear, of which z, roll and pitch
        say how the corners share the load.
        """
        (p, R), (p_1, R_1) = self.pose(theta, x), self.pose(theta, x_1)
        corners = [self.shape.corner(theta, ca.DM(c)) for c in self.shape.corners]
        arms = [R @ c for c in corners]
        ways = [(p + R @ c - p_1 - R_1 @ c) / dt for c in corners]
        each = [coulomb(mu, v[:2], s) for v in ways]
        A, shares = 0, []
        for r, f in zip(arms, each, strict=True):
            b = ca.horzcat(1, r[0] / ARM, r[1] / ARM)
            shares.append(b)
            A += (
                ca.vertcat(1, (r[1] - r[2] * f[1]) / ARM, (r[2] * f[0] - r[0]) / ARM)
                @ b
            )
        load = ca.vertcat(force[2], moment[0] / ARM, moment[1] / ARM)
        abc = ca.inv_minor(A) @ load
        total, turning = ca.SX.zeros(2), 0
        for b, r, f in zip(shares, arms, each, strict=True):
            N = positive_part(b @ abc, NONE * w)
            total += N * f
            turning += N * (r[0] * f[1] - r[1] * f[0])
        return total, turning


def coulomb(most, v_s, s):
    """Return the friction impulse against sliding at v_s [m/s], `most` at the most."""
    return -most * v_s / ca.sqrt(ca.sumsqr(v_s) + s**2)


def best(candidates, residuals):
    """Return the candidate whose residual is the smallest."""
    chosen, lowest = candidates[0], ca.sumsqr(residuals[0])
    for x, residual in zip(candidates[1:], residuals[1:], strict=True):
        size = ca.sumsqr(residual)
        chosen = ca.if_else(size < lowest, x, chosen)
        lowest = ca.fmin(size, lowest)
    return chosen


def path(body, fingers, samples):
    """Return the Function from a pose at rest to the poses at all samples.

    (x_0 (3,), theta, (dt, mu, mu_g, v_eps) (4,), p_wf (fingers * numbers, samples) one
    finger below another, rho (fingers,)) -> x (3, samples), of which the first is x_0.
    """
    x_0, theta = ca.MX.sym("x_0", PLANAR.unknowns), ca.MX.sym("theta", body.shape.theta)
    known, rho = ca.MX.sym("known", 4), ca.MX.sym("rho", fingers)
    p_wf = ca.MX.sym("p_wf", body.finger.numbers * fingers, samples)
    shared = [ca.repmat(a, 1, samples - 1) for a in (theta, known, rho)]
    steps = _step(body, fingers).mapaccum(samples - 1)
    states = steps(ca.vertcat(x_0, x_0), *shared, p_wf[:, 1:], p_wf[:, :-1])
    x = ca.horzcat(x_0, states[: PLANAR.unknowns, :])
    return ca.Function("path", [x_0, theta, known, p_wf, rho], [x])


def _step(body, fingers):
    """Return the step: ((x_1, x_2), theta, known, rho, p_wf, p_wf_1) -> (x, x_1)."""
    n, size = body.finger.numbers, PLANAR.unknowns
    y, theta = ca.SX.sym("y", 2 * size), ca.SX.sym("theta", body.shape.theta)
    known, rho = ca.SX.sym("known", 4), ca.SX.sym("rho", fingers)
    p, p_1 = ca.SX.sym("p", n * fingers), ca.SX.sym("p_1", n * fingers)
    rows = [slice(f * n, (f + 1) * n) for f in range(fingers)]
    pushing = [a for f, row in enumerate(rows) for a in (p[row], p_1[row], rho[f])]
    x = body.step(theta, y[:size], y[size:], *ca.vertsplit(known), *pushing)
    return ca.Function(
        "step", [y, theta, known, rho, p, p_1], [ca.vertcat(x, y[:size])]
    )
