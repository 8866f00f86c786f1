"""Steps of the filter of one track, as functions that are compiled for many.

A track's state z (n + 3,) has a covariance P, given as its upper triangle by rows.
Prediction is quasi-static pushing (pushing.py) with its exact slopes; a correction
takes scalar measurements one after the other, all linearised at z, and adds what they
cost to the log evidence (extended Kalman filter).
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from ..nlp.term_functions import MappedFunction
from .geometry import upright_surface
from .mapped import map_columns, of_columns
from .process_noise import (
    ADDED_VARIANCE,
    LAST_SHARE,
    PUSH_ERROR,
    TOUCHED,
    deviation,
    way_of,
)
from .pushing import Move, push_motion

OUTLIER = 8.0  # [nats] most that one finger costs in one sample
USUAL_FINGERS = 2  # that touch at once


def begin_compilation(shape, fingers: int) -> None:
    """Begin to compile what so many fingers need, all steps beside each other."""
    corrections(shape)
    for count in range(1, min(fingers, USUAL_FINGERS) + 1):
        prediction(shape, count)


@cache
def prediction(shape, fingers: int) -> MappedFunction:
    """Return the prediction by so many fingers that touch.

    z, P, motion before (3,), press (fingers,), of each finger in turn p_0, p_1 (3,) and
    radius, friction of ground and fingers with the factor of the process noise -> z, P,
    motion (3,), its slopes (3, n + 3) by columns.
    """
    z, P = ca.SX.sym("z", shape.theta + 3), _covariance(shape)
    before, press = ca.SX.sym("before", 3), ca.SX.sym("press", fingers)
    ways, factors = ca.SX.sym("ways", 7, fingers), ca.SX.sym("given", 3)
    moves = [
        Move(way[:3], way[3:6], way[6], press[f])
        for f, way in enumerate(ca.horzsplit(ways))
    ]
    motion = push_motion(shape, z, moves, before, (factors[0], factors[1]))
    way, last = (way_of(ca.norm_2(d[:2]), d[2]) for d in (motion, before))
    noise = factors[2] * deviation(TOUCHED, PUSH_ERROR, ca.fmax(way, LAST_SHARE * last))
    added = ca.vertcat(ca.SX(shape.theta, 1), noise**2 + ADDED_VARIANCE)
    arguments = z, before, press, ca.vec(ways), factors

    def derive():
        slopes = ca.densify(ca.jacobian(motion, z))
        F = ca.SX.eye(z.numel())
        F[-3:, :] += slopes
        after = ca.vertcat(z[:-3], z[-3:] + motion)
        results = after, _triangle(F @ ca.triu2symm(P) @ F.T + ca.diag(added)), motion
        inputs = z, _triangle(P), *arguments[1:]
        return [of_columns("prediction", inputs, (*results, ca.vec(slopes)))]

    whole = ca.Function("pushed", arguments, [motion, added])
    return map_columns(("prediction",), whole, derive)[0]


@cache
def corrections(shape) -> tuple[MappedFunction, MappedFunction]:
    """Return the corrections by a finger that touches, and by one that does not.

    z, mean - z, P, p_w (3,), radius, of a touch the normal felt (3,) and two directions
    across it (3, 2) by columns, sigma of gap and normal -> mean - z, P, what it adds to
    the log evidence, gap [m].  What does not touch corrects where it would overlap.
    """
    (z, p_w, radius), (gap, _, level) = upright_surface(shape)
    x, P, sigma = ca.SX.sym("x", z.numel()), _covariance(shape), ca.SX.sym("sigma", 2)
    felt, across = ca.SX.sym("felt", 3), ca.SX.sym("across", 3, 2)
    state, finger = (z, x, _triangle(P)), (p_w, radius)

    def derive():
        rows = ca.vertcat(gap / sigma[0], across.T @ level / sigma[1])
        cost = ((1 - ca.dot(felt, level)) / sigma[1]) ** 2 / 2
        results = _corrected(x, P, rows, ca.jacobian(rows, z), cost)
        inputs = *state, *finger, felt, ca.vec(across), sigma
        touch = of_columns("touch", inputs, (*results, gap))
        slopes = ca.if_else(gap < 0, ca.gradient(gap, z).T / sigma[0], 0)
        results = _corrected(x, P, ca.if_else(gap < 0, gap / sigma[0], 0), slopes, 0)
        overlap = of_columns("overlap", (*state, *finger, sigma), (*results, gap))
        return [touch, overlap]

    surface = ca.Function("surface", [z, *finger], [gap, level, OUTLIER])
    return tuple(map_columns(("touch", "overlap"), surface, derive))


def _corrected(x, P, residuals, slopes, cost):
    """Return mean - z, covariance and log evidence after scalar measurements.

    residuals (k,), slopes (k, n + 3): in deviations; cost: of the finger besides.
    """
    spread = 0
    for k in range(residuals.numel()):
        h = slopes[k, :].T
        PH = ca.triu2symm(P) @ h
        S = 1 + ca.fmax(ca.dot(h, PH), 0)  # rounding
        error = residuals[k] + ca.dot(h, x)
        x -= PH * (error / S)
        P = ca.triu(P - PH @ PH.T / S)
        cost += error**2 / S / 2
        spread += ca.log(S) / 2
    return x, _triangle(P), -ca.fmin(cost, OUTLIER) - spread


def _covariance(shape):
    """Return the upper triangle of a covariance."""
    return ca.SX.sym("P", ca.Sparsity.upper(shape.theta + 3))


def _triangle(P):
    """Return the upper triangle by rows of a covariance of symbols."""
    return ca.vertcat(*(P[i, j] for i in range(P.size1()) for j in range(i, P.size1())))
