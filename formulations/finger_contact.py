r"""What the fingers do to the body: the finger part of g(x_t, lam, r_t) of eq:vimp.

An impulse lam = (lam_n, lam_t1, lam_t2) acts along (-n, t1, t2) at the point where
finger and body touch, during the step that ends at its sample.  With D of contact.py,
the energy that friction fails to dissipate there, in nats,

    felt      kappa D dt / (w mm)
    unfelt    kappa lam_n max(phi, 0) / (w mm) + UNFELT lam_n / w

with w = m g dt.

A finger whose sample is missing has the first cost, and with its indentation
delta (indentation.py)

    unseen    kappa lam_n max(phi + delta, 0) / (w mm) + touch(min(phi + delta, 0))
    lasting   |lam_n' / w' - lam_n / w| / CHANGE        from one sample ' to the next

The rounding of the friction cone of a finger that feels nothing neither costs nor earns
anything, since all its impulses cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from . import contact, indentation, sensing
from .contact import MM
from .friction import friction_law_of
from .names import FINGER_IMPULSE, TOUCH_SCALE
from .rigid_body import steps_of

UNFELT = 2000.0  # [nats] for an impulse of one weight not felt: 20 for one of 0.01

ROUNDINGS = 50  # [1 / finger radius] length that rounds max(phi, 0) of an unfelt finger
GAP_ROUNDING = 0.02e-3  # [m] rounds max(phi, 0) of a finger whose sample is missing
# Four to seven times the mean change between two samples in contact (0.16 in 1660 of
# the simulator of the shared boxes, 0.09 in their estimates): decides where nothing
# else does.  Paths are pulled with 0.15 (168 recordings, results/EXPERIMENTS.md).
CHANGE = 0.6  # [weights]
CHANGE_ROUNDING = 0.02  # [weights] rounds |lam_n' / w' - lam_n / w|


class Push(NamedTuple):
    """What a term reads of a finger that pushes, p_wf and rho [m] where it is.

    theta: the part of the body that it sees, None: all of it; t: where t1 points;
    p_wf_1: where it was a sample ago, of terms that read its velocity.
    """

    theta: object
    lam: object
    p_wf: object
    rho: object
    t: object
    p_wf_1: object = None


@dataclass(frozen=True, eq=False)
class FingerContact(contact.Sliding):
    """The pure functions of a body (shape, motion of its pose x) and a finger."""

    shape: object
    motion: object
    finger: object

    def gap(self, theta, x, push):
        """Return the gap phi [m]."""
        pose = self.motion.pose(self.shape, theta, x)
        return self.finger.gap(self.shape, theta, pose, push.p_wf, push.rho)

    def gap_and_normal(self, theta, x, push):
        """Return the gap phi [m] and the body's normal towards the finger, world."""
        pose = self.motion.pose(self.shape, theta, x)
        at = self.shape, theta, pose, push.p_wf, push.rho
        return self.finger.gap(*at), self.finger.normal(*at)

    def contact(self, theta, x, push):
        """Return the Contact of a Push."""
        theta = theta if push.theta is None else push.theta
        pose = self.motion.pose(self.shape, theta, x)
        p_w, n = self.finger.touch(self.shape, theta, pose, push.p_wf, push.rho)
        return contact.Contact(push.lam, p_w, -n, contact.tangents(n, push.t))

    def impulse(self, theta, x, push):
        """Return the impulse of a finger on the body, world frame [N s]."""
        return self.contact(theta, x, push).impulse

    def velocity(self, step, push):
        """Return v_n, v_s (2,) [m/s] of finger and body; v_n > 0 parts them."""
        at = self.contact(step.theta, step.x, push)
        p_w, n, (t1, t2) = at.point, -at.normal, at.tangents
        p, R = self.motion.pose(self.shape, step.theta, step.x)
        p_1, R_1 = self.motion.pose(self.shape, step.theta, step.x_1)
        body_before = p_1 + R_1 @ (R.T @ (p_w - p))
        v = (self.finger.before(p_w, push.p_wf, push.p_wf_1) - body_before) / step.dt
        return -ca.dot(v, n), ca.vertcat(ca.dot(v, t1), ca.dot(v, t2))

    def unfelt_impulse(self, theta, x, push, w, kappa):
        """Return the cost of the impulse of a finger that feels nothing."""
        phi = self.gap(theta, x, push)
        energy = contact.complementarity(push.lam, phi, push.rho / ROUNDINGS)
        return kappa * energy / (w * MM) + UNFELT * push.lam[0] / w

    def unseen_impulse(self, theta, x, push, inside, w, kappa, sigma):
        """Return the cost of an impulse across a gap, and of penetration."""
        phi = self.gap(theta, x, push) + inside.delta()
        energy = contact.complementarity(push.lam, phi, GAP_ROUNDING)
        return kappa * energy / (w * MM) + sensing.touch(ca.fmin(phi, 0), sigma)

    def impulse_change(self, lam, lam_1, w, w_1):
        """Return the cost of how a normal impulse changed since the sample before."""
        change = lam[0] / w - lam_1[0] / w_1
        return (ca.sqrt(change**2 + CHANGE_ROUNDING**2) - CHANGE_ROUNDING) / CHANGE


def pushes_of(push, pushes, j):
    """Return the Push that each instance of a term reads; j: its row in `push`."""
    f = push.pick(j)
    return Push(pushes.part(None, j), pushes.lam[:, j], f.p_wf, f.radius, f.tangent)


def pushing(f, lam):
    """Return the Push of fingers (window.Pushes) by lam, of terms that know theta."""
    return Push(None, lam, f.p_wf, f.radius, f.tangent, f.p_wf_1)


def sensed(f, lam=None):
    """Return the Push of fingers (window.Samples or Pushes) of which gaps are read."""
    return Push(None, lam, f.p_wf, f.radius, None)


def add(nlp, window, fingers, theta, x, pushes):
    """Add the costs of fingers that feel their contact, and of those that do not.

    pushes: friction.Impulses of every push.
    """
    step, push, silent = window.step, window.push, window.unfelt
    lam, w = pushes.lam, pushes.w
    felt = sorted({*range(len(push))} - {*silent.tolist()})
    now = steps_of(step, pushes.part(theta, felt), x, w[felt], push.step[felt])
    nlp.minimize(
        "finger dissipation", fingers.dissipation, now,
        pushing(push.pick(felt), lam[:, felt]), friction_law_of(nlp, pushes.mu),
        role="physics",
    )  # fmt: skip
    f, kappa = push.pick(silent), nlp.parameters["kappa"]
    nlp.minimize(
        "finger complementarity", fingers.unfelt_impulse, pushes.part(theta, silent),
        x[:, step.pose[f.step]], sensed(f, lam[:, silent]), w[silent], kappa,
        role="physics",
    )  # fmt: skip
    report_impulses(nlp, window, fingers, theta, x, pushes)


def report_impulses(nlp, window, fingers, theta, x, pushes):
    """Report the impulse of every push on the body."""
    f, theta = window.push, pushes.part(theta, slice(None))
    at = Push(None, pushes.lam, f.p_wf, f.radius, f.tangent)
    now = x[:, window.step.pose[f.step]]
    nlp.report(FINGER_IMPULSE, fingers.impulse, theta, now, at)


def add_unseen(nlp, window, fingers, theta, x, pushes):
    """Add the costs of fingers whose samples are missing: they may push or not."""
    rows, (now, before), p = window.unseen, window.lasting, nlp.parameters
    lam, w, f = pushes.lam, pushes.w, window.push.pick(rows)
    inside = indentation.of_pushes(nlp, pushes, rows)
    nlp.minimize(
        "unseen finger", fingers.unseen_impulse, pushes.part(theta, rows),
        x[:, window.step.pose[f.step]], sensed(f, lam[:, rows]), inside, w[rows],
        p["kappa"], p[TOUCH_SCALE], role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "lasting push", fingers.impulse_change, lam[:, now], lam[:, before], w[now],
        w[before], role="prior",
    )  # fmt: skip
