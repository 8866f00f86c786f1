"""Find the page and the shape that a name stands for."""

from __future__ import annotations

import importlib
import re
from functools import partial

from formulations.ellipsoid import ELLIPSOID
from formulations.polytope import polytope
from formulations.shape import CUBOID, Shape
from formulations.upright import CYLINDER, prism

from ..errors import OptionError, PageError, shortened

_short = partial(shortened, most=80)
SHAPES = {
    "cuboid": CUBOID, "polytope": polytope(), "cylinder": CYLINDER,
    "ellipsoid": ELLIPSOID,
}  # fmt: skip
PRISM = re.compile(r"prism of (\d{1,3}) sides")
FORMULATIONS = (
    *("quasi_static", "violation_implicit", "paper"),
    *("shooting", "multiple_shooting", "complementarity"),
)


def shape_of(shape) -> Shape:
    """Return the shape of a name, or a user's; OptionError for an unknown name."""
    if isinstance(shape, Shape):
        return shape
    if isinstance(shape, str) and (sides := PRISM.fullmatch(shape)):
        return prism(int(sides[1]))
    if not isinstance(shape, str) or shape not in SHAPES:
        raise OptionError(
            "unknown shape", where="shape", got=shape,
            expected=f"one of {[*SHAPES]}, or a Shape such as tactilenlp.prism(6)",
        )  # fmt: skip
    return SHAPES[shape]


def page_of(formulation, shape):
    """Return the page of a name, the shape's own if it has any, or a user's page."""
    if isinstance(formulation, str):
        return importlib.import_module(f"formulations.{_module_of(formulation, shape)}")
    for name in ("build", "LEVELS"):
        if not hasattr(formulation, name):
            raise OptionError(
                f"a page needs {name}", where="formulation", got=_short(formulation)
            )
    levels = formulation.LEVELS
    listed = isinstance(levels, (tuple, list)) and len(levels) > 0
    if not (listed and all(hasattr(k, "with_ipopt") for k in levels)):
        raise OptionError(
            "a page needs levels", where="formulation.LEVELS", got=_short(levels),
            expected="a tuple of formulations.level.Level, at least one",
        )  # fmt: skip
    if not callable(formulation.build):
        raise OptionError(
            "a page needs a function", where="formulation.build",
            got=_short(formulation.build), expected="build(nlp, window, scene, shape)",
        )  # fmt: skip
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


def check_unknowns(problem, theta, x) -> None:
    """Raise PageError unless the unknowns theta and x have the sizes of a start."""
    declared = {n: (v.rows, v.columns) for n, v in problem.variables.items()}
    rows, columns = declared.get("theta", (0, 0))
    if rows * columns == theta.size and declared.get("x") == x.shape:
        return
    raise PageError(
        "the page lacks an unknown, or it has another size", where="formulation",
        got=", ".join(f"{n} {size}" for n, size in declared.items()) or "none",
        expected=f"theta of {theta.size} numbers [m], x {x.shape}, a column a pose",
        next='declare nlp.variable("theta", ...) and nlp.variable("x", ...) in build',
    )  # fmt: skip


def page_named(page):
    """Return a page: a module travels between processes by its name."""
    return importlib.import_module(page) if isinstance(page, str) else page
