"""problem.pages."""

from __future__ import annotations

import importlib

from formulations.polytope import polytope
from formulations.shape import CUBOID, Shape

from ..errors import OptionError

SHAPES = {"cuboid": CUBOID, "polytope": polytope()}
POLYTOPES = ("polytope_quasi_static", "polytope_violation_implicit")
FORMULATIONS = (
    *("quasi_static", "violation_implicit", "paper"),
    *("shooting", "multiple_shooting", "complementarity"),
)


def shape_of(shape) -> Shape:
    if isinstance(shape, Shape):
        return shape
    if not isinstance(shape, str) or shape not in SHAPES:
        raise OptionError(
            "unknown shape", where="shape", got=shape, expected=f"one of {[*SHAPES]}"
        )
    return SHAPES[shape]


def page_of(formulation, shape):
    """Return the page of a name, a polytope's own if there is one, or a user's."""
    if isinstance(formulation, str):
        if formulation not in FORMULATIONS:
            raise OptionError(
                "unknown formulation",
                where="formulation",
                got=formulation,
                expected=f"one of {FORMULATIONS}, or a page",
            )
        own = f"{shape.name}_{formulation}"
        if is_polytope(shape) and own not in POLYTOPES:
            raise OptionError(
                "no page of this name for a polytope",
                where="formulation",
                got=formulation,
                expected='"quasi_static" or "violation_implicit"',
                next='use shape="cuboid", or give a page of your own',
            )
        return importlib.import_module(
            f"formulations.{own if own in POLYTOPES else formulation}"
        )
    for name in ("build", "LEVELS"):
        if not hasattr(formulation, name):
            raise OptionError(
                f"a page needs {name}", where="formulation", got=repr(formulation)
            )
    return formulation


def page_named(page):
    """Return a page: a module travels between processes by its name."""
    return importlib.import_module(page) if isinstance(page, str) else page


def is_polytope(shape) -> bool:
    """Tell whether a shape is a hull of vertices."""
    return shape.name == "polytope"
