"""Term functions: value, Jacobian and Hessian of one term, derived once for all uses.

A term is written as a small pure function of a few local unknowns and data.  It is
traced with CasADi SX, differentiated exactly and kept under its serialised expression,
so that an edited page is derived again and an unedited one is not: in this process by a
`TermFunctionCache`, on this machine, where there is a C compiler, by codegen.py.

Of a term v(z, u) that reads roots u of F(u, z) = 0, as whoever poses it notes, with
U = du/dz = -F_u^-1 F_z, multipliers l, and m = -F_u^-T v_u' l,

    dv/dz = v_z + v_u U,     Hessian of l'v:  [1; U]' (l'v + m'F)'' [1; U],

the second derivatives by z and u.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import cache
from itertools import islice
from typing import NamedTuple

import casadi as ca

from ..common.deadline import NEVER, Deadline
from ..errors import PageError
from .codegen import begun, kept
from .simd import vector_source

PARTS = ("value", "first", "second", "patterns")  # names of the compiled functions
REMEDIES = {  # of what keeps a function from being traced, by words of the error
    "truth value": "write casadi.if_else(condition, a, b), casadi.fmax or casadi.fmin",
    "positional argument": "the function takes each argument of the term, in order",
    "out of bounds": "count rows: x has 3 in planar, 6 in free motion; theta its sizes",
}


@dataclass(frozen=True)
class TermFunction:
    """Functions of (unknowns z, data d, multiplier l) that a term's instances share.

    `value` (z, d) -> (m,); `first` (z, d) -> (m,), nonzeros of the Jacobian;
    `second` (z, d, l) -> nonzeros of the upper triangle of the Hessian of l' value.
    Compiled, each may take several instances at once, as columns: see `mapped`.
    made: returns these three, waiting for their compilation where it still runs.
    """

    rows: int
    unknowns: int
    data: int
    made: Callable[[], list[ca.Function]]
    jacobian_sparsity: ca.Sparsity | None = None
    hessian_sparsity: ca.Sparsity | None = None

    @property
    def value(self) -> ca.Function:
        return self.made()[0]

    @property
    def first(self) -> ca.Function:
        return self.made()[1]

    @property
    def second(self) -> ca.Function:
        return self.made()[2]


@dataclass
class TermFunctionCache:
    """Keep the term functions that were derived, by expression; mutable.

    The caller owns a cache and passes it as `Problem(cache=...)`; without one, problems
    use the default of the process (`default_cache`).  read, compile: whether libraries
    that were compiled earlier are loaded, and new ones compiled; else CasADi's virtual
    machine evaluates the same expressions.  derive: False for a problem whose terms are
    evaluated, but that is not solved.  functions: by serialised expression; derived:
    how many were differentiated; seconds [s]: what that took.

    A cache stays in its process: unpickled elsewhere it is the default cache there.
    """

    read: bool = True
    compile: bool = True
    derive: bool = True
    functions: dict[str, TermFunction] = field(default_factory=dict)
    derived: int = 0
    seconds: float = 0.0

    def __reduce__(self):
        return default_cache, ()

    def of(
        self,
        function: Callable,
        unknowns: list[int],
        order: list[tuple],
        deadline: Deadline = NEVER,
        noting: Callable = nullcontext,
    ) -> TermFunction:
        """Trace `function` and return its term function; derive it if it is new.

        unknowns: lengths of the arguments that are local unknowns; order: for each
        argument ("z" | "d", length), local unknown or data; deadline: of compilations;
        noting: a context in which `function` is called; it gives a list of the roots
        that were read by then: symbols u (k,), F (k,) at these, the solution (k,).
        """
        if not self.derive:
            return traced(function, unknowns, order)
        term = _trace(function, unknowns, order, noting)
        key = "".join(part.serialize() for part in term)
        if key not in self.functions:
            found = kept(PARTS, _origin(key)) if self.read else None
            self.functions[key] = (
                self._derive(term, key, deadline)
                if found is None
                else _term_function(found, lambda: found)
            )
        return self.functions[key]

    def _derive(self, term: Traced, key: str, deadline: Deadline) -> TermFunction:
        began = time.perf_counter()
        functions = _derivatives(*term)
        given = functions, _origin(key), deadline, True
        made = begun(*given) if self.compile else None
        found = _term_function(functions, made or (lambda: functions))
        self.derived += 1
        self.seconds += time.perf_counter() - began
        return found

    @contextmanager
    def as_default(self) -> Iterator[TermFunctionCache]:
        """Make this the default cache of the process within a block."""
        global _default
        before, _default = _default, self
        try:
            yield self
        finally:
            _default = before


_default = TermFunctionCache()


def default_cache() -> TermFunctionCache:
    """Return the cache that problems of this process use unless given another."""
    return _default


def traced(function: Callable, unknowns: list[int], order: list[tuple]) -> TermFunction:
    """Return a term function without derivatives: for what is read off a solution."""
    term = _trace(function, unknowns, order)
    z, d = (ca.SX.sym(name, term.at.size1_in(k)) for k, name in enumerate("zd"))
    value = ca.Function("term", [z, d], [term.value(z, d)])
    sizes = (value.size1_out(0), value.size1_in(0), value.size1_in(1))
    return TermFunction(*sizes, lambda: [value, None, None])


def term_function_named(name: str, trace, function, sizes, order) -> TermFunction:
    """Return trace(function, sizes, order); PageError names the term where it fails."""
    try:
        return trace(function, sizes, order)
    except PageError:
        raise
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
        remedies = [fix for sign, fix in REMEDIES.items() if sign in words]
        raise PageError(
            "the term's function cannot be traced", where=name, got=words,
            expected="a pure CasADi expression of its arguments (column vectors)",
            next=(remedies or [""])[0],
        ) from error  # fmt: skip


@cache
def mapped(function: ca.Function, instances: int) -> ca.Function:
    """Return `function` applied to `instances` columns.

    A function of several columns at once is given the last one again until they are.
    """
    width = function.size2_in(0)
    calls = -(-instances // width)
    many, missing = function.map(calls), calls * width - instances
    if not missing:
        return many
    given = [
        ca.MX.sym(function.name_in(k), function.size1_in(k), instances)
        for k in range(function.n_in())
    ]
    filled = [ca.horzcat(one, ca.repmat(one[:, -1], 1, missing)) for one in given]
    found = [one[:, :instances] for one in many.call(filled)]
    return ca.Function(function.name(), given, found)


def applied(term, part: str, x, data, *weights):
    """Return what `part` of a term's function returns, a column for each instance."""
    function = mapped(getattr(term.function, part), term.instances)
    return function(x[term.unknowns].T, data[term.data].T, *weights)


class Traced(NamedTuple):
    """A term and its roots as functions: (z, d, u) -> v, F and (z, d) -> u."""

    at: ca.Function
    solution: ca.Function

    def value(self, z, d):
        """Return v (m,) at the solution."""
        return self.at(z, d, self.solution(z, d))[0]


def _trace(function, unknowns, order, noting=nullcontext) -> Traced:
    z = [ca.SX.sym(f"z{i}", n) for i, n in enumerate(unknowns)]
    d = [ca.SX.sym(f"d{i}", n) for i, (role, n) in enumerate(order) if role == "d"]
    zs, ds = iter(z), iter(d)
    with noting() as roots:
        value = function(*(next(zs) if role == "z" else next(ds) for role, _ in order))
    value = ca.densify(ca.vec(ca.SX(value)))
    z, d = ca.vertcat(*z), ca.vertcat(*d)
    roots, value = _merged(roots or [], value)
    u, residual, solution = (ca.vertcat(*part) for part in zip(*roots, strict=True))
    return Traced(
        ca.Function("term", [z, d, u], [value, residual]),
        ca.Function("roots", [z, d], [solution]),
    )


def _merged(roots: list[tuple], value) -> tuple[list[tuple], ca.SX]:
    """Return the roots of which no two have one equation, and the value of these."""
    most = ca.SX.sym("u", max((root[0].numel() for root in roots), default=0))
    equations = [ca.substitute(F, u, most[: u.numel()]) for u, F, _ in roots]
    if len(roots) > 1:
        left = iter(ca.cse(ca.vertcat(*equations)).elements())
        equations = [ca.vertcat(*islice(left, F.numel())) for F in equations]
    kept = {}
    for root, equation in zip(roots, equations, strict=True):
        key = tuple(one.element_hash() for one in equation.elements())
        first = kept.setdefault(key, root)
        value = ca.substitute(value, root[0], first[0])
    return [(ca.SX(0, 1),) * 3, *kept.values()], value


def _origin(key: str) -> str:
    """Return what compiled derivatives follow from: expression and derivation rule."""
    return _derivation_rule() + key


@cache
def _derivation_rule() -> str:
    vectors = inspect.getmodule(vector_source)
    return inspect.getsource(_derivatives) + inspect.getsource(vectors)


def _derivatives(at: ca.Function, solution: ca.Function) -> list[ca.Function]:
    """Return the functions named in PARTS; their source is part of the compiled key."""
    z, d, u = (ca.SX.sym(name, at.size1_in(k)) for k, name in enumerate("zdu"))
    value, residual = (ca.cse(ca.densify(part)) for part in at(z, d, u))
    multiplier, m = ca.SX.sym("l", value.numel()), ca.SX.sym("m", u.numel())
    lagrangian = ca.dot(multiplier, value)
    jacobian = ca.jacobian(value, z)
    hessian, _ = ca.hessian(lagrangian + ca.dot(m, residual), ca.vertcat(z, u))
    if u.numel():
        by_u = ca.jacobian(residual, u)
        moved = -ca.solve(by_u, ca.jacobian(residual, z))
        jacobian += ca.jacobian(value, u) @ moved
        m_of = -ca.solve(by_u.T, ca.gradient(lagrangian, u))
        hessian = ca.substitute(hessian, m, m_of)
        n = z.numel()
        mixed = hessian[:n, n:] @ moved
        hessian = hessian[:n, :n] + mixed + mixed.T + moved.T @ hessian[n:, n:] @ moved
        value, jacobian, hessian = ca.substitute(
            [value, jacobian, hessian], [u], [solution(z, d)]
        )
    hessian = ca.triu(hessian)
    nonzeros = [ca.vertcat(*matrix.nonzeros()) for matrix in (jacobian, hessian)]
    nonzeros = [ca.SX(0, 1) if n.is_empty() else ca.densify(n) for n in nonzeros]
    patterns = [ca.DM(matrix.sparsity(), 1) for matrix in (jacobian, hessian)]
    cse = {"cse": True}
    return [
        ca.Function("value", [z, d], [value], cse),
        ca.Function("first", [z, d], [value, nonzeros[0]], cse),
        ca.Function("second", [z, d, multiplier], [nonzeros[1]], cse),
        ca.Function("patterns", [], patterns),
    ]


def _term_function(parts, made: Callable) -> TermFunction:
    """Return the term function of PARTS; outputs of `patterns` are its sparsities."""
    value, *_, patterns = parts
    return TermFunction(
        rows=value.size1_out(0),
        unknowns=value.size1_in(0),
        data=value.size1_in(1),
        made=made,
        jacobian_sparsity=patterns.sparsity_out(0),
        hessian_sparsity=patterns.sparsity_out(1),
    )
