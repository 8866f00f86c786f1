r"""Fingers with an unknown position error: each is displaced by a constant e_f.

    p_wf + e_f                            in place of p_wf, everywhere    (`elsewhere`)
    sum_f |e_f|^2 / (2 sigma^2)           e_f ~ N(0, sigma^2), world frame  (`prior`)

A zero offset of a degree in the joints puts a tip 3 to 5 mm off, by nearly the same
vector all over a workspace of some centimetres: it varies by 0.1 to 0.3 mm.

The mean of all e_f moves the world: only the prior determines it.  Along a line on
which two fingers face each other, their difference acts like a wider body: only the
prior separates the two, until the body has turned or the fingers have changed sides.

Where the joints are known (an object of fields `place`, `slope`, `turn`, `covariance`,
a finger each), the same zero offsets displace and turn a finger, with p its place:

    p_wf + e_f + ((p_wf - p) . slope) e_f             n - (turn e_f) x n    (`turned`)
    sum_f  e_f' covariance^-1 e_f / 2                               (`prior_within`)

n is the measured normal: on an upright side it tilts as the finger does.  That
determines the mean of all e_f, which no distance does.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

NAME = "finger offset"  # of the unknown, in a page that has it
PLACE, SLOPE, TURN = 3, 27, 9  # numbers of a finger whose joints are known


def displaced(nlp, window, scene):
    """Return the window with every finger displaced by e_f, if offsets are unknown.

    The first call for a programme declares them.
    """
    if scene.sigma_offset is None:
        return window
    joints = scene.joints
    e = nlp.variables[NAME] if NAME in nlp.variables else declare(nlp, window, scene)

    def off(rows, *places):
        there = {name: e[:, rows.finger].below(known(rows, name)) for name in places}
        return replace(rows, **there)

    def known(rows, name):
        said = getattr(rows, name)
        return said if joints is None else joints.with_numbers(said, rows.finger)

    finger = elsewhere if joints is None else turned
    return replace(
        window, finger=finger(window.finger), touch=off(window.touch, "p_wf"),
        free=off(window.free, "p_wf"), push=off(window.push, "p_wf", "p_wf_1"),
    )  # fmt: skip


def declare(nlp, window, scene):
    """Declare the offsets e (3, fingers) [m] with their prior."""
    e = nlp.variable(
        NAME, 3, window.fingers, guess=0.0, unit="m", scale=scene.typical_offset
    )
    if scene.joints is None:
        nlp.minimize(f"{NAME} prior", prior, e, scene.sigma_offset, role="prior")
    else:
        told = scene.joints.information
        nlp.minimize(f"{NAME} prior", prior_within, e, told, role="prior")
    return e


def prior(e, sigma):
    """Return the cost of an offset (3,) [m]."""
    return ca.sumsqr(e) / (2 * sigma**2)


def prior_within(e, information):
    """Return the cost of an offset (3,) [m]; information: (9,) of it, [1 / m^2]."""
    return ca.bilin(ca.reshape(information, 3, 3), e, e) / 2


def elsewhere(finger):
    """Return the finger whose p_wf has below it the offset (3,) [m]."""
    n = finger.numbers

    def at(p_wf):
        return ca.vertcat(p_wf[:3] + p_wf[n:], p_wf[3:n])

    return moved(finger, n + 3, at)


def turned(finger):
    """Return the finger whose p_wf has below it place, slope and turn, then e_f."""
    n = finger.numbers
    ends = n + PLACE, n + PLACE + SLOPE, n + PLACE + SLOPE + TURN

    def at(p_wf):
        way, e = p_wf[:3] - p_wf[n : ends[0]], p_wf[ends[2] :]
        slope = ca.reshape(p_wf[ends[0] : ends[1]], 9, 3)
        off = e + ca.reshape(slope @ way, 3, 3) @ e
        return ca.vertcat(p_wf[:3] + off, p_wf[3:n])

    def felt(normal, p_wf):
        turn = ca.reshape(p_wf[ends[1] : ends[2]], 3, 3)
        return normal - ca.cross(turn @ p_wf[ends[2] :], normal)

    return replace(moved(finger, ends[2] + 3, at), felt=felt)


def moved(finger, numbers, at):
    """Return the finger at at(p_wf), where p_wf has `numbers` entries."""

    def core(shape, theta, pose, p_wf, rho):
        return finger.core(shape, theta, pose, at(p_wf), rho)

    def before(p_w, p_wf, p_wf_1):
        return finger.before(p_w, at(p_wf), at(p_wf_1))

    return replace(finger, numbers=numbers, core=core, before=before)
