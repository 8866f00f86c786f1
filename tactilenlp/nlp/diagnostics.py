"""Diagnostics of a problem before it is solved: a description, and a check.

`describe` lists sizes, units and terms.  `check` compares derivatives with finite
differences, at the guess and at a random point near it, and reports bad scaling,
dependent constraints and unused variables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import qr

from .derivative_check import (
    DIFFERENCE_STEP,
    TOLERATED,
    assembled_error,
    derivative_errors,
    flat_terms,
    not_finite,
)
from .terms import Term

if TYPE_CHECKING:
    from .problem import Problem

POINT_SIGMA = 0.5  # [scales] standard deviation of the random point about the guess
BAD_SCALE = 1e4  # [-] scaled first derivatives beyond this, or below its inverse
LEAST_PIVOT = 1e-9  # [-] of the largest pivot: a row below it depends on the others
LARGEST_DENSE = 10_000_000  # entries of the largest Jacobian whose rank is computed
NO_RANGE = (np.nan, np.nan)


def describe(problem: Problem) -> str:
    """Return sizes, units and terms of a problem in words."""
    sizes = f"{problem.size} unknowns, {problem.rows} constraint rows"
    lines = [f"{sizes}; {_derivatives(problem)}", "unknowns"]
    for v in problem.variables.values():
        lines.append(
            f"  {v.name:30} {v.rows} x {v.columns:<5} [{v.unit}]  "
            f"bounds {_limits(v.lower, v.upper)}, "
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


def _derivatives(problem: Problem) -> str:
    """Return in words how many nonzeros the derivatives of a problem have."""
    terms = problem.terms.values()
    if any(t.function.jacobian_sparsity is None for t in terms):
        return "no derivatives: it was evaluated, not solved"
    places = [(t.first_row, t.jacobian_places) for t in problem.constraints.values()]
    jacobian = _nonzeros(((row + i, j) for row, (i, j) in places), problem.size)
    hessian = _nonzeros((t.hessian_places[:2] for t in terms), problem.size)
    return f"nonzeros: Jacobian {jacobian}, upper triangle of the Hessian {hessian}"


def _limits(lower: np.ndarray, upper: np.ndarray) -> str:
    """Return the limits of rows (rows, columns) in words, once where all are alike."""
    low, high = lower.min(axis=1, initial=np.inf), upper.max(axis=1, initial=-np.inf)
    each = [f"{a:.3g} .. {b:.3g}" for a, b in zip(low, high, strict=True)]
    return ", ".join(each[:1] if len({*each}) == 1 else each)


def _sentence(term: Term) -> str:
    """Return name, size, and role or limits of a term in a line."""
    function = term.function
    role = f"  {term.role}" if term.role else ""
    if term.lower is not None:
        role = f"  within {_limits(term.lower.T, term.upper.T)}"
    return (
        f"  {term.name:30} {term.instances} x {function.rows} row(s) of "
        f"{function.unknowns} unknowns, {function.data} data{role}"
    )


def _nonzeros(places, size: int) -> int:
    """Return how many different (row, column) there are."""
    keys = [i.astype(np.int64) * size + j for i, j in places]
    return len(np.unique(np.concatenate([np.zeros(0, np.int64), *keys])))


@dataclass(frozen=True, eq=False)
class Report:
    """The result of `check`; findings: one sentence for each fault, and its remedy.

    Errors of derivatives are the larger of those at the guess and at a random point
    near it; everything else is at the random point.

    derivatives: by term, error of (Jacobian, Hessian), relative to the largest entry of
    its instance; assembled: the same for the whole programme along a random direction.
    gradient, curvature: by variable, range of the nonzero |entries| of the objective's
    gradient and of its Hessian's diagonal, in scaled units; slope: by constraint, range
    of the lengths of its Jacobian's rows.  rank of the Jacobian with `rows` rows, None
    where that is too large; equality_rank of its `equalities` rows.  unused: names
    that no term reads; flat: terms that do not change there, whose derivatives the
    differences do not test.
    """

    size: int
    rows: int
    derivatives: dict[str, tuple[float, float]]
    assembled: float
    gradient: dict[str, tuple[float, float]]
    curvature: dict[str, tuple[float, float]]
    slope: dict[str, tuple[float, float]]
    rank: int | None
    equalities: int
    equality_rank: int | None
    unused: tuple[str, ...]
    flat: tuple[str, ...]
    findings: tuple[str, ...]

    @property
    def good(self) -> bool:
        return not self.findings

    def __str__(self) -> str:
        lines = [f"{self.size} unknowns, {self.rows} constraint rows"]
        lines.append("derivatives, relative error          Jacobian   Hessian")
        for name, (first, second) in self.derivatives.items():
            lines.append(f"  {name:34} {first:8.1e}  {second:8.1e}")
        lines.append(f"  {'whole programme, one direction':34} {self.assembled:8.1e}")
        lines += ["scaling                               gradient           curvature"]
        for name, span in self.gradient.items():
            lines.append(f"  {name:30} {_range(span)} {_range(self.curvature[name])}")
        lines += [f"  {name:30} {_range(span)}" for name, span in self.slope.items()]
        rank = "not computed" if self.rank is None else self.rank
        lines.append(
            f"rank {rank} of {self.rows} constraint rows, "
            f"{self.equality_rank} of {self.equalities} equalities"
        )
        lines += ["unused: " + (", ".join(self.unused) or "nothing")]
        lines += ["", *(f"MEND: {finding}" for finding in self.findings)]
        if self.flat:
            lines.append(
                f"not tested, flat at both points: {', '.join(self.flat)}; "
                "check(start={...}) nearer the data tests them"
            )
        last = "what was tested is good" if self.flat else "all good"
        return "\n".join(lines).rstrip() + (f"\n{last}" if self.good else "")


def check(problem: Problem, start: dict | None = None, seed: int = 0) -> Report:
    """Examine a problem at `start` (by name, SI; else the guesses) and beside it."""
    rng = np.random.default_rng(seed)
    guess, data = problem.pack(start or {}), problem.data()
    at, x = (_near(problem, guess, away, rng) for away in (0.0, POINT_SIGMA))
    errors = {}
    with np.errstate(all="ignore"):
        for name, term in problem.terms.items():
            both = [derivative_errors(problem, term, p, data, rng) for p in (at, x)]
            errors[name] = tuple(map(max, *both))
        assembled = assembled_error(problem, x, data, rng)
    at, variables = (x / problem.scale, data), problem.variables.values()
    g, J = np.abs(problem.assembly.evaluated(*at)[1]), problem.assembly.slopes(*at)
    c = sum(problem.hessian(name, x, data).diagonal() for name in problem.costs)
    c, lengths = np.abs(c * problem.scale**2), np.sqrt(J.multiply(J).sum(axis=1).A1)
    rank, equalities, equality_rank, dependent = _rank(problem, J)
    found = {
        "gradient": {v.name: _span(g[v.span]) for v in variables},
        "curvature": {v.name: _span(c[v.span]) for v in variables},
        "slope": {n: _span(lengths[t.span]) for n, t in problem.constraints.items()},
        "unused": (*_unused_variables(problem), *_unused_parameters(problem)),
        "flat": tuple(flat_terms(problem, (guess, x), data)),
    }
    mend = [*not_finite(problem, guess, data, "the guess"), *_wrong(errors, assembled)]
    mend += [*_bad_scales(problem, found, J), *dependent]
    mend += [f"no term reads {name}: drop it, or use it" for name in found["unused"]]
    return Report(
        size=problem.size, rows=problem.rows, derivatives=errors, assembled=assembled,
        rank=rank, equalities=equalities, equality_rank=equality_rank,
        findings=tuple(mend), **found,
    )  # fmt: skip


# -- derivatives ----------------------------------------------------------------------
def _near(problem, x, away, rng) -> np.ndarray:
    """Return a random point near x, inside the bounds with room for differences."""
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    room = np.minimum(4 * DIFFERENCE_STEP * problem.scale, (upper - lower) / 2)
    x = x + away * problem.scale * rng.normal(size=x.size)
    return np.clip(x, lower + room, upper - room)


def _wrong(errors, assembled):
    """Yield a sentence for each wrong derivative."""
    for name, both in errors.items():
        if not np.isfinite(both).all():
            yield f'"{name}" or a derivative of it is not finite near the guess'
            continue
        for error, word in zip(both, ("Jacobian", "Hessian"), strict=True):
            if error > TOLERATED:
                yield (
                    f'the {word} of "{name}" is off by {error:.1e} of its size: round '
                    "its kinks, keep divisors and roots away from zero"
                )
    worst = max((max(both) for both in errors.values()), default=0.0)
    if assembled > TOLERATED and not worst > TOLERATED:
        yield f"the assembled derivatives are off by {assembled:.1e}: report this bug"


# -- scaling --------------------------------------------------------------------------
def _bad_scales(problem, found, J):
    """Yield a sentence for each variable or constraint with slopes far from one."""
    for name, v in problem.variables.items():
        bend = np.sqrt(found["curvature"][name][1])
        largest = np.nanmax([0.0, bend, *np.abs(J[:, v.span].data)])
        if largest and not 1 / BAD_SCALE <= largest <= BAD_SCALE:
            yield (
                f"{name} is badly scaled: one scale ({v.scale[0]:.3g} {v.unit}, ...) "
                f"changes the programme {largest:.1e}-fold; divide the scale by that"
            )
    for name, (least, largest) in found["slope"].items():
        if largest > BAD_SCALE or largest < 1 / BAD_SCALE:
            yield (
                f'"{name}" is badly scaled: its rows change by {least:.1e} to '
                f"{largest:.1e} over one scale; divide the term by that"
            )


def _span(values) -> tuple[float, float]:
    values = values[values != 0]
    return (float(values.min()), float(values.max())) if values.size else NO_RANGE


def _range(span) -> str:
    return f"{'-':^19}" if np.isnan(span[0]) else f"{span[0]:8.1e} {span[1]:8.1e}  "


# -- rank -----------------------------------------------------------------------------
def _rank(problem, J):
    """Return rank of all rows, number and rank of equalities, sentences on these."""
    names = [n for n, t in problem.constraints.items() for _ in range(t.rows)]
    free = problem.bounds("lower") < problem.bounds("upper")
    J = J[:, free]
    equal = np.nonzero(problem.limits("lower") == problem.limits("upper"))[0]
    if np.prod(J.shape) > LARGEST_DENSE:
        return None, len(equal), None, ()
    rank, _ = _independent(J.toarray())
    equality_rank, dependent = _independent(J[equal].toarray())
    dependent = list(dict.fromkeys(names[equal[i]] for i in dependent))
    text = (
        f"equalities depend on each other here ({equality_rank} of {len(equal)} are "
        f"independent), among them {', '.join(dependent)}: drop or relax some"
    )
    return rank, len(equal), equality_rank, (text,) if dependent else ()


def _independent(matrix) -> tuple[int | None, np.ndarray]:
    """Return the numerical rank and the rows that depend on the others."""
    if not matrix.size:
        return 0, np.arange(len(matrix))
    if not np.isfinite(matrix).all():
        return None, np.arange(0)
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    triangle, order = qr((matrix / np.where(length > 0, length, 1.0)).T, mode="r",
                         pivoting=True)  # fmt: skip
    pivots = np.abs(np.diag(triangle))
    rank = int((pivots > LEAST_PIVOT * max(pivots[0], LEAST_PIVOT)).sum())
    return rank, np.sort(order[rank:])


# -- unused ---------------------------------------------------------------------------
def _unused_variables(problem):
    """Yield the names of unknowns on which no term depends."""
    read = np.zeros(problem.size, bool)
    for term in problem.terms.values():
        read[term.jacobian_places[1]] = True
    for v in problem.variables.values():
        missing = np.argwhere(~read[v.span].reshape(v.columns, v.rows))
        if len(missing):
            column, row = missing[0]
            where = f"{len(missing)} of {v.rows * v.columns}, first [{row}, {column}]"
            yield (
                v.name if len(missing) == v.rows * v.columns else f"{v.name} ({where})"
            )


def _unused_parameters(problem):
    """Yield the names of parameters that no term reads."""
    read = np.zeros(problem.data().size, bool)
    for term in (*problem.terms.values(), *problem.reports.values()):
        read[term.data] = True
    for p in problem.parameters.values():
        if not read[p.span].any():
            yield p.name
