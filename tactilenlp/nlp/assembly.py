"""Assemble the terms of a programme into the sparse functions that `nlpsol` takes.

The function of a term is mapped over its instances; the results are summed where they
belong in gradient, Jacobian and Hessian of the Lagrangian, in scaled unknowns.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..common.deadline import NEVER, Deadline
from .term_functions import mapped


def assemble(
    terms, scale: np.ndarray, data: int, rows: int, deadline: Deadline = NEVER
) -> dict:
    """Return `nlp` (expressions) and `grad_f`, `jac_g`, `hess_lag` (functions).

    terms: costs, then constraints in the order of their rows; scale (unknowns,);
    data, rows: how many numbers all terms read, how many rows are constrained.  A
    strict deadline ends it between two terms: large problems take seconds.
    """
    n = len(scale)
    x, p = ca.MX.sym("x", n), ca.MX.sym("p", data)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    si = x * ca.DM(scale)
    cost, again, grad = ca.MX(0), ca.MX(0), ca.MX(n, 1)
    g, g_again, jacobian, hessian = [ca.MX(0, 1)], [ca.MX(0, 1)], [], []
    for term in terms:
        deadline.check()
        z, d = _gather(si, term.unknowns), _gather(p, term.data)
        value, first = mapped(term.function.first, term.instances)(z, d)
        plain = mapped(term.function.value, term.instances)(z, d)
        row, column = term.jacobian_places()
        first = ca.vec(_times(first, scale[column]))
        if term.role is None:
            weight = ca.reshape(lam_g[term.span], term.function.rows, term.instances)
            g.append(ca.vec(plain))
            g_again.append(ca.vec(value))
            jacobian.append((first, row + term.first_row, column))
        else:
            weight = ca.repmat(lam_f, term.function.rows, term.instances)
            cost, again = cost + ca.sum2(plain), again + ca.sum2(value)
            grad += _summed(first, column, n)
        second = mapped(term.function.second, term.instances)(z, d, weight)
        i, j, factor = term.hessian_places()
        second = ca.vec(_times(second, scale[i] * scale[j]))
        hessian.append((_doubled(second, factor > 1), i, j))
    grad = ca.densify(grad)  # the solver's interface copies nonzeros in a row
    jac = _scattered(jacobian, (rows, n))
    deadline.check()
    hess = _scattered(hessian, (n, n))
    return {
        "nlp": {"x": x, "p": p, "f": cost, "g": ca.vertcat(*g)},
        "grad_f": ca.Function("grad_f", [x, p], [again, grad]),
        "jac_g": ca.Function("jac_g", [x, p], [ca.vertcat(*g_again), jac]),
        "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [hess]),
    }


def _gather(vector: ca.MX, indices: np.ndarray) -> ca.MX:
    flat = vector[indices.ravel().tolist()]
    return ca.reshape(flat, indices.shape[1], indices.shape[0])


def _times(nonzeros: ca.MX, factors: np.ndarray) -> ca.MX:
    """Return nonzeros (k, instances) times factors, which every instance shares.

    They do because an instance reads whole columns of the same variables as any other.
    """
    k, instances = nonzeros.shape
    return nonzeros * ca.repmat(ca.DM(factors[:k]), 1, instances)


def _doubled(nonzeros: ca.MX, chosen: np.ndarray) -> ca.MX:
    """Return the nonzeros, of which the chosen ones count twice."""
    if chosen.any():
        nonzeros[np.nonzero(chosen)[0].tolist()] *= 2
    return nonzeros


def _summed(nonzeros: ca.MX, target: np.ndarray, count: int) -> ca.MX:
    """Return (count,) sums of the nonzeros of each target: a gather, transposed."""
    sums = ca.MX.sym("sums", count)
    return ca.jtimes(sums[target.tolist()], sums, nonzeros, True)


def _scattered(parts: list[tuple], shape: tuple[int, int]) -> ca.MX:
    """Return the matrix with the nonzeros at (row, column), summed, of all parts.

    A place that several nonzeros share is one nonzero of the result.
    """
    if not parts:
        return ca.MX(*shape)
    nonzeros = ca.vertcat(*(part[0] for part in parts))
    rows, columns = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
    keys = columns.astype(np.int64) * shape[0] + rows  # column by column, as CasADi's
    places, target = np.unique(keys, return_inverse=True)
    column, row = np.divmod(places, shape[0])
    start = np.searchsorted(column, np.arange(shape[1] + 1))
    sparsity = ca.Sparsity(*shape, start.tolist(), row.tolist())
    return ca.MX(sparsity, _summed(nonzeros, target, len(places)))
