"""Geometry of upright bodies of a class of shapes: contact and support.

A state z (n + 3,) holds the sizes theta (n,) of a body that lies on the ground, and its
planar pose x, y [m], yaw [rad].  Distance and normal are those of the pages, with edges
rounded as there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from formulations.shape import Shape

from ..nlp.term_functions import MappedFunction
from .mapped import map_columns, of_columns

EDGE_SHARE = 0.1  # [radius] rounding of edges, as in pages
LEAST_FOOT = 2e-3  # [m] half width of the support
UNIT_DEVIATION = 20e-3  # [m] of a size's prior: its steps are those of a cuboid


def rotated(vector, yaw):
    """Return a vector (2,) or (3,), its first two entries turned by a yaw [rad]."""
    c, s, x, y = ca.cos(yaw), ca.sin(yaw), vector[0], vector[1]
    return ca.vertcat(c * x - s * y, s * x + c * y, vector[2:])


def in_body(z, p_w):
    """Return the horizontal coordinates (2,) of a world point in the body frame."""
    return rotated(p_w[:2] - z[-3:-1], -z[-1])


def upright_contact(shape, z, p_w, radius):
    """Return what a finger at p_w (3,) [m] meets of a body, in the body frame.

    Its centre (3,) and gap [m], and the outward normal (3,) there.
    """
    theta, small = z[:-3], EDGE_SHARE * radius
    q = ca.vertcat(in_body(z, p_w), p_w[2] - shape.rest_height(theta))
    return q, shape.distance(theta, q, small) - radius, shape.normal(theta, q, small)


def upright_surface(shape):
    """Return what a finger meets of an upright body, as expressions of given symbols.

    given: the state z (n + 3,), the finger's centre p_w (3,) and its radius [m].  The
    expressions: gap [m], outward normal (3,) in the body frame, in the world frame.
    """
    z, p_w, radius = ca.SX.sym("z", shape.theta + 3), ca.SX.sym("p", 3), ca.SX.sym("r")
    _, gap, n = upright_contact(shape, z, p_w, radius)
    return [z, p_w, radius], (gap, n, rotated(n, z[-1]))


def feet_of(shape, z):
    """Return half the widths x, y [m] of the rectangle on which a body rests."""
    corners = ca.horzcat(*(shape.corner(z[:-3], ca.DM(s)) for s in shape.corners))
    squares = ca.sum2(corners[:2, :] ** 2) / len(shape.corners)
    return ca.vertsplit(ca.fmax(ca.sqrt(squares), LEAST_FOOT))


@dataclass(frozen=True, eq=False)
class Geometry:
    """What a search needs to know of a class of shapes, for many bodies at once.

    unit (n,): typical size of a change of each size, in that of a cuboid's side.
    """

    shape: Shape
    unit: np.ndarray
    _contact: MappedFunction
    _height: MappedFunction

    def each(self, size, place: float, turn: float) -> np.ndarray:
        """Return one number for each entry of z (n + 3,): of sizes, x, y [m], yaw."""
        return np.r_[size * self.unit, place, place, turn]

    def contact(self, z, p_w, radius):
        """Return gap (S,) [m] and outward normal (3, S), body frame, of bodies z."""
        gap, normal = self._contact(z, p_w, np.array([radius]))
        return gap[0], normal

    def height(self, z) -> np.ndarray:
        """Return the heights (S,) [m] of bodies z (n + 3, S)."""
        return self._height(z)[0][0]

    def reach(self, z) -> float:
        """Return the distance [m] from their origins that no body exceeds."""
        theta = z[:-3]
        bounds = theta.min(axis=1), theta.max(axis=1)
        return max(float(self.shape.reach(theta)) for theta in bounds)


@cache
def geometry_of(shape) -> Geometry:
    """Return the geometry of a shape with sizes."""
    arguments, (gap, normal, _) = upright_surface(shape)
    height = ca.SX(2 * shape.rest_height(arguments[0][:-3]))
    surface = ca.Function("surface", arguments, [gap, normal, height])

    def derive():
        contact = of_columns("contact", arguments, [gap, normal])
        return [contact, of_columns("height", arguments[:1], [height])]

    functions = map_columns(("contact", "height"), surface, derive)
    unit = np.broadcast_to(np.divide(shape.size_prior[1], UNIT_DEVIATION), shape.theta)
    return Geometry(shape, unit, *functions)
