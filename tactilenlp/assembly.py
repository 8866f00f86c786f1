"""Assemble the terms of a programme into the sparse functions that `nlpsol` takes.

Every term's kind is mapped over its instances; constant matrices scatter the results
into gradient, Jacobian and Hessian of the Lagrangian, in scaled unknowns.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .kind import mapped


def assemble(terms, scale: np.ndarray, data: int, rows: int) -> dict:
    """Return `nlp` (expressions) and `grad_f`, `jac_g`, `hess_lag` (functions).

    terms: costs, then constraints in the order of their rows; scale (unknowns,);
    data, rows: how many numbers all terms read, how many rows are constrained.
    """
    n = len(scale)
    x, p = ca.MX.sym("x", n), ca.MX.sym("p", data)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    si = x * ca.DM(scale)
    cost, again, grad = ca.MX(0), ca.MX(0), ca.MX(n, 1)
    g, g_again, jacobian, hessian = [ca.MX(0, 1)], [ca.MX(0, 1)], [], []
    for term in terms:
        z, d = _gather(si, term.unknowns), _gather(p, term.data)
        value, first = mapped(term.kind.first, term.instances)(z, d)
        plain = mapped(term.kind.value, term.instances)(z, d)
        row, column = term.jacobian_places()
        if term.role is None:
            weight = ca.reshape(lam_g[term.span], term.kind.rows, term.instances)
            g.append(ca.vec(plain))
            g_again.append(ca.vec(value))
            row = row + term.first_row
            jacobian.append((ca.vec(first), row, column, scale[column]))
        else:
            weight = ca.repmat(lam_f, term.kind.rows, term.instances)
            cost, again = cost + ca.sum2(plain), again + ca.sum2(value)
            grad += _summed(ca.vec(first), column, scale[column], n)
        second = mapped(term.kind.second, term.instances)(z, d, weight)
        i, j, factor = term.hessian_places()
        hessian.append((ca.vec(second), i, j, factor * scale[i] * scale[j]))
    grad = ca.densify(grad)  # the solver's interface copies nonzeros in a row
    jac, hess = _scattered(jacobian, (rows, n)), _scattered(hessian, (n, n))
    lagrange = [x, p, lam_f, lam_g]
    return {
        "nlp": {"x": x, "p": p, "f": cost, "g": ca.vertcat(*g)},
        "grad_f": ca.Function("grad_f", [x, p], [again, grad]),
        "jac_g": ca.Function("jac_g", [x, p], [ca.vertcat(*g_again), jac]),
        "hess_lag": ca.Function("hess_lag", lagrange, [hess]),
    }


def _gather(vector: ca.MX, indices: np.ndarray) -> ca.MX:
    flat = [int(i) for i in indices.ravel()]
    return ca.reshape(vector[flat], indices.shape[1], indices.shape[0])


def _summed(nonzeros: ca.MX, target, factors, count: int) -> ca.MX:
    """Return (count,) sums of factor times nonzero, by one sparse product."""
    k = len(target)
    spread = sp.csc_matrix((factors, (target, np.arange(k))), (count, k))
    columns = spread.indptr.tolist(), spread.indices.tolist()
    return ca.mtimes(ca.DM(ca.Sparsity(count, k, *columns), spread.data), nonzeros)


def _scattered(parts: list[tuple], shape: tuple[int, int]) -> ca.MX:
    """Return the matrix with factor times nonzero at (row, column), summed, all parts.

    A place that several nonzeros share is one nonzero of the result.
    """
    if not parts:
        return ca.MX(*shape)
    nonzeros = ca.vertcat(*(part[0] for part in parts))
    rows, columns, factors = (
        np.concatenate([part[i] for part in parts]) for i in (1, 2, 3)
    )
    pattern = sp.csc_matrix((np.ones(len(rows)), (rows, columns)), shape)
    pattern.sort_indices()
    keys = columns.astype(np.int64) * shape[0] + rows  # column by column, as CasADi's
    places, target = np.unique(keys, return_inverse=True)
    values = _summed(nonzeros, target, factors, len(places))
    sparsity = ca.Sparsity(*shape, pattern.indptr.tolist(), pattern.indices.tolist())
    return ca.MX(sparsity, values)
