r"""Quantities that an equation defines: u with F(u, z) = 0.

Their derivatives follow from the implicit function theorem,

    du/dz = -F_u^-1 F_z,

so that the iteration that finds u is not differentiated.  While a term is traced,
`root` returns symbols for u and notes the equation, of which the derivatives are made
(tactilenlp/nlp/derivation.py), and the function that solves it, which terms share;
elsewhere the iteration is written out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from itertools import accumulate
from typing import NamedTuple

import casadi as ca

_noted: ContextVar[list | None] = ContextVar("noted", default=None)


class Root(NamedTuple):
    """Symbols u (k,), F (k,) at these; solver: a -> u, of the argument a (n,)."""

    unknown: object
    residual: object
    solver: object
    argument: object


@contextmanager
def noting_roots() -> Iterator[list[Root]]:
    """Note all roots that are asked for within a block."""
    roots: list[Root] = []
    token = _noted.set(roots)
    try:
        yield roots
    finally:
        _noted.reset(token)


def are_noted() -> bool:
    """Tell whether roots are noted; else they have to be written out."""
    return _noted.get() is not None


def root(residual: Callable, solver: ca.Function, *arguments) -> ca.SX:
    """Return symbols u (k,) with residual(u) = 0; solver(*arguments) is their value."""
    argument = ca.vertcat(*(ca.vec(ca.SX(one)) for one in arguments))
    unknown = ca.SX.sym("u", solver.numel_out(0))
    noted = Root(unknown, residual(unknown), _of_column(solver), argument)
    _noted.get().append(noted)
    return unknown


@cache
def _of_column(solver: ca.Function) -> ca.Function:
    """Return a function of all arguments one below the other."""
    sizes = [solver.size_in(k) for k in range(solver.n_in())]
    column = ca.SX.sym("a", sum(rows * columns for rows, columns in sizes))
    ends = [*accumulate((rows * columns for rows, columns in sizes), initial=0)]
    parts = [
        ca.reshape(part, *size)
        for part, size in zip(ca.vertsplit(column, ends), sizes, strict=True)
    ]
    return ca.Function("root", [column], [solver(*parts)], {"cse": True})


def solve_3(A, b):
    """Return A^-1 b, A (3, 3), by cofactors: three columns need no pivoting code."""
    rows = [A[i, :].T for i in range(3)]
    cofactors = [ca.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
    return ca.horzcat(*cofactors) @ b / ca.dot(rows[0], cofactors[0])
