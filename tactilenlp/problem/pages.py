"""Find the page and the shape that a name stands for."""

from __future__ import annotations

import importlib

from formulations.polytope import polytope
from formulations.shape import CUBOID, Shape

from ..errors import OptionError

SHAPES = {"cuboid": CUBOID, "polytope": polytope()}
FORMULATIONS = (
    *("quasi_static", "violation_implicit", "paper"),
    *("shooting", "multiple_shooting", "complementarity"),
)


def shape_of(shape) -> Shape:
    """Return the shape of a name, or a user's; OptionError for an unknown name."""
    if isinstance(shape, Shape):
        return shape
    if not isinstance(shape, str) or shape not in SHAPES:
        raise OptionError(
            "unknown shape", where="shape", got=shape, expected=f"one of {[*SHAPES]}"
        )
    return SHAPES[shape]


def page_of(formulation, shape):
    """Return the page of a name, the shape's own if it has any, or a user's page."""
    if isinstance(formulation, str):
        return importlib.import_module(f"formulations.{_module_of(formulation, shape)}")
    for name in ("build", "LEVELS"):
        if not hasattr(formulation, name):
            raise OptionError(
                f"a page needs {name}", where="formulation", got=repr(formulation)
            )
    return formulation


def _module_of(formulation: str, shape) -> str:
    """Return the module of a formulation; OptionError where the shape has none."""
    if formulation not in FORMULATIONS:
        raise OptionError(
            "unknown formulation",
            where="formulation",
            got=formulation,
            expected=f"one of {FORMULATIONS}, or a page",
        )
    if not shape.own_pages:
        return formulation
    if formulation not in shape.own_pages:
        raise OptionError(
            f"no page of this name for a {shape.name}",
            where="formulation",
            got=formulation,
            expected=" or ".join(f'"{name}"' for name in shape.own_pages),
            next='use shape="cuboid", or give a page of your own',
        )
    return f"{shape.name}_{formulation}"


def page_named(page):
    """Return a page: a module travels between processes by its name."""
    return importlib.import_module(page) if isinstance(page, str) else page
