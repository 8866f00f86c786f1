"""Derive one kind of term: value, gradient, Jacobian, Hessian, once per machine.

A kind is a small pure function of a few local unknowns and data.  It is traced with
CasADi SX, differentiated exactly and kept under the hash of its expression, so that
an edited page is derived anew and an unedited one never twice: in this process, and
where a compiler is there on this machine (codegen.py).
"""

from __future__ import annotations

import inspect
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import casadi as ca

from ..errors import PageError
from .codegen import compiled, kept

PARTS = ("value", "first", "second", "patterns")
_cache: dict[str, Kind] = {}
seconds_deriving = [0.0]


@dataclass(frozen=True)
class Kind:
    """Functions of (unknowns z, data d, multiplier l) that a term's instances share.

    `value` (z, d) -> (m,); `first` (z, d) -> (m,), nonzeros of the Jacobian;
    `second` (z, d, l) -> nonzeros of the upper triangle of the Hessian of l' value.
    """

    rows: int
    unknowns: int
    data: int
    value: ca.Function
    first: ca.Function
    second: ca.Function
    jacobian_sparsity: ca.Sparsity
    hessian_sparsity: ca.Sparsity


def kind_of(function: Callable, unknowns: list[int], order: list[tuple]) -> Kind:
    """Trace `function` and return its kind; derive it if it is new to this process.

    `order` says for each argument ("z" | "d", length): local unknown or data.
    """
    value = _trace(function, unknowns, order)
    key = value.serialize()
    if key not in _cache:
        found = kept(PARTS, _origin(value))
        _cache[key] = _derive(value) if found is None else _kind(*found)
    return _cache[key]


def kind_named(name, trace, function, sizes, order) -> Kind:
    """Return `trace` of a function; say whose function it was that failed."""
    try:
        return trace(function, sizes, order)
    except PageError:
        raise
    except Exception as error:
        raise PageError(
            "the term's function cannot be traced",
            where=name,
            got=f"{type(error).__name__}: {error}",
            expected="a pure CasADi expression of its arguments (column vectors)",
        ) from error


def traced(function: Callable, unknowns: list[int], order: list[tuple]) -> Kind:
    """Return a kind that can only be evaluated: for what is read off a solution."""
    value = _trace(function, unknowns, order)
    sizes = (value.size1_out(0), value.size1_in(0), value.size1_in(1))
    return Kind(*sizes, value, first=None, second=None, jacobian_sparsity=None,
                hessian_sparsity=None)  # fmt: skip


def _trace(function, unknowns, order) -> ca.Function:
    z = [ca.SX.sym(f"z{i}", n) for i, n in enumerate(unknowns)]
    d = [ca.SX.sym(f"d{i}", n) for i, (role, n) in enumerate(order) if role == "d"]
    zs, ds = iter(z), iter(d)
    value = function(*(next(zs) if role == "z" else next(ds) for role, _ in order))
    value = ca.densify(ca.vec(ca.SX(value)))
    return ca.Function("kind", [ca.vertcat(*z), ca.vertcat(*d)], [value])


def _origin(traced: ca.Function) -> str:
    """Return all that a kind follows from: the expression, and how it is derived."""
    return _rules() + traced.serialize()


@cache
def _rules() -> str:
    return inspect.getsource(sys.modules[__name__])


def _derive(traced: ca.Function) -> Kind:
    began = time.perf_counter()
    z = ca.SX.sym("z", traced.size1_in(0))
    d = ca.SX.sym("d", traced.size1_in(1))
    value = ca.cse(ca.densify(traced(z, d)))
    multiplier = ca.SX.sym("l", value.numel())
    jacobian = ca.jacobian(value, z)
    hessian = ca.triu(ca.hessian(ca.dot(multiplier, value), z)[0])
    nonzeros = [ca.vertcat(*matrix.nonzeros()) for matrix in (jacobian, hessian)]
    nonzeros = [ca.SX(0, 1) if n.is_empty() else ca.densify(n) for n in nonzeros]
    patterns = [ca.DM(matrix.sparsity(), 1) for matrix in (jacobian, hessian)]
    cse = {"cse": True}
    functions = [
        ca.Function("value", [z, d], [value], cse),
        ca.Function("first", [z, d], [value, nonzeros[0]], cse),
        ca.Function("second", [z, d, multiplier], [nonzeros[1]], cse),
        ca.Function("patterns", [], patterns),
    ]
    kind = _kind(*compiled(functions, _origin(traced)))
    seconds_deriving[0] += time.perf_counter() - began
    return kind


def _kind(value, first, second, patterns) -> Kind:
    """Return the kind of these functions; the outputs of `patterns` are its own."""
    return Kind(
        rows=value.size1_out(0),
        unknowns=value.size1_in(0),
        data=value.size1_in(1),
        value=value,
        first=first,
        second=second,
        jacobian_sparsity=patterns.sparsity_out(0),
        hessian_sparsity=patterns.sparsity_out(1),
    )


@cache
def mapped(function: ca.Function, instances: int) -> ca.Function:
    """Return `function` applied to `instances` columns."""
    return function.map(instances)
