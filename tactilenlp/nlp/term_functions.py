"""Term functions: value, Jacobian and Hessian of one term, derived once for all uses.

A term is written as a small pure function of a few local unknowns and data.  It is
traced with CasADi SX, differentiated exactly (derivation.py) and kept under its
serialised expression, so that an edited page is derived again and an unedited one is
not: in this process by a `TermFunctionCache`, on this machine, where there is a C
compiler, by codegen.py.
"""

from __future__ import annotations

import hashlib
import inspect
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cache, partial

import casadi as ca
import numpy as np

from ..common.deadline import NEVER, Deadline
from ..errors import PageError
from .codegen import Compiling, compiled_earlier, start_compilation
from .compilation import LEAST_COMPILE_TIME, time_for_compilation
from .derivation import PARTS, derivatives, expressions_of, values
from .simd import WIDTH

REMEDIES = {  # of what keeps a function from being traced, by words of the error
    "truth value": "write casadi.if_else(condition, a, b), casadi.fmax or casadi.fmin",
    "positional argument": "the function takes each argument of the term, in order",
    "out of bounds": "count rows: x has 3 in planar, 6 in free motion; theta its sizes",
}


@dataclass(frozen=True, eq=False)
class TermFunction:
    """Functions of (unknowns z, data d, roots u, multipliers l) of a term's instances.

    `arguments` (z, d) -> a, of which `solver` makes the roots u; `first` (z, d, u) ->
    value (m,), nonzeros of the Jacobian; `second` (z, d, u, l) -> nonzeros of the upper
    triangle of the Hessian of l' value.  Compiled, each may take several instances at
    once, as columns: see `OfColumns`.  rows, unknowns, data, roots, arguments: lengths
    of value, z, d, u, a; equations: how many roots u are; compiled, solver: return the
    functions, waiting for compilers that still run.
    """

    rows: int
    unknowns: int
    data: int
    roots: int
    arguments: int
    equations: int
    compiled: Compiling
    solver: Callable[[], ca.Function] | None = None
    jacobian_sparsity: ca.Sparsity | None = None
    hessian_sparsity: ca.Sparsity | None = None

    def part(self, name: str) -> ca.Function:
        """Return one of the functions, by its name in PARTS."""
        return self.compiled()[PARTS.index(name)]

    def evaluated(self, name: str, z, d, *weights) -> list[np.ndarray]:
        """Return what a part returns for several instances, columns of all arrays.

        z (unknowns, k), d (data, k); weights: of `second` the multipliers (rows, k).
        """
        return self.evaluator(name, z.shape[1])(z, d, *weights)

    def evaluator(self, name: str, instances: int) -> Callable:
        """Return `evaluated` of a part for so many instances, to be called often."""
        part = OfColumns(self.part(name), instances)
        if not self.solver:
            none = np.zeros((0, instances))
            return lambda z, d, *weights: part(z, d, none, *weights)
        arguments = OfColumns(self.part("arguments"), instances)
        solve = OfColumns(self.solver(), instances * self.equations)
        each = self.arguments // self.equations

        def evaluate(z, d, *weights) -> list[np.ndarray]:
            (a,) = arguments(z, d)
            (u,) = solve(a.reshape((each, -1), order="F"))
            return part(z, d, u.reshape((self.roots, -1), order="F"), *weights)

        return evaluate


@dataclass
class TermFunctionCache:
    """Keep the term functions that were derived, by expression; mutable.

    The caller owns a cache and passes it as `Problem(cache=...)`; without one, problems
    use the default of the process (`default_cache`).  derive: False for a problem whose
    terms are evaluated, but that is not solved.  functions_by_key, solvers_by_key: the
    keys are serialised expressions; derived: how many were not compiled earlier;
    seconds [s]: what it took to differentiate these.

    A cache stays in its process: unpickled elsewhere it is the default cache there.
    """

    derive: bool = True
    functions_by_key: dict[str, TermFunction] = field(default_factory=dict)
    solvers_by_key: dict[str, Compiling] = field(default_factory=dict)
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
        that were read by then: symbols u (k,), F (k,) at these, their solver a -> u
        and its argument a.
        """
        if not self.derive:
            return without_derivatives(function, unknowns, order)
        *term, solver = expressions_of(function, unknowns, order, noting)
        of_roots = _digest(solver) if solver else ""
        key = "".join([*(part.serialize() for part in term), of_roots])
        known = self.functions_by_key.get(key)
        if known is None or _may_be_compiled(known.compiled, deadline):
            derived = partial(derivatives, *term)
            parts, compiled = self._compiled_or_derived(PARTS, key, derived, deadline)
            solve = self._solver(solver, of_roots, deadline) if solver else None
            self.functions_by_key[key] = _term_function(parts, compiled, solver, solve)
        return self.functions_by_key[key]

    def _solver(self, solver: ca.Function, key: str, deadline: Deadline) -> Callable:
        """Return what returns a solver, compiled once for all terms if possible."""
        known = self.solvers_by_key.get(key)
        if known is None or _may_be_compiled(known, deadline):
            _, self.solvers_by_key[key] = self._compiled_or_derived(
                [solver.name()], key, lambda: [solver], deadline
            )
        compiled = self.solvers_by_key[key]
        return lambda: compiled()[0]

    def _compiled_or_derived(
        self, names, key: str, derive: Callable, deadline: Deadline
    ) -> tuple:
        """Return functions, and what returns them compiled, earlier or from now on."""
        origin = _derivation_rule() + key
        if functions := compiled_earlier(names, origin):
            return functions, Compiling(functions)
        began = time.perf_counter()
        functions = derive()
        compiled = start_compilation(functions, origin, deadline, True)
        self.derived += 1
        self.seconds += time.perf_counter() - began
        return functions, compiled


def _may_be_compiled(compiled: Compiling, deadline: Deadline) -> bool:
    """Tell whether there is time now for what an earlier deadline left uncompiled."""
    return compiled.hurried and time_for_compilation(deadline) >= LEAST_COMPILE_TIME


_default = TermFunctionCache()


def default_cache() -> TermFunctionCache:
    """Return the cache that problems of this process use unless given another."""
    return _default


def without_derivatives(
    function: Callable, unknowns: list[int], order: list[tuple]
) -> TermFunction:
    """Return a term function without derivatives: for what is read off a solution."""
    parts = values(expressions_of(function, unknowns, order))
    sizes = parts[1].size1_out(0), *(parts[1].size1_in(k) for k in range(3))
    return TermFunction(*sizes, 0, 0, Compiling(parts))  # roots are written out


def term_function_named(name: str, derive, function, sizes, order) -> TermFunction:
    """Return derive(function, sizes, order); PageError names the term if it fails."""
    try:
        return derive(function, sizes, order)
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


class OfColumns:
    """A function of one column or several at once, for arrays of so many columns.

    One of several is given the last column again until its calls are full.
    """

    def __init__(self, function: ca.Function, columns: int):
        self._columns = columns
        self._filled = np.minimum(np.arange(padded(columns)), columns - 1)
        rows_in = map(function.size1_in, range(function.n_in()))
        rows_out = map(function.size1_out, range(function.n_out()))
        self._inputs, self._results = (
            [np.zeros((len(self._filled), count)) for count in rows]
            for rows in (rows_in, rows_out)
        )
        flat = ([a.ravel() for a in arrays] for arrays in (self._inputs, self._results))
        self._evaluate, self._alive = between_slices(function, columns, *flat)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Return the results, columns as those of the arguments."""
        for mine, given in zip(self._inputs, arguments, strict=True):
            mine[:] = given.T[self._filled]
        self._evaluate()
        return [array[: self._columns].T.copy() for array in self._results]


def padded(instances: int) -> int:
    """Return how many instances fill all calls of functions of several at once."""
    return -(-instances // WIDTH) * WIDTH


def between_slices(function: ca.Function, instances: int, inputs, outputs) -> tuple:
    """Return what applies a function to all instances, and what that needs alive.

    inputs, outputs: slices of arrays that it reads and writes, of `padded` instances.
    """
    width = function.size2_in(0)
    calls = -(-instances // width)
    buffer, evaluate = function.map(calls).buffer()
    for k, array in enumerate(inputs):
        if size := function.size1_in(k) * width * calls:
            buffer.set_arg(k, memoryview(array[:size]))
    for k, array in enumerate(outputs):
        if size := function.size1_out(k) * width * calls:
            buffer.set_res(k, memoryview(array[:size]))
    return evaluate, buffer


@cache
def _derivation_rule() -> str:
    """Return what derivatives follow from, beside the expression of a term."""
    return inspect.getsource(derivatives)


@cache
def _digest(function: ca.Function) -> str:
    return hashlib.sha256(function.serialize().encode()).hexdigest()


def _term_function(parts, compiled: Callable, solver, solve) -> TermFunction:
    """Return the term function of PARTS; outputs of `patterns` are its sparsities."""
    arguments, first, _, patterns = parts
    roots = first.size1_in(2)
    return TermFunction(
        rows=first.size1_out(0),
        unknowns=first.size1_in(0),
        data=first.size1_in(1),
        roots=roots,
        arguments=arguments.size1_out(0),
        equations=roots // solver.size1_out(0) if solver else 0,
        compiled=compiled,
        solver=solve,
        jacobian_sparsity=patterns.sparsity_out(0),
        hessian_sparsity=patterns.sparsity_out(1),
    )
