r"""What the fingers do to the body: the finger part of g(x_t, lam, r_t) of eq:vimp.

An impulse lam = (lam_n, lam_1, lam_2) acts along (-n, t1, t2) at the point where finger
and body touch, during the step that ends at its sample.  With D of contact.py, the
energy that friction fails to dissipate there, in nats,

    felt      kappa D dt / (w mm)
    unfelt    kappa lam_n max(phi, 0) / (w mm) + UNFELT lam_n / w

with w = m g dt.

A finger whose sample is missing has the first cost, and with its indentation
delta (indentation.py)

    unseen    kappa lam_n max(phi + delta, 0) / (w mm) + touch(min(phi + delta, 0))
    lasting   |lam_n' / w' - lam_n / w| / CHANGE        from one sample ' to the next

A finger that feels nothing has the second cost in place of the first; the rounding of
its friction cone neither costs nor earns anything, since all its impulses cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from . import contact, indentation, sensing
from .contact import MM
from .friction import cone_rounding_of
from .names import FINGER_IMPULSE

UNFELT = 2000.0  # [nats] for an impulse of one weight not felt: 20 for what would be

ROUNDINGS = 50  # [1 / finger radius] length that rounds max(phi, 0) of an unfelt finger
GAP_ROUNDING = 0.02e-3  # [m] rounds max(phi, 0) of a finger whose sample is missing
# Four to seven times the mean change between two samples in contact (0.16 in 1660 of
# the simulator of the shared boxes, 0.09 in their estimates): decides where nothing
# else does.  Paths are pulled with 0.15 (168 recordings, results/EXPERIMENTS.md).
CHANGE = 0.6  # [weights]
CHANGE_ROUNDING = 0.02  # [weights] rounds |lam_n' / w' - lam_n / w|


class Push(NamedTuple):
    """What a term reads of a finger that pushes, p_wf and rho [m] where it is.

    theta: the part of the body that it sees, None: all of it; t: where t1 points.
    """

    theta: object
    lam: object
    p_wf: object
    rho: object
    t: object


@dataclass(frozen=True, eq=False)
class FingerContact:
    """The pure functions of a body (shape, motion of its pose x) and a finger."""

    shape: object
    motion: object
    finger: object

    def touch(self, theta, x, p_wf, rho, t):
        """Return the point p_w [m], normal and tangents of the body at the contact."""
        pose = self.motion.pose(self.shape, theta, x)
        p_w, n = self.finger.touch(self.shape, theta, pose, p_wf, rho)
        return p_w, n, contact.tangents(n, t)

    def contact(self, theta, x, push):
        """Return the Contact of a Push."""
        theta = theta if push.theta is None else push.theta
        p_w, n, tangents = self.touch(theta, x, push.p_wf, push.rho, push.t)
        return contact.Contact(push.lam, p_w, -n, tangents)

    def impulse(self, theta, x, lam, p_wf, rho, t):
        """Return the impulse of a finger on the body, world frame [N s]."""
        return self.contact(theta, x, Push(None, lam, p_wf, rho, t)).impulse

    def velocity(self, theta, x, x_1, dt, p_wf, p_wf_1, rho, t):
        """Return v_n, v_s (2,) [m/s] of finger and body; v_n > 0 parts them."""
        p_w, n, (t_1, t_2) = self.touch(theta, x, p_wf, rho, t)
        p, R = self.motion.pose(self.shape, theta, x)
        p_1, R_1 = self.motion.pose(self.shape, theta, x_1)
        body_before = p_1 + R_1 @ (R.T @ (p_w - p))
        v = (self.finger.before(p_w, p_wf, p_wf_1) - body_before) / dt
        return -ca.dot(v, n), ca.vertcat(ca.dot(v, t_1), ca.dot(v, t_2))

    def felt(
        self, theta, x, x_1, lam, p_wf, p_wf_1, rho, t, dt, w, kappa, v_eps, rounding,
        mu,
    ):  # fmt: skip
        """Return the cost of friction that does not dissipate."""
        _, v_s = self.velocity(theta, x, x_1, dt, p_wf, p_wf_1, rho, t)
        energy = contact.dissipation(mu, lam, v_s, v_eps, rounding * w)
        return kappa * energy * dt / (w * MM)

    def unfelt(self, theta, x, lam, p_wf, rho, w, kappa):
        """Return the cost of the impulse of a finger that feels nothing."""
        pose = self.motion.pose(self.shape, theta, x)
        phi = self.finger.gap(self.shape, theta, pose, p_wf, rho)
        energy = contact.complementarity(lam, phi, rho / ROUNDINGS)
        return kappa * energy / (w * MM) + UNFELT * lam[0] / w

    def unseen(self, theta, x, lam, p_wf, rho, inside, w, kappa, sigma):
        """Return the cost of an impulse across a gap, and of penetration."""
        pose = self.motion.pose(self.shape, theta, x)
        phi = self.finger.gap(self.shape, theta, pose, p_wf, rho) + inside.delta()
        energy = contact.complementarity(lam, phi, GAP_ROUNDING)
        return kappa * energy / (w * MM) + sensing.touch(ca.fmin(phi, 0), sigma)

    def lasting(self, lam, lam_1, w, w_1):
        """Return the cost of how a normal impulse changed since the sample before."""
        change = lam[0] / w - lam_1[0] / w_1
        return (ca.sqrt(change**2 + CHANGE_ROUNDING**2) - CHANGE_ROUNDING) / CHANGE


def pushes_of(push, pushes, j):
    """Return the Push that each instance of a term reads; j: its row in `push`."""
    theta = None if pushes.theta is None else pushes.theta.pick(j)
    return Push(theta, pushes.lam[:, j], push.p_wf[j], push.radius[j], push.tangent[j])


def add(nlp, window, fingers, theta, x, pushes):
    """Add the costs of fingers that feel their contact, and of those that do not.

    pushes: friction.Impulses of every push.
    """
    step, push, unfelt = window.step, window.push, window.unfelt
    theta = theta if pushes.theta is None else pushes.theta
    lam, mu, w = pushes.lam, pushes.mu, pushes.w
    kappa, v_eps = nlp.parameters["kappa"], nlp.parameters["speed rounding"]
    silent = set(unfelt.tolist())
    felt = [i for i in range(len(push)) if i not in silent]
    f, s = push.pick(felt), push.step[felt]
    nlp.minimize(
        "finger dissipation", fingers.felt, theta.pick(felt), x[:, step.pose[s]],
        x[:, step.before[s]], lam[:, felt], f.p_wf, f.p_wf_1, f.radius, f.tangent,
        step.dt[s], w[felt], kappa, v_eps, cone_rounding_of(nlp, mu), mu,
        role="physics",
    )  # fmt: skip
    f, s = push.pick(unfelt), push.step[unfelt]
    nlp.minimize(
        "finger complementarity", fingers.unfelt, theta.pick(unfelt),
        x[:, step.pose[s]], lam[:, unfelt], f.p_wf, f.radius, w[unfelt], kappa,
        role="physics",
    )  # fmt: skip
    nlp.report(
        FINGER_IMPULSE, fingers.impulse, theta, x[:, step.pose[push.step]], lam,
        push.p_wf, push.radius, push.tangent,
    )  # fmt: skip


def unseen(nlp, window, fingers, theta, x, pushes):
    """Add the costs of fingers whose samples are missing: they may push or not."""
    rows = window.unseen
    push, s = window.push.pick(rows), window.push.step[rows]
    theta = theta if pushes.theta is None else pushes.theta
    inside = indentation.of_pushes(nlp, pushes, rows)
    nlp.minimize(
        "unseen finger", fingers.unseen, theta.pick(rows), x[:, window.step.pose[s]],
        pushes.lam[:, rows], push.p_wf, push.radius, inside, pushes.w[rows],
        nlp.parameters["kappa"], nlp.parameters["touch scale"], role="likelihood",
    )  # fmt: skip
    now, before = window.lasting
    nlp.minimize(
        "lasting push", fingers.lasting, pushes.lam[:, now], pushes.lam[:, before],
        pushes.w[now], pushes.w[before], role="prior",
    )  # fmt: skip
