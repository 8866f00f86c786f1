"""What a programme is made of: variables, columns of them, parameters, terms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from casadi import vertcat

from ..common.validation import check_one_of, is_whole, numbers_of
from ..errors import PageError, shortened
from .term_functions import TermFunction

LARGEST_BLOCK = 1_000_000  # [1] rows or columns of a variable


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

    def pick(self, rows) -> Variable:
        """Return what the chosen instances read: all of it, like any other."""
        return self

    def __getitem__(self, key) -> Columns:
        rows, columns = key if isinstance(key, tuple) and len(key) == 2 else (key, None)
        if not isinstance(rows, slice) or rows != slice(None) or columns is None:
            raise PageError(
                "only whole columns x[:, k] can be picked", where=self.name,
                next="index rows inside the term",
            )  # fmt: skip
        try:
            picked = np.arange(self.columns)[columns]
        except IndexError as error:
            raise PageError(
                "no such columns", where=self.name, got=str(error),
                expected=f"numbers below {self.columns}",
            ) from error  # fmt: skip
        return Columns(self, np.atleast_1d(picked))

    @property
    def span(self) -> slice:
        """Where this variable lies in the vector of all unknowns (column by column)."""
        return slice(self.first, self.first + self.rows * self.columns)


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of a variable that the instances of a term read, one or k each.

    columns: (instances,) or (instances, k); k columns are read one below the other.
    """

    variable: Variable
    columns: np.ndarray

    def pick(self, rows) -> Columns:
        """Return what the chosen instances read."""
        return Columns(self.variable, self.columns[rows])

    def below(self, data: np.ndarray) -> Joined:
        """Return an argument: data (instances, numbers), and these unknowns below."""
        return Joined(data, self)

    @property
    def indices(self) -> np.ndarray:
        """Global indices, (instances, k rows)."""
        rows = np.arange(self.variable.rows)
        first = self.variable.first + self.columns[..., None] * self.variable.rows
        width = int(np.prod(self.columns.shape[1:])) * len(rows)  # also of no instance
        return (first + rows).reshape(len(self.columns), width)


@dataclass(frozen=True, eq=False)
class Joined:
    """Data (instances, numbers) and unknowns that a term reads as one vector."""

    data: np.ndarray
    unknowns: Columns

    def __len__(self) -> int:
        return len(self.data)

    def __getitem__(self, rows) -> Joined:
        """Return what the chosen instances read."""
        return Joined(self.data[rows], self.unknowns.pick(rows))


@dataclass(frozen=True, eq=False)
class Parameter:
    """A named number or vector that a level may change without building anew."""

    name: str
    value: np.ndarray
    unit: str
    first: int

    @property
    def span(self) -> slice:
        """Where this parameter lies in the vector of all data."""
        return slice(self.first, self.first + self.value.size)


@dataclass(frozen=True, eq=False)
class Term:
    """One named cost or constraint: its function, and what each instance reads.

    per: name of the unknowns to whose columns the instances belong, one to each.
    """

    name: str
    function: TermFunction
    role: str | None
    unknowns: np.ndarray  # (instances, unknowns) global indices
    data: np.ndarray  # (instances, data) indices into the vector of all data
    lower: np.ndarray | None = None  # (instances, rows), constraints only
    upper: np.ndarray | None = None
    first_row: int = 0
    per: str | None = None

    @property
    def instances(self) -> int:
        return len(self.unknowns)

    @property
    def rows(self) -> int:
        return self.instances * self.function.rows

    @property
    def span(self) -> slice:
        """The rows of this constraint in the vector of all constraints."""
        return slice(self.first_row, self.first_row + self.rows)

    def evaluated(self, part: str, x, data, *weights) -> list[np.ndarray]:
        """Return what a part of the function returns, a column for every instance."""
        z, d = x[self.unknowns].T, data[self.data].T
        return self.function.evaluated(part, z, d, *weights)

    @cached_property
    def jacobian_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Return row and column of every local Jacobian nonzero, by instance."""
        rows, columns = np.array(self.function.jacobian_sparsity.get_triplet(), int)
        offset = np.arange(self.instances)[:, None] * self.function.rows
        return (offset + rows).ravel(), self.unknowns[:, columns].ravel()

    @cached_property
    def hessian_places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where local upper-triangle nonzeros go in the global upper triangle.

        An off-diagonal entry whose two unknowns are one and the same (merged poses)
        stands for both orders: factor 2.
        """
        rows, columns = np.array(self.function.hessian_sparsity.get_triplet(), int)
        i, j = self.unknowns[:, rows], self.unknowns[:, columns]
        factor = np.where((i == j) & (rows != columns), 2.0, 1.0)
        return np.minimum(i, j).ravel(), np.maximum(i, j).ravel(), factor.ravel()


def check_owner(problem, name: str, argument) -> None:
    """Raise PageError if a term's argument was declared in another problem."""
    owner = getattr(argument, "variable", argument)
    if not isinstance(owner, Variable | Parameter):
        return
    declared = problem.variables if isinstance(owner, Variable) else problem.parameters
    if declared.get(owner.name) is not owner:
        what, fix = f"{owner.name} belongs to another problem", "declare it in this one"
        raise PageError(what, where=name, next=fix)


def block(values, shape: tuple[int, int], name: str) -> np.ndarray:
    """Return values as (rows, columns); one number per row fills its columns."""
    if not all(is_whole(n) and 0 <= n <= LARGEST_BLOCK for n in shape):
        raise PageError(
            "no size of a block", where=name, got=shortened(shape, most=80),
            expected=f"(rows, columns), whole numbers to {LARGEST_BLOCK}",
        )  # fmt: skip
    values = numbers_of(name, values, PageError)
    if values.ndim == 1 and values.size == shape[0]:
        values = values[:, None]
    return _broadcast(values, shape, name, "wrong shape")


def _broadcast(values, shape: tuple[int, int], name: str, what: str) -> np.ndarray:
    """Return values as a new array of a shape; PageError, what is wrong, if not."""
    try:
        return np.broadcast_to(values, shape).astype(float)
    except ValueError:
        got, expected = np.shape(values), str(shape)
        raise PageError(what, where=name, got=got, expected=expected) from None


def table(values, name: str) -> np.ndarray:
    """Return data as a table (instances, numbers); a list is one number an instance."""
    values = numbers_of(name, values, PageError)
    if values.ndim > 2 or np.isnan(values).any():
        raise PageError(
            "not data",
            where=name, got=f"shape {values.shape}, {np.isnan(values).sum()} NaN",
            expected="(instances,) or (instances, numbers), no NaN",
            next="flatten matrices, one row an instance; pick the valid rows",
        )  # fmt: skip
    return values.reshape(-1, 1) if values.ndim < 2 else values


def setting(values, parameter: Parameter) -> np.ndarray:
    """Return a new value of a parameter as it lies in the data."""
    values, size = numbers_of(parameter.name, values, PageError), parameter.value.size
    if values.size not in (1, size) or np.isnan(values).any():
        raise PageError(
            "not a value of this parameter",
            where=parameter.name, got=values.tolist(), expected=f"{size} numbers",
        )  # fmt: skip
    return np.broadcast_to(values.ravel(), size)


def check_declared(names, declared: dict, what: str) -> None:
    """Raise PageError for the first name that is not declared."""
    fix = "declare it in `build`"
    for name in names or ():
        check_one_of(name, name, declared, f"no such {what}", PageError, next=fix)


def instances_of(name: str, arguments) -> int:
    """Return how many instances the arguments make; one-column arguments broadcast."""
    lengths = []
    for argument in arguments:
        if isinstance(argument, Columns):
            lengths.append(len(argument.columns))
        elif not isinstance(argument, Parameter) and np.ndim(argument) > 0:
            lengths.append(len(argument))
    several = {n for n in lengths if n != 1}
    if len(several) > 1:
        raise PageError(
            "arguments disagree on the number of instances", where=name, got=lengths,
            next="pick as many columns of each, or one that all instances share",
        )  # fmt: skip
    return several.pop() if several else 1


def apart(function: Callable, arguments) -> tuple[Callable, list]:
    """Return a function of the parts of all arguments, and these parts.

    The parts of a joined argument reach `function` as one vector, those of a named
    tuple as a named tuple, None in it as None.  A whole variable becomes its columns.
    """
    parts = [part for argument in arguments for part in _parts(argument)]

    def of_parts(*locals_of_parts):
        left = iter(locals_of_parts)
        return function(*(_whole(argument, left) for argument in arguments))

    return of_parts, parts


def _parts(argument) -> list:
    """Return the arguments of which a joined one, or a named tuple, consists."""
    if isinstance(argument, Joined):
        return [argument.data, argument.unknowns]
    if hasattr(argument, "_fields"):
        return [part for a in argument if a is not None for part in _parts(a)]
    return [argument[:, :] if isinstance(argument, Variable) else argument]


def _whole(argument, left):
    """Return an argument as its function reads it, from the parts that are left."""
    if isinstance(argument, Joined):
        return vertcat(next(left), next(left))
    if hasattr(argument, "_fields"):
        fields = (None if a is None else _whole(a, left) for a in argument)
        return type(argument)(*fields)
    return next(left)


def limits_of(name: str, shape: tuple[int, int], limits: dict) -> dict:
    """Return lower and upper limits as arrays (instances, rows); PageError if wrong."""
    wrong = "wrong shape of a limit"
    arrays = {k: _broadcast(v, shape, name, wrong) for k, v in limits.items()}
    most = np.finfo(float).max  # a lower limit of infinity leaves no number either
    low, high = arrays.get("lower", 0), arrays.get("upper", 0)
    if not np.all(np.maximum(low, -most) <= np.minimum(high, most)):
        raise PageError("limits cross, or NaN", where=name, expected="lower <= upper")
    if arrays and np.isinf([*arrays.values()]).all():
        raise PageError(
            "a constraint without limits", where=name, got="none",
            expected="a finite lower or upper limit",
            next="give lower=, upper= or both; lower=0, upper=0 is an equation",
        )  # fmt: skip
    return arrays
