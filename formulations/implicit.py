r"""Quantities that an equation defines: u with F(u, z) = 0.

Their derivatives follow from the implicit function theorem,

    du/dz = -F_u^-1 F_z,

so that the iteration that finds u is not differentiated.  While a term is traced,
`root` returns symbols for u and notes equation and solution, of which the derivatives
are made (tactilenlp/nlp/term_functions.py); elsewhere the iteration is written out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

import casadi as ca

_noted: ContextVar[list | None] = ContextVar("noted", default=None)


class Root(NamedTuple):
    """Symbols u (k,), F (k,) at these, and the solution (k,)."""

    unknown: object
    residual: object
    solution: object


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


def root(residual: Callable, solution) -> ca.SX:
    """Return symbols u (k,) with residual(u) = 0, of which `solution` is the value."""
    unknown = ca.SX.sym("u", solution.numel())
    _noted.get().append(Root(unknown, residual(unknown), solution))
    return unknown
