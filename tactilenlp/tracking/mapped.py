"""Functions of one body, applied to many at once: a column for each.

They are compiled for several columns at once where there is a compiler
(nlp/codegen.py), beside this process; else CasADi's virtual machine evaluates them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import partial

import casadi as ca

from ..nlp.codegen import compiled_earlier, start_compilation
from ..nlp.term_functions import MappedFunction, padded

SIZES = 64  # numbers of columns, of all threads, for which arrays are kept


def map_columns(
    names: Sequence[str], origin: ca.Function, derive: Callable[[], list[ca.Function]]
) -> list[MappedFunction]:
    """Return the functions that `derive` returns, compiled for several columns.

    names: of these functions; origin: all expressions from which derive makes them,
    with what these take from other modules, such as constants; derive's own module is
    read as text.  They are not derived where both are as in an earlier compilation.
    """
    mapped = partial(MappedFunction, sizes=SIZES, rounded=padded)
    text = inspect.getsource(inspect.getmodule(derive)) + origin.serialize()
    if functions := compiled_earlier(names, text):
        return [mapped(lambda one=one: one) for one in functions]
    compiled = start_compilation(derive(), text, vectors=True)
    return [mapped(lambda k=k: compiled()[k]) for k in range(len(names))]


def of_columns(name: str, arguments, results) -> ca.Function:
    """Return the function of expressions, of dense columns alone."""
    results = [ca.densify(one) for one in results]
    return ca.Function(name, [*arguments], results, {"cse": True})
