"""Describe a problem in words: sizes, units, terms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .terms import Term

if TYPE_CHECKING:
    from .nlp import Problem


def describe(problem: Problem) -> str:
    """Return sizes, units and terms of a problem in words."""
    terms = problem.terms.values()
    places = [(t.first_row, t.jacobian_places()) for t in problem.constraints.values()]
    jacobian = _nonzeros(((row + i, j) for row, (i, j) in places), problem.size)
    hessian = _nonzeros((t.hessian_places()[:2] for t in terms), problem.size)
    lines = [
        f"{problem.size} unknowns, {problem.rows} constraint rows; nonzeros: Jacobian "
        f"{jacobian}, upper triangle of the Hessian {hessian}",
        "unknowns",
    ]
    for v in problem.variables.values():
        limits = (
            f"{v.lower.min(initial=np.inf):.3g} .. {v.upper.max(initial=-np.inf):.3g}"
        )
        lines.append(
            f"  {v.name:30} {v.rows} x {v.columns:<5} [{v.unit}]  bounds {limits}, "
            f"scale {', '.join(f'{s:.3g}' for s in v.scale)}"
        )
    for title, group in (
        ("minimise the sum of", problem.costs),
        ("subject to", problem.constraints),
        ("report", problem.reports),
    ):
        lines += [title, *map(_sentence, group.values())] if group else []
    if problem.parameters:
        lines.append("parameters")
    for p in problem.parameters.values():
        lines.append(f"  {p.name:30} {', '.join(f'{v:.4g}' for v in p.value.ravel())}"
                     f" [{p.unit or '1'}]")  # fmt: skip
    return "\n".join(lines)


def _sentence(term: Term) -> str:
    kind = term.kind
    role = f"  {term.role}" if term.role else ""
    return (
        f"  {term.name:30} {term.instances} x {kind.rows} row(s) of {kind.unknowns} "
        f"unknowns, {kind.data} data{role}"
    )


def _nonzeros(places, size: int) -> int:
    """Return how many different (row, column) there are."""
    keys = [i.astype(np.int64) * size + j for i, j in places]
    return len(np.unique(np.concatenate([np.zeros(0, np.int64), *keys])))
