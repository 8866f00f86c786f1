"""Hessians without what curves down: Gauss-Newton's matrix, for comparison.

Where residuals are zero, the Hessian of a sum of squares is J'J already; elsewhere its
part that curves down is cut off, instance by instance.  The constraints' own curvature
is left out.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .curvature import Curvature
from .kind import mapped


def without_downward(curvature: Curvature) -> Curvature:
    """Return the curvature with the Hessian of every instance made positive."""
    problem, hessians = curvature.problem, {}
    for name in curvature.hessians:
        hessians[name] = sp.csc_matrix((problem.size, problem.size))
        if name in problem.costs:
            local = local_hessians(curvature, name)
            size = problem.scale[problem.terms[name].unknowns]
            size = size[:, :, None] * size[:, None, :]
            values, vectors = np.linalg.eigh(local * size)
            values = np.maximum(values, 0.0)
            local = np.einsum("iab,ib,icb->iac", vectors, values, vectors) / size
            hessians[name] = scattered(curvature, name, local)
    return curvature.with_hessians(hessians)


def local_hessians(curvature: Curvature, name: str) -> np.ndarray:
    """Return the Hessian of every instance of a term, (instances, z, z), SI."""
    term = curvature.problem.terms[name]
    kind, x, data = term.kind, curvature.x, curvature.data
    weight = curvature.multipliers.get(name, np.ones((term.instances, kind.rows)))
    second = mapped(kind.second, term.instances)
    upper = second(x[term.unknowns].T, data[term.data].T, weight.T)
    i, j = (np.array(p, int) for p in kind.hessian_sparsity.get_triplet())
    local = np.zeros((term.instances, term.unknowns.shape[1], term.unknowns.shape[1]))
    local[:, i, j] = local[:, j, i] = np.asarray(upper).T
    return local


def scattered(curvature: Curvature, name: str, local) -> sp.csc_matrix:
    """Return the sum of local matrices (instances, z, z) at their places."""
    problem = curvature.problem
    unknowns = problem.terms[name].unknowns
    rows = np.broadcast_to(unknowns[:, :, None], local.shape).ravel()
    columns = np.broadcast_to(unknowns[:, None, :], local.shape).ravel()
    return sp.csc_matrix((local.ravel(), (rows, columns)), (problem.size,) * 2)
