"""Functions of one body, applied to many at once: a column for each.

They are compiled for several columns at once where there is a compiler
(nlp/codegen.py), beside this process; else CasADi's virtual machine evaluates them.
"""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from ..nlp.codegen import compiled_earlier, start_compilation
from ..nlp.term_functions import between_slices, padded

SIZES = 64  # numbers of columns, of all threads, for which arrays are kept


class MappedFunction:
    """A function of columns, applied to any number of them; each thread has arrays.

    compiled: returns it, after its compiler has ended.
    """

    def __init__(self, compiled: Callable[[], ca.Function]):
        self._compiled = compiled
        self._arrays = lru_cache(SIZES)(self._new_arrays)  # with what evaluates them

    def __call__(self, *columns: np.ndarray) -> list[np.ndarray]:
        """Return the results (rows, S); columns: (rows, S), or (rows,) for all."""
        count = max(array.shape[1] for array in columns if array.ndim == 2)
        read, written, evaluate, _ = self._arrays(threading.get_ident(), padded(count))
        for whole, array in zip(read, columns, strict=True):
            whole[:count] = array.T
            whole[count:] = whole[count - 1]
        evaluate()
        return [np.array(whole[:count].T, order="C") for whole in written]  # copies

    def _new_arrays(self, thread: int, count: int) -> tuple:
        """Return arrays for so many columns, what evaluates them, and what it needs."""
        function = self._compiled()
        read = [np.zeros((count, function.size1_in(k))) for k in range(function.n_in())]
        written = [
            np.zeros((count, function.size1_out(k))) for k in range(function.n_out())
        ]
        views = ([a.ravel() for a in arrays] for arrays in (read, written))
        return read, written, *between_slices(function, count, *views)


def map_columns(
    names: Sequence[str], origin: ca.Function, derive: Callable[[], list[ca.Function]]
) -> list[MappedFunction]:
    """Return the functions that `derive` returns, compiled for several columns.

    names: of these functions; origin: all expressions from which derive makes them,
    with what these take from other modules, such as constants; derive's own module is
    read as text.  They are not derived where both are as in an earlier compilation.
    """
    text = inspect.getsource(inspect.getmodule(derive)) + origin.serialize()
    if functions := compiled_earlier(names, text):
        return [MappedFunction(lambda one=one: one) for one in functions]
    compiled = start_compilation(derive(), text, vectors=True)
    return [MappedFunction(lambda k=k: compiled()[k]) for k in range(len(names))]


def of_columns(name: str, arguments, results) -> ca.Function:
    """Return the function of expressions, of dense columns alone."""
    results = [ca.densify(one) for one in results]
    return ca.Function(name, [*arguments], results, {"cse": True})
