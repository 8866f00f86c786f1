r"""Fingers that are not where their kinematics say: each is off by an unknown e_f.

    p_wf + e_f                            in place of p_wf, in every term
    sum_f |e_f|^2 / (2 sigma^2)           e_f ~ N(0, sigma^2), constant, world frame

Encoders that count from angles a degree wrong put a tip 3 to 5 mm off, by nearly the
same way all over a workspace of some centimetres: it varies by 0.1 to 0.3 mm.

What all e_f have in common moves the world: only the prior holds it.  Along a line on
which two fingers face each other, their difference is a wider body: only the prior
tells these two apart, until the body has turned or the fingers have changed sides.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

NAME = "finger offset"


def displaced(nlp, window, scene):
    """Return the window with every finger off by its e_f; as it is, where none is."""
    sigma = scene.sigma_offset
    if sigma is None:
        return window
    e = nlp.variable(NAME, 3, window.fingers, guess=0.0, unit="m", scale=sigma)
    nlp.minimize("finger offset prior", prior, e, sigma, role="prior")

    def off(rows, *places):
        there = {name: e[:, rows.finger].below(getattr(rows, name)) for name in places}
        return replace(rows, **there)

    return replace(
        window, finger=elsewhere(window.finger), touch=off(window.touch, "p_wf"),
        free=off(window.free, "p_wf"), push=off(window.push, "p_wf", "p_wf_1"),
    )  # fmt: skip


def prior(e, sigma):
    """Return the cost of an offset (3,) [m]."""
    return ca.sumsqr(e) / (2 * sigma**2)


def elsewhere(finger):
    """Return the finger whose p_wf has below it the offset (3,) [m]."""
    n = finger.numbers

    def at(p_wf):
        return ca.vertcat(p_wf[:3] + p_wf[n:], p_wf[3:n])

    def core(shape, theta, pose, p_wf, rho):
        return finger.core(shape, theta, pose, at(p_wf), rho)

    def before(p_w, p_wf, p_wf_1):
        return finger.before(p_w, at(p_wf), at(p_wf_1))

    return replace(finger, numbers=n + 3, core=core, before=before)
