"""A programme as functions of arrays, and the points where they are evaluated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from .condensed_kkt import CondensedKkt


class Programme:
    """A programme as functions of arrays; functions: as nlp.assembly makes them."""

    def __init__(self, functions: dict):
        self._first, self._rows, self._second = (
            _Buffered(functions[name]) for name in ("grad_f", "jac_g", "hess_lag")
        )
        upper = ca.triu(functions["hess_lag"].sparsity_out(0))
        self.kkt = CondensedKkt(upper, functions["jac_g"].sparsity_out(1))

    def evaluated(self, x: np.ndarray, data: np.ndarray) -> tuple:
        """Return f, its gradient, g and the nonzeros of its Jacobian."""
        f, gradient = self._first(x, data)
        g, jacobian = self._rows(x, data) if self.kkt.shape[0] else (np.zeros(0),) * 2
        return f[0], gradient.copy(), g.copy(), jacobian.copy()

    def hessian(self, x, data, y) -> np.ndarray:
        """Return the nonzeros of the upper triangle of that of f + y' g."""
        return self._second(x, data, 1.0, y)[0]


class _Buffered:
    """A CasADi function that reads and writes arrays in place."""

    def __init__(self, function: ca.Function):
        self._buffer, self._evaluate = function.buffer()
        self._in = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self._out = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, array in enumerate(self._in):
            if array.size:
                self._buffer.set_arg(k, memoryview(array))
        for k, array in enumerate(self._out):
            if array.size:
                self._buffer.set_res(k, memoryview(array))

    def __call__(self, *arguments) -> list[np.ndarray]:
        for array, argument in zip(self._in, arguments, strict=True):
            array[:] = argument
        self._evaluate()
        return self._out


@dataclass(frozen=True)
class Point:
    """w = (x, s), with f, its gradient, g, nonzeros of J, distances from the bounds."""

    w: np.ndarray
    f: float
    gradient: np.ndarray
    g: np.ndarray
    jacobian: np.ndarray
    below: np.ndarray
    above: np.ndarray

    @cached_property
    def residual(self) -> np.ndarray:
        return self.g - self.w[len(self.gradient) :]

    @cached_property
    def violation(self) -> float:
        return np.abs(self.residual).sum()

    def barrier(self, mu: float) -> float:
        return self.f - mu * (np.log(self.below).sum() + np.log(self.above).sum())
