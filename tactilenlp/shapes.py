"""The classes of shapes to estimate, and what one's own is made of."""

from formulations.ellipsoid import ELLIPSOID
from formulations.polytope import polytope
from formulations.shape import CUBOID, Shape, gradient_normal
from formulations.shape_check import ShapeReport
from formulations.size_prior import log_size_prior
from formulations.upright import CYLINDER, prism

__all__ = [
    "CUBOID",
    "CYLINDER",
    "ELLIPSOID",
    "Shape",
    "ShapeReport",
    "gradient_normal",
    "log_size_prior",
    "polytope",
    "prism",
]
