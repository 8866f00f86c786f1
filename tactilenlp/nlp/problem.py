"""A nonlinear programme of named variables and named terms with exact derivatives.

    minimize    sum over terms and instances of  f_term(z, d)
    subject to  lower <= g_term(z, d) <= upper,  lower <= x <= upper

A term is a small function and the columns of the unknowns that each of its instances
reads.  Its function is derived once, mapped over the instances and summed where it
belongs in the global sparse derivatives: building hardly depends on their number.
Unknowns are in SI units for the page and scaled for the solver here, nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from ..common.brief import printed
from ..common.deadline import NEVER, Deadline
from ..common.named import Named
from ..common.validation import check_kind, check_one_of, numbers_of
from ..errors import PageError
from .assembly import Assembly
from .diagnostics import check, describe
from .nlpsol import Eliminated, objective
from .term_functions import (
    TermFunctionCache,
    default_cache,
    term_function_named,
    without_derivatives,
)
from .terms import (
    Columns,
    Parameter,
    Term,
    Variable,
    apart,
    block,
    check_declared,
    check_owner,
    instances_of,
    limits_of,
    setting,
    table,
)

ROLES = ("likelihood", "physics", "prior", "regulariser")


@printed
@dataclass
class Problem:
    """The programme that a page fills: variables, parameters, costs and constraints."""

    variables: dict[str, Variable] = field(default_factory=partial(Named, "variables"))
    parameters: dict[str, Parameter] = field(
        default_factory=partial(Named, "parameters")
    )
    costs: dict[str, Term] = field(default_factory=dict)
    constraints: dict[str, Term] = field(default_factory=dict)
    reports: dict[str, Term] = field(default_factory=dict)
    dependent: dict[str, np.ndarray] = field(default_factory=dict)  # see `follow`
    functions_by_name: dict = field(default_factory=dict)  # problems may share them
    cache: TermFunctionCache = field(default_factory=default_cache)
    deadline: Deadline = NEVER  # of derivation, compilation, assembly; not of solves
    noting: Callable = nullcontext  # see TermFunctionCache.of
    only: tuple[str, ...] | None = None  # names of terms: others are left out
    _data: list[np.ndarray] = field(default_factory=list)

    # -- what a page says -------------------------------------------------------------
    def variable(
        self, name, rows, columns=1, *, guess, lower=-np.inf, upper=np.inf, unit, scale
    ) -> Variable:
        """Declare unknowns: `guess`, `lower`, `upper` broadcast to (rows, columns).

        One number per row stands for all columns.  `scale` (rows,) is the size of a
        typical change, in the same unit.
        """
        self._new(name, self.variables)
        shape = (rows, columns)
        lower, upper, guess = (block(v, shape, name) for v in (lower, upper, guess))
        if not np.all(lower <= upper) or not np.all(np.isfinite(guess)):
            raise PageError(
                "bounds cross, or the guess is not finite", where=name,
                expected="lower <= upper, and finite guesses",
            )  # fmt: skip
        size = block(scale, (rows, 1), name)[:, 0]
        if not np.all((size > 0) & np.isfinite(size)):
            got, expected = size.tolist(), "finite numbers above zero"
            raise PageError("not a scale", where=name, got=got, expected=expected)
        v = Variable(name, rows, columns, lower, upper, guess, unit, size, self.size)
        return self.variables.setdefault(name, v)

    def parameter(self, name, value, unit="") -> Parameter:
        """Declare a number or vector shared by all instances of the terms it enters."""
        self._new(name, self.parameters)
        value = np.atleast_1d(numbers_of(name, value, PageError))
        first = self._append_data(value)
        return self.parameters.setdefault(name, Parameter(name, value, unit, first))

    def minimize(self, name: str, function: Callable, *arguments, role: str) -> None:
        """Add the sum of `function` over the instances; `role` is one of ROLES."""
        check_one_of(name, role, ROLES, "unknown role", PageError)
        self._add(self.costs, name, function, arguments, role=role)

    def subject_to(
        self, name: str, function: Callable, *arguments, lower=-np.inf, upper=np.inf,
        per: Variable | None = None,
    ) -> None:  # fmt: skip
        """Bound every row of `function` at every instance.

        per: unknowns to whose columns the instances belong, one to each, in order.
        """
        self._add(
            self.constraints, name, function, arguments, per=per, first_row=self.rows,
            lower=lower, upper=upper,
        )  # fmt: skip

    def follow(self, name: str, function: Callable, *arguments, gives: Columns) -> None:
        """Constrain the columns `gives` to be `function` of columns that come before.

        Residuals are in scales of the variable; a level may `eliminate` what is given.
        """
        gives = gives if isinstance(gives, Columns) else gives[:, :]

        def residual(*local):
            return (function(*local[:-1]) - local[-1]) / gives.variable.scale

        self.subject_to(name, residual, *arguments, gives, lower=0, upper=0)
        if name in self.constraints:  # it has instances
            self.dependent[name] = gives.indices

    def report(self, name: str, function: Callable, *arguments) -> None:
        """Name a quantity to be read off a solution; it costs nothing to solve."""
        self._add(self.reports, name, function, arguments, derive=without_derivatives)

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return sum(v.rows * v.columns for v in self.variables.values())

    @property
    def rows(self) -> int:
        """The number of rows of all constraints."""
        return sum(term.rows for term in self.constraints.values())

    @property
    def terms(self) -> dict[str, Term]:
        """All costs and constraints, by name."""
        return Named("terms", {**self.costs, **self.constraints})

    def costs_of(self, *roles: str) -> list[str]:
        """Return the names of the costs of these roles."""
        return [name for name, cost in self.costs.items() if cost.role in roles]

    # -- vectors ----------------------------------------------------------------------
    def data(self, changes: dict | None = None) -> np.ndarray:
        """Return the vector of all data, with some parameters changed by name."""
        data = np.concatenate(self._data) if self._data else np.zeros(0)
        check_declared(changes, self.parameters, "parameter")
        for name, value in (changes or {}).items():
            data[self.parameters[name].span] = setting(value, self.parameters[name])
        return data

    @cached_property
    def scale(self) -> np.ndarray:
        """The scale of each unknown, SI."""
        blocks = [np.tile(v.scale, v.columns) for v in self.variables.values()]
        return np.concatenate([np.zeros(0), *blocks])

    def pack(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """Return the vector of all unknowns in SI; what is not given is the guess."""
        check_declared(values, self.variables, "variable")
        blocks = []
        for v in self.variables.values():
            value = block(values.get(v.name, v.guess), (v.rows, v.columns), v.name)
            blocks.append(value.T.ravel())
        return np.concatenate([np.zeros(0), *blocks])

    def unpack(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Return the unknowns by name, each (rows, columns)."""
        return {
            v.name: x[v.span].reshape(v.columns, v.rows).T.copy()
            for v in self.variables.values()
        }

    def bounds(self, which: str) -> np.ndarray:
        """Return the "lower" or "upper" bounds of all unknowns, SI."""
        blocks = [getattr(v, which).T.ravel() for v in self.variables.values()]
        return np.concatenate([np.zeros(0), *blocks])

    def limits(self, which: str) -> np.ndarray:
        """Return the "lower" or "upper" limits of all constraints."""
        blocks = [getattr(t, which).ravel() for t in self.constraints.values()]
        return np.concatenate([np.zeros(0), *blocks])

    # -- numbers, term by term --------------------------------------------------------
    def value(self, name: str, x: np.ndarray, data: np.ndarray) -> np.ndarray:
        """Evaluate one term at every instance, (instances, rows)."""
        term = Named("terms", {**self.terms, **self.reports})[name]
        return term.evaluated("first", x, data)[0].T

    def jacobian(self, name: str, x: np.ndarray, data: np.ndarray) -> sp.csc_matrix:
        """Return the Jacobian of one term, (instances * rows, unknowns), SI units."""
        term = self.terms[name]
        values = term.evaluated("first", x, data)[1].T.ravel()
        return sp.csc_matrix((values, term.jacobian_places), (term.rows, self.size))

    def hessian(
        self, name: str, x: np.ndarray, data: np.ndarray, multiplier=1.0
    ) -> sp.csc_matrix:
        """Return the Hessian of multiplier' term, (unknowns, unknowns), SI units."""
        term = self.terms[name]
        shape = (term.instances, term.function.rows)
        whole = np.reshape(multiplier, shape) if np.ndim(multiplier) else multiplier
        (nonzeros,) = term.evaluated("second", x, data, np.broadcast_to(whole, shape).T)
        rows, columns, factor = term.hessian_places
        values, off = nonzeros.T.ravel() * factor, rows != columns
        i, j = np.r_[rows, columns[off]], np.r_[columns, rows[off]]
        return sp.csc_matrix((np.r_[values, values[off]], (i, j)), (self.size,) * 2)

    # -- what authors of pages and solvers ask for ------------------------------------
    describe, check, objective = describe, check, objective  # functions, as methods

    @cached_property
    def assembly(self) -> Assembly:
        """The programme in scaled unknowns: values and derivatives as arrays."""
        return Assembly(self)

    @cached_property
    def eliminated(self) -> Eliminated:
        """The programme in the unknowns that no other ones give."""
        return Eliminated(self)

    # -- making terms -----------------------------------------------------------------
    def _new(self, name: str, table: dict) -> None:
        for outdated in ("assembly", "scale", "eliminated"):
            self.__dict__.pop(outdated, None)
        if not isinstance(name, str) or name in table:
            raise PageError("declared twice", where=name, next="give it another name")

    def _append_data(self, values: np.ndarray) -> int:
        self._data.append(np.asarray(values, float).ravel())
        return sum(map(len, self._data[:-1]))

    def _add(
        self, terms, name, function, arguments, role=None, first_row=0, derive=None,
        per=None, **limits,
    ):  # fmt: skip
        """Keep a term among others; what has no instance is left out and costs none."""
        self._new(name, {**self.terms, **self.reports})
        left_out = self.only is not None and name not in self.only
        function, arguments = apart(function, arguments)
        if left_out or not (instances := instances_of(name, arguments)):
            return
        check_kind(f"{name}: per", per, (Variable, type(None)), PageError)
        for argument in (*arguments, per):
            check_owner(self, name, argument)
        if per is not None:
            instances = instances_of(name, [*arguments, per[:, :]])
        unknowns, data, order = [], [], []
        for argument in arguments:
            if isinstance(argument, Columns):
                indices, role_of, read = argument.indices, "z", unknowns
            else:
                indices, role_of, read = self._data_indices(name, argument), "d", data
            read.append(np.broadcast_to(indices, (instances, indices.shape[1])))
            order.append((role_of, indices.shape[1]))
        sizes = [indices.shape[1] for indices in unknowns]
        derived = self._function_of(name, derive, function, sizes, order)
        if role is not None and derived.rows != 1:
            raise PageError(
                "a cost is one number", where=name, got=f"{derived.rows} rows",
                expected="1 row", next="add them up: casadi.sum1(...), casadi.sumsqr",
            )  # fmt: skip
        limits = limits_of(name, (instances, derived.rows), limits)
        read = [
            np.hstack([np.zeros((instances, 0), int), *r]) for r in (unknowns, data)
        ]
        terms[name] = Term(name, derived, role, *read, **limits, first_row=first_row,
                          per=per and per.name)  # fmt: skip

    def _function_of(self, name, derive, function, sizes, order):
        """Return the term function of a term; derive it unless this problem has it."""
        if (key := (name, *order)) not in self.functions_by_name:
            self.deadline.check()
            of = partial(self.cache.of, deadline=self.deadline, noting=self.noting)
            derived = term_function_named(name, derive or of, function, sizes, order)
            self.functions_by_name[key] = derived
        return self.functions_by_name[key]

    def _data_indices(self, name: str, argument) -> np.ndarray:
        if isinstance(argument, Parameter):
            return np.r_[argument.span][None]
        values = table(argument, name)
        return self._append_data(values) + np.arange(values.size).reshape(values.shape)
