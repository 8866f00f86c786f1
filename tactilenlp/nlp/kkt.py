r"""The KKT system of a problem at a point: sensitivities, covariances, a Newton step.

With L the Lagrangian and A the Jacobian of the active constraints and bounds,

    K [ dx ]   [ right ]         K = [ H + l 1    A'  ]      H = nabla^2 L  (exact)
      [ dl ] = [   0   ]             [   A      - l 1 ]

where a small l keeps unobserved directions from making K singular (LEAST_CURVATURE).
One sparse factorisation of K gives the covariance of any unknowns (the block of K^{-1}:
the Hessian reduced to the null space of A, every other unknown marginalised), the
parametric sensitivities (how the solution changes with data, weights or limits), and
the step of Newton's method.

The unknowns of a sample are coupled to those of its neighbours and to a few that all
samples share (sizes, depth of touch).  Eliminated together with the rest, the shared
ones would fill the factors in; so they form the border and are solved for last, by the
Schur complement S, in time linear in the samples:

    K = [ C  B ]       S = D - B' C^{-1} B
        [ B' D ]
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..common.deadline import NEVER, Deadline

LEAST_LENGTH = 1e-12  # [-] of a row of A that is divided by its length
LEAST_CURVATURE = 1e-9  # [1 / scaled unknown^2] l, far below that of measured unknowns
BORDER_ENTRIES = 4.0  # [-] times the entries of the median column: part of the border
NO_WEIGHTS: Mapping[str, np.ndarray] = {}
AMBIGUOUS = 1e2  # [-] ratio of multiplier and slack up to which activity is ambiguous
ACTIVE_PENALTY = 1e6  # [-] times A'A, against scaled Hessians whose entries are near 1
LEAST_NEGATIVE = 1e-10  # [-] of the largest |entry| of H: smaller is rounding
SHIFT_GROWTH = 4.0  # [-] factor of a shift that leaves a matrix indefinite
INVERSE_ITERATIONS = 40  # enough for two digits of the lowest eigenvector


def gradient(problem, x, data, names, weights=NO_WEIGHTS) -> np.ndarray:
    """Return the gradient (unknowns,) of a sum of terms at x (unknowns,), both SI.

    names: of the terms; weights: of their rows (instances, rows), by name; others 1.
    """
    g = np.zeros(problem.size)
    for name in names:
        term = problem.terms[name]
        rows, columns = term.jacobian_places
        slopes = term.evaluated("first", x, data)[1].T.ravel()
        weight = np.broadcast_to(np.ravel(weights.get(name, 1.0)), term.rows)
        g += np.bincount(columns, slopes * weight[rows], problem.size)
    return g


@dataclass(frozen=True, eq=False)
class BorderedFactors:
    """The factors of K: `solve` takes right sides (n + m,) or (n + m, k).

    inner, border: indices of the rows of C and of D; core: LU factors of C; reach:
    C^{-1} B.
    """

    inner: np.ndarray
    border: np.ndarray
    core: object
    B: np.ndarray
    reach: np.ndarray
    S: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return K^{-1} right, to the accuracy of the factors."""
        answer = np.empty(right.shape)
        inner = self.core.solve(np.ascontiguousarray(right[self.inner]))
        answer[self.border] = np.linalg.solve(
            self.S, right[self.border] - self.B.T @ inner
        )
        answer[self.inner] = inner - self.reach @ answer[self.border]
        return answer


def read_by_many(counts: np.ndarray) -> np.ndarray:
    """Return which rows, of these counts of entries, belong to the border."""
    return counts > BORDER_ENTRIES * np.median(counts)


def factorise(H, A) -> BorderedFactors:
    """Factorise K of scaled H (n, n), symmetric, and A (m, n), rows of unit length."""
    n, m = H.shape[0], A.shape[0]
    H, floor = H + LEAST_CURVATURE * sp.identity(n), -LEAST_CURVATURE * sp.identity(m)
    K = sp.bmat([[H, A.T], [A, floor]], format="csc")
    wide = read_by_many(np.diff(K.indptr))
    inner, border = np.nonzero(~wide)[0], np.nonzero(wide)[0]
    core = splu(K[inner][:, inner].tocsc())
    B, D = K[inner][:, border].toarray(), K[border][:, border].toarray()
    reach = core.solve(B)
    return BorderedFactors(inner, border, core, B, reach, D - B.T @ reach)


@dataclass(frozen=True, eq=False)
class KKTSystem:
    """The second derivatives of a problem at a point, by term, and its active set.

    x (unknowns,) SI; data; multipliers: by constraint; A (active, unknowns): scaled
    Jacobian of the active constraints, then bounds, rows of unit length; rows, lengths
    (active constraints,): their indices among all constraint rows, and the lengths by
    which they were divided; active, ambiguous: number of such rows by constraint or
    bound; curvature (unknowns, unknowns): of the Lagrangian, in scaled unknowns; fixed
    (unknowns,): mask of those at an active bound.
    """

    problem: object
    x: np.ndarray
    data: np.ndarray
    multipliers: dict[str, np.ndarray]
    A: sp.csc_matrix
    rows: np.ndarray
    lengths: np.ndarray
    active: dict[str, int]
    ambiguous: dict[str, int]
    curvature: sp.csc_matrix
    fixed: np.ndarray

    @property
    def hessians(self) -> dict[str, sp.csc_matrix]:
        """That of every cost, and of every constraint times its multipliers, SI."""
        return {name: self._hessian_of(name) for name in self.problem.terms}

    def hessian(self, names: Iterable[str]) -> sp.csc_matrix:
        """Return the sum of the Hessians of some terms, SI."""
        zero = sp.csc_matrix((len(self.x), len(self.x)))
        return sum((self._hessian_of(name) for name in names), zero)

    def _hessian_of(self, name: str) -> sp.csc_matrix:
        """Return the Hessian of a term, weighted by its multipliers; kept."""
        if name not in self._computed:
            weight = self.multipliers.get(name, 1.0)
            self._computed[name] = self.problem.hessian(name, self.x, self.data, weight)
        return self._computed[name]

    @cached_property
    def _computed(self) -> dict[str, sp.csc_matrix]:
        """The Hessians that were asked for by now, by name."""
        return {}

    def sensitivity(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return sensitivities of k chosen unknowns: (unknowns, k) and (rows, k), SI.

        If the gradient of L changes by dg and the values of all constraints by dc, the
        chosen unknowns change by -(first' dg + second' dc).
        """
        scale, n = self.problem.scale, len(self.x)
        right = np.zeros((n + self.A.shape[0], len(chosen)))
        right[chosen, np.arange(len(chosen))] = scale[chosen]
        answer = self.factors.solve(right)
        by_constraint = np.zeros((self.problem.rows, len(chosen)))
        multipliers = answer[n : n + len(self.rows)]
        by_constraint[self.rows] = multipliers / self.lengths[:, None]
        return scale[:, None] * answer[:n], by_constraint

    def marginal(self, chosen: str | np.ndarray) -> np.ndarray:
        """Return the covariance (k, k) of k unknowns, all others free, SI.

        By the Hessian (Laplace approximation), symmetric to rounding.  chosen: their
        indices, or the name of a variable.
        """
        if isinstance(chosen, str):
            chosen = np.arange(len(self.x))[self.problem.variables[chosen].span]
        return self.sensitivity(chosen)[0][chosen]

    def moved(self, gradient: np.ndarray) -> np.ndarray:
        """Return how all unknowns (unknowns,) move if the gradient of L changes, SI."""
        right = np.zeros(len(self.x) + self.A.shape[0])
        right[: len(self.x)] = -self.problem.scale * gradient
        return self.problem.scale * self.factors.solve(right)[: len(self.x)]

    @cached_property
    def factors(self):
        """The factorised matrix K, in scaled unknowns."""
        return factorise(self.curvature, self.A)

    @cached_property
    def negative(self) -> tuple[str, np.ndarray] | None:
        """The term and direction (n,) [SI] of most negative curvature, None if none.

        The inertia is that of the pivots of H + ACTIVE_PENALTY A'A, which is positive
        definite if and only if the Hessian reduced to the null space of A is.  None as
        well where the Hessian is not finite, as after a failed solve.
        """
        H = self.curvature
        largest = max(abs(H).max(), 1.0)
        penalised = H + ACTIVE_PENALTY * self.A.T @ self.A
        if not np.isfinite(penalised.data).all():
            return None
        shift = LEAST_NEGATIVE * largest
        if _positive_definite(penalised + shift * sp.identity(H.shape[0])):
            return None
        direction = _lowest(penalised, shift) * self.problem.scale
        bends = {n: direction @ (h @ direction) for n, h in self.hessians.items()}
        return min(bends, key=bends.get), direction


def kkt_system_of(problem, solution, deadline: Deadline = NEVER) -> KKTSystem:
    """Return the KKT system of a problem at a solution of it.

    A strict deadline ends it before the second derivatives.
    """
    x, data = solution.at(problem)
    bounds = problem.pack(solution.bound_multipliers)
    multipliers = [solution.multipliers[name] for name in problem.constraints]
    multipliers = np.concatenate([np.zeros(0), *map(np.ravel, multipliers)])
    deadline.check()
    assembly, scaled = problem.assembly, x / problem.scale
    g = assembly.evaluated(scaled, data)[2]
    lower, upper = problem.limits("lower"), problem.limits("upper")
    slack = np.minimum(g - lower, upper - g)
    rows = _classified(np.abs(multipliers), slack, lower == upper)
    held = _active_bounds(problem, x, bounds, solution.held)
    terms, variables = problem.constraints.items(), problem.variables.items()
    spans = {name: term.span for name, term in terms}
    of_bounds = {f"bounds of {name}": variable.span for name, variable in variables}
    active, ambiguous = (
        _counts(some, spans) | _counts(others, of_bounds)
        for some, others in zip(rows, held, strict=True)
    )
    on, fixed = rows[0], held[0]
    slopes = assembly.slopes(scaled, data)[on]
    A = sp.vstack([slopes, sp.identity(problem.size, format="csr")[fixed]])
    lengths = np.maximum(np.sqrt(A.multiply(A).sum(axis=1).A1), LEAST_LENGTH)
    deadline.check()
    return KKTSystem(
        problem, x, data, dict(solution.multipliers),
        (sp.diags(1 / lengths) @ A).tocsc(), np.flatnonzero(on),
        lengths[: np.count_nonzero(on)], active, ambiguous,
        assembly.curvature(scaled, data, 1.0, multipliers), fixed,
    )  # fmt: skip


def _counts(chosen, spans) -> dict[str, int]:
    """Return how many rows are chosen, by the name of their span."""
    return {name: int(chosen[span].sum()) for name, span in spans.items()}


def _active_bounds(problem, x, multipliers, held) -> tuple[np.ndarray, np.ndarray]:
    """Return masks (unknowns,) of the active bounds and of the ambiguous ones.

    held: masks by name of the unknowns that the solve held, as bounds would.
    """
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    slack = np.minimum(x - lower, upper - x) / problem.scale
    equal = lower == upper
    for name, mask in held.items():
        equal[problem.variables[name].span] |= mask.T.ravel()
    return _classified(np.abs(multipliers) * problem.scale, slack, equal)


def _classified(multiplier, slack, equal) -> tuple[np.ndarray, np.ndarray]:
    """Return masks: active where the multiplier exceeds the slack; ambiguous.

    equal: mask of equalities, which are active whatever their multiplier is.
    """
    on = (multiplier > slack) | equal
    unsure = (multiplier > slack / AMBIGUOUS) & (multiplier < slack * AMBIGUOUS)
    return on, unsure & ~equal


def _positive_definite(M) -> bool:
    """Return whether all pivots of a symmetric factorisation are positive."""
    try:
        lu = splu(
            M.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip
    except RuntimeError:  # "exactly singular": not definite
        return False
    return bool(np.all(lu.U.diagonal() > 0))


def _lowest(M, shift: float) -> np.ndarray:
    """Return a unit vector close to the eigenvector of the lowest eigenvalue of M.

    Inverse iteration of M + shift 1, where the shift grows until that is positive
    definite.  It always ends; Lanczos' method may not for a large M.
    """
    one = sp.identity(M.shape[0])
    while not _positive_definite(M + shift * one):
        shift *= SHIFT_GROWTH
    inverse = splu((M + shift * one).tocsc(), permc_spec="MMD_AT_PLUS_A")
    v = np.random.default_rng(0).normal(size=M.shape[0])
    for _ in range(INVERSE_ITERATIONS):
        v = inverse.solve(v)
        v /= np.linalg.norm(v)
    return v
