"""Functions of arrays as CasADi's solvers take them."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np


class ArrayFunction(ca.Callback):
    """A function of arrays, given nonzeros and returning tuples of them.

    inputs, outputs: patterns of its arguments and results.  Who uses it in an
    expression keeps it alive.
    """

    def __init__(self, name: str, function: Callable, inputs, outputs):
        ca.Callback.__init__(self)
        self._function, self._inputs, self._outputs = function, inputs, outputs
        self.construct(name, {})

    def get_n_in(self):
        return len(self._inputs)

    def get_n_out(self):
        return len(self._outputs)

    def get_sparsity_in(self, i):
        return self._inputs[i]

    def get_sparsity_out(self, i):
        return self._outputs[i]

    def has_eval_buffer(self):
        return True

    def eval_buffer(self, arguments, results):
        given = [
            np.zeros(pattern.nnz()) if one is None else np.frombuffer(one)
            for one, pattern in zip(arguments, self._inputs, strict=True)
        ]  # CasADi's null pointer stands for zeros
        found = self._function(*given)
        for out, values in zip(results, found, strict=True):
            if out is not None:
                np.frombuffer(out)[:] = values
        return 0
