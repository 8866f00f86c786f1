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
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache, partial

import casadi as ca
import numpy as np

from ..common.deadline import NEVER, Deadline
from ..errors import PageError
from .codegen import Compiling, compiled_earlier, start_compilation
from .compilation import LEAST_COMPILE_TIME, time_for_compilation
from .derivation import PARTS, derivatives, expressions_of, values
from .simd import WIDTH

TERM_SIZES = 2  # numbers of instances for which a term function keeps arrays
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
    once, as columns (`MappedFunction`).  rows, unknowns, data, roots, arguments:
    lengths of value, z, d, u, a; equations: how many roots u are; compiled, solver:
    return the functions, waiting for compilers that still run.
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
        u = np.zeros((0, z.shape[1]))
        if self.solver:
            (a,) = self._mapped["arguments"](z, d)
            each = self.arguments // self.equations
            (u,) = self._mapped["roots"](a.reshape((each, -1), order="F"))
            u = u.reshape((self.roots, -1), order="F")
        return self._mapped[name](z, d, u, *weights)

    @cached_property
    def _mapped(self) -> dict[str, MappedFunction]:
        """The functions by their names in PARTS, and "roots", for any number."""
        functions = {name: partial(self.part, name) for name in PARTS}
        functions["roots"] = self.solver
        return {
            name: MappedFunction(function, TERM_SIZES, rounded=int)
            for name, function in functions.items()
        }


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


class MappedFunction:
    """A function of columns, applied to any number of them; each thread has arrays.

    compiled: returns it, after its compiler has ended; sizes: numbers of columns, of
    all threads, for which arrays are kept, each number `rounded`.
    """

    def __init__(
        self, compiled: Callable[[], ca.Function], sizes: int, rounded: Callable
    ):
        self._compiled, self._rounded = compiled, rounded
        self._arrays = lru_cache(sizes)(self._new_arrays)  # with what evaluates them

    def __call__(self, *columns: np.ndarray) -> list[np.ndarray]:
        """Return the results (rows, S); columns: (rows, S), or (rows,) for all."""
        count = max(array.shape[1] for array in columns if array.ndim == 2)
        arrays = self._arrays(threading.get_ident(), self._rounded(count))
        read, written, evaluate, _ = arrays
        for whole, array in zip(read, columns, strict=True):
            whole[:count] = array.T
            whole[count:] = whole[count - 1]
        evaluate()
        return [np.array(whole[:count].T, order="C") for whole in written]  # copies

    def _new_arrays(self, thread: int, count: int) -> tuple:
        """Return arrays for so many columns, what evaluates them, and what it needs."""
        function, rows = self._compiled(), padded(count)
        read = [np.zeros((rows, function.size1_in(k))) for k in range(function.n_in())]
        written = [
            np.zeros((rows, function.size1_out(k))) for k in range(function.n_out())
        ]
        views = ([a.ravel() for a in arrays] for arrays in (read, written))
        return read, written, *between_slices(function, count, *views)


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
