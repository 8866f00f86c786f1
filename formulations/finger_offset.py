r"""Fingers with an unknown position error: each is displaced by a constant e_f.

    p_wf + e_f                            in place of p_wf, everywhere (`with_offset`)
    sum_f |e_f|^2 / (2 sigma^2)           e_f ~ N(0, sigma^2), world frame  (`prior`)

A zero offset of a degree in the joints puts a tip 3 to 5 mm off, by nearly the same
vector all over a workspace of some centimetres: it varies by 0.1 to 0.3 mm.

The mean of all e_f moves the world: only the prior determines it.  Along a line on
which two fingers face each other, their difference acts like a wider body: only the
prior separates the two, until the body has turned or the fingers have changed sides.

Where the joints are known (an object of fields `place`, `slope`, `turn`, `covariance`,
a finger each), the same zero offsets displace and turn a finger, with p its place:

    p_wf + e_f + ((p_wf - p) . slope) e_f             n - (turn e_f) x n
    sum_f  e_f' covariance^-1 e_f / 2                               (`prior_within`)

n is the modelled normal, and the result what the turned finger would report: on an
upright side it tilts as the finger does.  That determines the mean of all e_f, which no
distance does (`with_joint_zeros`).
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from .names import FINGER_OFFSET

PLACE, SLOPE, TURN = 3, 27, 9  # numbers of a finger whose joints are known


def displaced(nlp, window, scene):
    """Return the window with every finger displaced by e_f, if offsets are unknown.

    The first call for a programme declares them.
    """
    if scene.sigma_offset is None:
        return window
    joints = scene.joints
    known = nlp.variables.get(FINGER_OFFSET)
    e = declare(nlp, window, scene) if known is None else known

    def above_offset(rows, p_wf):
        data = p_wf if joints is None else joints.with_numbers(p_wf, rows.finger)
        return e[:, rows.finger].below(data)

    finger = (with_offset if joints is None else with_joint_zeros)(window.finger)
    return replace(window.with_fingers(above_offset), finger=finger)


def declare(nlp, window, scene):
    """Declare the offsets e (3, fingers) [m] with their prior."""
    scale, name = scene.typical_offset, f"{FINGER_OFFSET} prior"
    count = window.fingers
    e = nlp.variable(FINGER_OFFSET, 3, count, guess=0.0, unit="m", scale=scale)
    if scene.joints is None:
        nlp.minimize(name, prior, e, scene.sigma_offset, role="prior")
    else:
        information = scene.joints.information
        nlp.minimize(name, prior_within, e, information, role="prior")
    return e


def prior(e, sigma):
    """Return the cost of an offset (3,) [m]."""
    return ca.sumsqr(e) / (2 * sigma**2)


def prior_within(e, information):
    """Return the cost of an offset (3,) [m]; information: (9,) of it, [1 / m^2]."""
    return ca.bilin(ca.reshape(information, 3, 3), e, e) / 2


def with_offset(finger):
    """Return the finger whose p_wf has below it the offset (3,) [m]."""
    n = finger.numbers

    def place(p_wf):
        return ca.vertcat(p_wf[:3] + p_wf[n:], p_wf[3:n])

    return with_place(finger, n + 3, place)


def with_joint_zeros(finger):
    """Return the finger whose p_wf has below it place, slope and turn, then e_f."""
    n = finger.numbers
    ends = n + PLACE, n + PLACE + SLOPE, n + PLACE + SLOPE + TURN

    def place(p_wf):
        way, e = p_wf[:3] - p_wf[n : ends[0]], p_wf[ends[2] :]
        slope = ca.reshape(p_wf[ends[0] : ends[1]], 9, 3)
        off = e + ca.reshape(slope @ way, 3, 3) @ e
        return ca.vertcat(p_wf[:3] + off, p_wf[3:n])

    def felt(normal, p_wf):
        turn = ca.reshape(p_wf[ends[1] : ends[2]], 3, 3)
        return normal - ca.cross(turn @ p_wf[ends[2] :], normal)

    return replace(with_place(finger, ends[2] + 3, place), felt=felt)


def with_place(finger, numbers, place):
    """Return the finger that is at place(p_wf), where p_wf has `numbers` entries."""

    def core(shape, theta, pose, p_wf, rho):
        return finger.core(shape, theta, pose, place(p_wf), rho)

    def before(p_w, p_wf, p_wf_1):
        return finger.before(p_w, place(p_wf), place(p_wf_1))

    return replace(finger, numbers=numbers, core=core, before=before)
