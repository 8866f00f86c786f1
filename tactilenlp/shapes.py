"""The classes of shapes to estimate, and what one's own is made of."""

from collections.abc import Callable

from formulations import polytope as hull
from formulations import shape as parts
from formulations import size_prior, upright
from formulations.ellipsoid import ELLIPSOID
from formulations.shape import CUBOID, Shape
from formulations.shape_report import ShapeReport
from formulations.upright import CYLINDER

from .common.validation import check_types, check_whole, checked_array
from .errors import OptionError

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
MOST_CORNERS = 1000  # sides, vertices


def prism(sides: int) -> Shape:
    """Return the class of upright regular prisms with so many sides, at least three.

    theta = (across, height) [m]; across: twice the distance of a side from the axis,
    which for an even number is the distance of opposite sides.  The prior of both is
    Student's t about 45 mm.  Raises OptionError.
    """
    return upright.prism(_count("sides", sides, 3))


def polytope(vertices: int | None = None) -> Shape:
    """Return the class of hulls of so many vertices, at least four.

    None: 4 to 20, as many as the evidence asks for.  theta: x, y, z [m] of one vertex
    after the other.  Raises OptionError.
    """
    if vertices is None:
        return hull.polytope()
    return hull.polytope(_count("vertices", vertices, 4))


def gradient_normal(distance: Callable) -> Callable:
    """Return normal(theta, q_of, small) -> (3,), the slope of a signed distance.

    distance(theta, q_of, small) -> [m], as of a Shape.  Raises OptionError.
    """
    if not callable(distance):
        raise OptionError(
            "no function", where="distance", got=type(distance).__name__,
            expected="distance(theta, q_of, small)",
        )  # fmt: skip
    return parts.gradient_normal(distance)


def log_size_prior(shape: Shape, theta) -> float:
    """Return log p(theta) of a shape's sizes, normalised [log of 1 / their units].

    theta (n,): within the bounds of the shape, else the density is that of its tails.
    Raises OptionError.
    """
    check_types(shape=(shape, Shape))
    sizes = checked_array("theta", theta, shape.theta, unit="of the sizes")
    return size_prior.log_size_prior(shape, sizes)


def _count(name: str, value, least: int) -> int:
    """Return a whole number of at least `least`; OptionError for anything else."""
    check_whole(name, value, least, MOST_CORNERS, what="no such class of shapes")
    return int(value)
