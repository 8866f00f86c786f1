"""Geometry of a class of shapes, for many upright bodies at once: contact and support.

A state z (n + 3, ...) holds the sizes theta (n,) of a body that lies on the ground, and
its planar pose x, y [m], yaw [rad].  A cuboid has the closed form of box_contact.py;
any other shape its page's own distance and normal, and their slopes by CasADi.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from .box_contact import box_contact, box_contact_slopes

EDGE_SHARE = 0.1  # [radius] rounding of edges, as in pages
LEAST_FOOT = 2e-3  # [m] half width of the support
UNIT_DEVIATION = 20e-3  # [m] of a size's prior: its steps are those of a cuboid


@dataclass(frozen=True, eq=False)
class Geometry:
    """What tracks need to know of a class of shapes.

    sizes: n; unit (n,): typical size of a change of each, in that of a cuboid's side.
    contact(z, p_w, radius) -> gap (...) [m], outward normal (3, ...), body frame;
    slopes(z, p_w, radius) -> gap (S,), normal (3, S), world frame, and their slopes
    (n + 3, S), (3, n + 3, S); feet(z) -> half widths x, y of the support [m]; top(z),
    reach(z) [m]: height, and horizontal distance from the origin, at least.
    """

    sizes: int
    unit: np.ndarray
    contact: Callable
    slopes: Callable
    feet: Callable
    top: Callable
    reach: Callable

    def each(self, size, place: float, turn: float) -> np.ndarray:
        """Return one number for each entry of z (n + 3,): of sizes, x, y [m], yaw."""
        return np.r_[size * self.unit, place, place, turn]


BOX = Geometry(
    3, np.ones(3), box_contact, box_contact_slopes,
    feet=lambda z: (z[0] / 2, z[1] / 2), top=lambda z: z[2],
    reach=lambda z: 0.5 * (z[0] + z[1]),
)  # fmt: skip


@cache
def geometry_of(shape) -> Geometry:
    """Return the geometry of a shape with sizes."""
    if shape.is_box:
        return BOX
    given, (gap, normal, level) = upright_surface(shape)
    z, whole = given[0], {"cse": True}
    theta = z[: shape.theta]
    contact = ca.Function("contact", given, [gap, normal], whole)
    slopes = ca.Function(
        "slopes", given,
        [gap, level, ca.gradient(gap, z), ca.vec(ca.densify(ca.jacobian(level, z)))],
        whole,
    )  # fmt: skip
    corners = ca.horzcat(*(shape.corner(theta, ca.DM(s)) for s in shape.corners))
    squares = ca.sum2(corners[:2, :] ** 2) / len(shape.corners)
    support = ca.Function(
        "support", [z], [ca.sqrt(squares), 2 * shape.rest_height(theta)]
    )

    def reach(z):
        sizes = z[: shape.theta]
        bounds = sizes.min(axis=1), sizes.max(axis=1)
        return max(float(shape.reach(theta)) for theta in bounds)

    unit = np.broadcast_to(np.divide(shape.size_prior[1], UNIT_DEVIATION), shape.theta)
    return Geometry(
        shape.theta, unit,
        lambda *given: _evaluated(contact, *given),
        lambda *given: _sloped(slopes, *given),
        feet=lambda z: np.maximum(_mapped(support, z)[0], LEAST_FOOT),
        top=lambda z: _mapped(support, z)[1][0],
        reach=reach,
    )  # fmt: skip


def upright_surface(shape):
    """Return what a finger meets of an upright body, as expressions of given symbols.

    given: the state z (n + 3,), the finger's centre p_w (3,) and its radius [m].  The
    expressions: gap [m], outward normal (3,) in the body frame, in the world frame.
    """
    z, p_w, radius = ca.SX.sym("z", shape.theta + 3), ca.SX.sym("p", 3), ca.SX.sym("r")
    theta, c, s = z[: shape.theta], ca.cos(z[-1]), ca.sin(z[-1])
    d = p_w - ca.vertcat(z[-3], z[-2], shape.rest_height(theta))
    q = ca.vertcat(c * d[0] + s * d[1], c * d[1] - s * d[0], d[2])
    gap = shape.distance(theta, q, EDGE_SHARE * radius) - radius
    n = shape.normal(theta, q, EDGE_SHARE * radius)
    level = ca.vertcat(c * n[0] - s * n[1], s * n[0] + c * n[1], n[2])
    return [z, p_w, radius], (gap, n, level)


def _mapped(function, z, *shared):
    """Return the outputs of a function at states z (k, ...), each (rows, ...)."""
    flat = np.reshape(z, (len(z), -1))
    N = flat.shape[1]
    more = (np.repeat(np.reshape(v, (-1, 1)), N, axis=1) for v in shared)
    out = function.map(N)(flat, *more)
    out = out if isinstance(out, tuple) else (out,)
    return [np.asarray(o).reshape(-1, *z.shape[1:]) for o in out]


def _evaluated(contact, z, p_w, radius):
    gap, n = _mapped(contact, z, p_w, radius)
    return gap[0], n


def _sloped(slopes, z, p_w, radius):
    gap, normal, along, turning = _mapped(slopes, z, p_w, radius)
    turning = turning.reshape(len(z), 3, -1).swapaxes(0, 1)
    return gap[0], normal, along, turning
