"""The factorised KKT matrix of a solved problem."""

import numpy as np
import pytest
import scipy.sparse as sp

from tactilenlp import Problem
from tactilenlp.nlp.kkt import LEAST_CURVATURE, factorise, kkt_system_of
from tactilenlp.solvers.solve import solve


def chain(samples: int, shared: int, seed: int = 0):
    """Return H and A of a chain of poses (3,) that all read a few shared unknowns."""
    rng = np.random.default_rng(seed)
    n = 3 * samples + shared
    step = sp.lil_array((n, n))
    for t in range(samples - 1):
        here = slice(3 * t, 3 * t + 6)
        J = rng.normal(size=(4, 6))
        step[here, here] += J.T @ J
    J = rng.normal(size=(n, shared))
    step[:, n - shared :] += J
    step[n - shared :, :] += J.T
    step[n - shared :, n - shared :] += samples * np.eye(shared)
    A = sp.lil_array((samples // 2, n))
    for row in range(samples // 2):
        A[row, 6 * row + rng.integers(3)] = 1.0
    return sp.csc_matrix(step), sp.csc_matrix(A)


@pytest.mark.parametrize("shared", [0, 4])
def test_a_factorised_chain_answers_like_the_dense_matrix(shared):
    H, A = chain(60, shared)
    n, m = H.shape[0], A.shape[0]
    K = np.block(
        [
            [H.toarray() + LEAST_CURVATURE * np.eye(n), A.T.toarray()],
            [A.toarray(), -LEAST_CURVATURE * np.eye(m)],
        ]
    )
    right = np.random.default_rng(1).normal(size=(n + m, 2))
    wanted = np.linalg.solve(K, right)
    saddle = factorise(H, A)
    assert len(saddle.border) == shared
    # both lose the digits that the condition of K takes
    tolerance = 1e-15 * np.linalg.cond(K) * abs(wanted).max()
    np.testing.assert_allclose(saddle.solve(right), wanted, atol=tolerance)
    np.testing.assert_allclose(saddle.solve(right[:, 0]), wanted[:, 0], atol=tolerance)


def test_factors_grow_as_the_samples_do():
    entries = [factorise(*chain(samples, 4)).core.nnz for samples in (100, 400)]
    assert entries[1] < 4.5 * entries[0]


def test_an_unknown_that_a_solve_held_does_not_vary():
    nlp = Problem()
    u = nlp.variable("u", 2, guess=0.0, unit="m", scale=1.0)
    nlp.minimize(
        "cost", lambda u: 50 * ((u[0] - u[1]) ** 2 + (u[1] - 3) ** 2), u, role="prior"
    )
    held = solve(nlp, start={"u": [[1.0], [2.0]]}, fixed=(np.array([0]),))
    assert held.held["u"].ravel().tolist() == [True, False]
    kkt = kkt_system_of(nlp, held)
    np.testing.assert_allclose(kkt.marginal("u"), [[0, 0], [0, 0.005]], atol=1e-9)
    assert kkt.active["bounds of u"] == 1
    assert not solve(nlp).held
