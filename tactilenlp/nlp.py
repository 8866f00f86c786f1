"""A nonlinear programme of named variables and named terms with exact derivatives.

    minimize    sum over terms and instances of  f_term(z, d)
    subject to  lower <= g_term(z, d) <= upper,  lower <= x <= upper

A term is a small function and the columns of the unknowns that each of its instances
reads (DESIGN.md, "The NLP machine").  Its kind is derived once, mapped over the
instances and scattered into the global sparse derivatives by constant matrices, so
that building hardly depends on the number of instances and evaluating is linear in it.
Unknowns are in SI units for the page and scaled for the solver here, nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .errors import PageError
from .kind import Kind, kind_of, mapped, traced

ROLES = ("likelihood", "physics", "prior", "regulariser")


@dataclass(frozen=True, eq=False)
class Variable:
    """A named block of unknowns, `rows` x `columns`; `x[:, k]` picks columns."""

    name: str
    rows: int
    columns: int
    lower: np.ndarray
    upper: np.ndarray
    guess: np.ndarray
    unit: str
    scale: np.ndarray
    first: int

    def __getitem__(self, key) -> Columns:
        rows, columns = key
        if rows != slice(None):
            raise PageError(
                "only whole columns can be picked",
                where=self.name,
                next="write x[:, columns] and index the rows inside the term",
            )
        picked = np.arange(self.columns)[columns]
        return Columns(self, np.atleast_1d(picked))

    @property
    def span(self) -> slice:
        """Where this variable lies in the vector of all unknowns (column by column)."""
        return slice(self.first, self.first + self.rows * self.columns)


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of a variable that the instances of a term read, one each."""

    variable: Variable
    columns: np.ndarray

    @property
    def indices(self) -> np.ndarray:
        """Global indices, (instances, rows)."""
        rows = np.arange(self.variable.rows)
        return self.variable.first + self.columns[:, None] * self.variable.rows + rows


@dataclass(frozen=True, eq=False)
class Parameter:
    """A named number or vector that a level may change without building anew."""

    name: str
    value: np.ndarray
    unit: str
    first: int


@dataclass(frozen=True, eq=False)
class Term:
    """One named cost or constraint: its kind, and what each instance reads."""

    name: str
    kind: Kind
    role: str | None
    unknowns: np.ndarray  # (instances, unknowns) global indices
    data: np.ndarray  # (instances, data) indices into the vector of all data
    lower: np.ndarray | None = None  # (instances, rows), constraints only
    upper: np.ndarray | None = None
    first_row: int = 0

    @property
    def instances(self) -> int:
        return len(self.unknowns)

    @property
    def rows(self) -> int:
        return self.instances * self.kind.rows

    @property
    def span(self) -> slice:
        """The rows of this constraint in the vector of all constraints."""
        return slice(self.first_row, self.first_row + self.rows)


@dataclass
class Problem:
    """The programme that a page fills: variables, parameters, costs and constraints."""

    variables: dict[str, Variable] = field(default_factory=dict)
    parameters: dict[str, Parameter] = field(default_factory=dict)
    costs: dict[str, Term] = field(default_factory=dict)
    constraints: dict[str, Term] = field(default_factory=dict)
    reports: dict[str, Term] = field(default_factory=dict)
    _data: list[np.ndarray] = field(default_factory=list)
    _data_size: int = 0

    # -- what a page says -------------------------------------------------------------
    def variable(
        self, name, rows, columns=1, *, guess, lower=-np.inf, upper=np.inf, unit, scale
    ) -> Variable:
        """Declare unknowns: `guess`, `lower`, `upper` broadcast to (rows, columns).

        `scale` (rows,) is the size of a typical change, in the same unit.
        """
        self._new(name, self.variables)
        shape = (rows, columns)
        lower, upper, guess = (_block(v, shape, name) for v in (lower, upper, guess))
        if np.any(lower > upper) or not np.all(np.isfinite(guess)):
            raise PageError("bounds cross, or the guess is not finite", where=name)
        size = np.broadcast_to(np.asarray(scale, float), (rows,))
        variable = Variable(
            name, rows, columns, lower, upper, guess, unit, size, self.size
        )
        self.variables[name] = variable
        return variable

    def parameter(self, name, value, unit="") -> Parameter:
        """Declare a number or vector shared by all instances of the terms it enters."""
        self._new(name, self.parameters)
        value = np.atleast_1d(np.asarray(value, float))
        parameter = Parameter(name, value, unit, self._append_data(value))
        self.parameters[name] = parameter
        return parameter

    def minimize(self, name: str, function: Callable, *arguments, role: str) -> None:
        """Add the sum of `function` over the instances; `role` is one of ROLES."""
        if role not in ROLES:
            raise PageError(
                "unknown role", where=name, got=role, expected=f"one of {ROLES}"
            )
        term = self._term(name, function, arguments, role=role)
        if term is not None:
            self.costs[name] = term

    def subject_to(
        self, name: str, function: Callable, *arguments, lower=-np.inf, upper=np.inf
    ) -> None:
        """Bound every row of `function` at every instance."""
        term = self._term(
            name, function, arguments, lower=lower, upper=upper, first_row=self.rows
        )
        if term is not None:
            self.constraints[name] = term

    def report(self, name: str, function: Callable, *arguments) -> None:
        """Name a quantity to be read off a solution; it costs nothing to solve."""
        term = self._term(name, function, arguments, trace=traced)
        if term is not None:
            self.reports[name] = term

    # -- sizes ------------------------------------------------------------------------
    @property
    def size(self) -> int:
        return sum(v.rows * v.columns for v in self.variables.values())

    @property
    def rows(self) -> int:
        return sum(term.rows for term in self.constraints.values())

    @property
    def terms(self) -> dict[str, Term]:
        return {**self.costs, **self.constraints}

    # -- vectors ----------------------------------------------------------------------
    def data(self, changes: dict | None = None) -> np.ndarray:
        """Return the vector of all data, with some parameters changed by name."""
        data = np.concatenate(self._data) if self._data else np.zeros(0)
        for name, value in (changes or {}).items():
            if name not in self.parameters:
                raise PageError(
                    "no such parameter", where=name, expected=str([*self.parameters])
                )
            parameter = self.parameters[name]
            data[parameter.first : parameter.first + parameter.value.size] = value
        return data

    @cached_property
    def scale(self) -> np.ndarray:
        blocks = [np.tile(v.scale, v.columns) for v in self.variables.values()]
        return np.concatenate(blocks)

    def pack(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """Return the vector of all unknowns in SI; what is not given is the guess."""
        blocks = []
        for v in self.variables.values():
            given = _block(values.get(v.name, v.guess), (v.rows, v.columns), v.name)
            blocks.append(given.T.ravel())
        return np.concatenate(blocks)

    def unpack(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Return the unknowns by name, each (rows, columns)."""
        return {
            v.name: x[v.span].reshape(v.columns, v.rows).T.copy()
            for v in self.variables.values()
        }

    def bounds(self, which: str) -> np.ndarray:
        return np.concatenate(
            [getattr(v, which).T.ravel() for v in self.variables.values()]
        )

    def limits(self, which: str) -> np.ndarray:
        blocks = [getattr(t, which).ravel() for t in self.constraints.values()]
        return np.concatenate([np.zeros(0), *blocks])

    # -- numbers, term by term --------------------------------------------------------
    def value(self, name: str, x: np.ndarray, data: np.ndarray) -> np.ndarray:
        """Evaluate one term at every instance, (instances, rows)."""
        term = self.terms.get(name) or self.reports[name]
        function = mapped(term.kind.value, term.instances)
        out = function(x[term.unknowns].T, data[term.data].T)
        return np.asarray(out).T.reshape(term.instances, term.kind.rows)

    def jacobian(self, name: str, x: np.ndarray, data: np.ndarray) -> sp.csc_matrix:
        """Return the Jacobian of one term, (instances * rows, unknowns), SI units."""
        term = self.terms[name]
        function = mapped(term.kind.first, term.instances)
        nonzeros = np.asarray(function(x[term.unknowns].T, data[term.data].T)[1])
        rows, columns = _jacobian_places(term)
        shape = (term.rows, self.size)
        return sp.csc_matrix((nonzeros.T.ravel(), (rows, columns)), shape)

    def hessian(
        self, name: str, x: np.ndarray, data: np.ndarray, multiplier=1.0
    ) -> sp.csc_matrix:
        """Return the Hessian of multiplier' term, (unknowns, unknowns), SI units."""
        term = self.terms[name]
        function = mapped(term.kind.second, term.instances)
        shape = (term.instances, term.kind.rows)
        weight = np.broadcast_to(np.reshape(multiplier, (-1, shape[1])), shape)
        nonzeros = function(x[term.unknowns].T, data[term.data].T, weight.T)
        rows, columns, factor = _hessian_places(term)
        values = np.asarray(nonzeros).T.ravel() * factor
        upper = sp.csc_matrix((values, (rows, columns)), (self.size, self.size))
        return upper + sp.triu(upper, 1).T

    # -- symbols for the solver -------------------------------------------------------
    @cached_property
    def functions(self) -> dict:
        """The programme in scaled unknowns as `nlpsol` takes it, with derivatives."""
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", self._data_size)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.rows)
        si = x * ca.DM(self.scale)
        cost, again = ca.MX(0), ca.MX(0)
        gradient, limit, jacobian, hessian = [], [], [], []
        for term in self.terms.values():
            z = _gather(si, term.unknowns)
            d = _gather(p, term.data)
            value, first = mapped(term.kind.first, term.instances)(z, d)
            plain = mapped(term.kind.value, term.instances)(z, d)
            if term.role is None:
                weight = ca.reshape(lam_g[term.span], term.kind.rows, term.instances)
                limit.append((ca.vec(plain), ca.vec(value)))
                jacobian.append((ca.vec(first), *_jacobian_places(term)))
            else:
                weight = ca.repmat(lam_f, term.kind.rows, term.instances)
                cost, again = cost + ca.sum2(plain), again + ca.sum2(value)
                gradient.append((ca.vec(first), *_jacobian_places(term)))
            second = mapped(term.kind.second, term.instances)(z, d, weight)
            hessian.append((ca.vec(second), *_hessian_places(term)))
        symbols, costs = (x, p, lam_f, lam_g), (cost, again)
        return self._assemble(symbols, costs, gradient, limit, jacobian, hessian)

    def _assemble(self, symbols, costs, gradient, limit, jacobian, hessian):
        n, scale = self.size, self.scale
        x, p, lam_f, lam_g = symbols
        grad = ca.MX(n, 1)
        for nonzeros, _, columns in gradient:
            places = (columns, np.zeros_like(columns))
            grad += _scatter(nonzeros, *places, scale[columns], (n, 1), dense=True)
        g = ca.vertcat(ca.MX(0, 1), *(plain for plain, _ in limit))
        g_again = ca.vertcat(ca.MX(0, 1), *(value for _, value in limit))
        starts = [term.first_row for term in self.constraints.values()]
        jac = _collect(
            [
                (v, rows + start, columns, scale[columns])
                for (v, rows, columns), start in zip(jacobian, starts, strict=True)
            ],
            (self.rows, n),
        )
        hess = _collect(
            [
                (v, rows, columns, factor * scale[rows] * scale[columns])
                for v, rows, columns, factor in hessian
            ],
            (n, n),
        )
        return {
            "nlp": {"x": x, "p": p, "f": costs[0], "g": g},
            "grad_f": ca.Function("grad_f", [x, p], [costs[1], grad]),
            "jac_g": ca.Function("jac_g", [x, p], [g_again, jac]),
            "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [hess]),
        }

    # -- making terms -----------------------------------------------------------------
    def _new(self, name: str, table: dict) -> None:
        self.__dict__.pop("functions", None)
        self.__dict__.pop("scale", None)
        if name in table:
            raise PageError("declared twice", where=name, next="give it another name")

    def _append_data(self, values: np.ndarray) -> int:
        first = self._data_size
        self._data.append(np.asarray(values, float).ravel())
        self._data_size += self._data[-1].size
        return first

    def _term(
        self, name, function, arguments, role=None, first_row=0, trace=kind_of, **limits
    ):
        """Return the term, or None if it has no instance (nothing to pay for)."""
        self._new(name, {**self.terms, **self.reports})
        instances = _instances(name, arguments)
        if instances == 0:
            return None
        unknowns, data, order = [], [], []
        for argument in arguments:
            if isinstance(argument, Variable):
                argument = argument[:, :]
            if isinstance(argument, Columns):
                block, role_of = argument.indices, "z"
                unknowns.append(_spread(block, instances))
            else:
                block, role_of = self._data_indices(argument), "d"
                data.append(_spread(block, instances))
            order.append((role_of, block.shape[1]))
        sizes = [block.shape[1] for block in unknowns]
        kind = _trace(name, trace, function, sizes, order)
        if role is not None and kind.rows != 1:
            raise PageError(
                "a cost is one number", where=name, got=kind.rows, expected="1 row"
            )
        shape = (instances, kind.rows)
        limits = {k: np.broadcast_to(v, shape).astype(float) for k, v in limits.items()}
        empty = np.zeros((instances, 0), int)
        unknowns = np.hstack([empty, *unknowns])
        data = np.hstack([empty, *data])
        return Term(name, kind, role, unknowns, data, first_row=first_row, **limits)

    def _data_indices(self, argument) -> np.ndarray:
        if isinstance(argument, Parameter):
            first, shape = argument.first, (1, argument.value.size)
        else:
            block = np.asarray(argument, float)
            block = block.reshape(1, 1) if block.ndim == 0 else block
            block = block[:, None] if block.ndim == 1 else block
            first, shape = self._append_data(block), block.shape
        return first + np.arange(shape[0] * shape[1]).reshape(shape)


def _block(values, shape, name) -> np.ndarray:
    values = np.asarray(values, float)
    if values.ndim == 1 and values.size == shape[0]:
        values = values[:, None]
    try:
        return np.broadcast_to(values, shape).copy()
    except ValueError:
        raise PageError(
            "wrong shape", where=name, got=values.shape, expected=str(shape)
        ) from None


def _instances(name: str, arguments) -> int:
    """Return how many instances the arguments make; one-column arguments broadcast."""
    lengths = []
    for argument in arguments:
        if isinstance(argument, Columns):
            lengths.append(len(argument.columns))
        elif isinstance(argument, Variable):
            lengths.append(argument.columns)
        elif not isinstance(argument, Parameter) and np.ndim(argument) > 0:
            lengths.append(len(argument))
    several = {n for n in lengths if n != 1}
    if len(several) > 1:
        raise PageError(
            "arguments disagree on the number of instances", where=name, got=lengths
        )
    return several.pop() if several else 1


def _spread(block: np.ndarray, instances: int) -> np.ndarray:
    return np.broadcast_to(block, (instances, block.shape[1]))


def _trace(name, trace, function, sizes, order) -> Kind:
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


def _gather(vector: ca.MX, indices: np.ndarray) -> ca.MX:
    flat = [int(i) for i in indices.ravel()]
    return ca.reshape(vector[flat], indices.shape[1], indices.shape[0])


def _jacobian_places(term: Term) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of every local Jacobian nonzero, instance by instance."""
    rows, columns = (np.array(i, int) for i in term.kind.jacobian_sparsity.get_triplet())
    offset = np.arange(term.instances)[:, None] * term.kind.rows
    return (offset + rows).ravel(), term.unknowns[:, columns].ravel()


def _hessian_places(term: Term) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where local upper-triangle nonzeros go in the global upper triangle.

    An off-diagonal entry whose two unknowns are one and the same (merged poses) stands
    for both orders: factor 2.
    """
    rows, columns = (np.array(i, int) for i in term.kind.hessian_sparsity.get_triplet())
    i, j = term.unknowns[:, rows], term.unknowns[:, columns]
    factor = np.where((i == j) & (rows != columns), 2.0, 1.0)
    return np.minimum(i, j).ravel(), np.maximum(i, j).ravel(), factor.ravel()


def _scatter(nonzeros, rows, columns, factors, shape, dense=False) -> ca.MX:
    """Return the matrix whose entries are sums of `nonzeros`, by one sparse product."""
    pattern = sp.csc_matrix((np.ones(len(rows)), (rows, columns)), shape)
    pattern.sort_indices()
    keys = columns.astype(np.int64) * shape[0] + rows
    places, target = np.unique(keys, return_inverse=True)
    count = len(places)
    if dense:
        target, count = rows, shape[0]
    spread = sp.csc_matrix(
        (factors, (target, np.arange(len(rows)))), (count, len(rows))
    )
    matrix = ca.DM(
        ca.Sparsity(count, len(rows), spread.indptr.tolist(), spread.indices.tolist()),
        spread.data,
    )
    values = ca.mtimes(matrix, nonzeros)
    if dense:
        return values
    sparsity = ca.Sparsity(
        *shape, pattern.indptr.tolist(), pattern.indices.tolist()
    )
    return ca.MX(sparsity, values)


def _collect(parts: list[tuple], shape: tuple[int, int]) -> ca.MX:
    """Return the sum of all parts, scattered at once."""
    if not parts:
        return ca.MX(*shape)
    nonzeros = ca.vertcat(*(part[0] for part in parts))
    rows, columns, factors = (
        np.concatenate([part[i] for part in parts]) for i in (1, 2, 3)
    )
    return _scatter(nonzeros, rows, columns, factors, shape)
