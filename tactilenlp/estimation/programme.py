"""The programme of an estimate, built again at its solution."""

from __future__ import annotations

from time import monotonic

import numpy as np

from ..errors import OptionError
from ..interface.request import make_job
from ..local.solved import Solved
from ..problem.options import Options
from ..problem.pages import name_of, page_of, shape_of
from ..refinement.incremental import past_solution


def class_and_page(estimate, shape=None, formulation=None) -> tuple:
    """Return the Shape and the page of an estimate; OptionError for another one."""
    shape = shape_of(estimate.shape if shape is None else shape)
    stated = estimate.formulation if formulation is None else formulation
    page = page_of(stated, shape)
    for name, value in (("shape", shape.name), ("formulation", name_of(page))):
        if (own := getattr(estimate, name)) != value:
            raise OptionError(
                "not that of the estimate", where=name, got=value, expected=own,
                next="give it as it was given to solve_estimate",
            )  # fmt: skip
    return shape, page


def programme_at(estimate, shape=None, formulation=None) -> Solved:
    """Return the page of an estimate, built again, as it was solved.

    shape, formulation: of the estimate, by default those of the names it has.
    """
    shape, page = class_and_page(estimate, shape, formulation)
    scene = estimate.scene
    if shape.of_vertices:
        raise OptionError(
            "the problem of a polytope is not built again",
            where="estimate", got=estimate.shape, expected="a shape with sizes",
            next='ask for kind="exact", which every estimate carries',
        )  # fmt: skip
    job = make_job(estimate.measurements, scene, shape, Options(), monotonic(), page)
    solved = past_solution(job.as_late_as(estimate.sensors), estimate)
    _check_same_unknowns(solved.problem, estimate)
    return solved


def _check_same_unknowns(problem, estimate) -> None:
    """Raise OptionError unless an estimate has the unknowns of its problem."""
    for name, variable in problem.variables.items():
        size = np.shape(estimate.unknowns.get(name, ()))
        if size != (variable.rows, variable.columns):
            raise OptionError(
                "the problem of this estimate cannot be built again",
                where=name, got=size, expected=(variable.rows, variable.columns),
                next="estimate again with this version of the page",
            )  # fmt: skip
