r"""A solved programme to second order: how its solution answers a small pull.

At the optimum, with L the Lagrangian and A the Jacobian of the constraints and bounds
that are active,

    K [ dx ]   [ pull ]          K = [ H  A' ]      H = nabla^2 L  (exact)
      [ dl ] = [  0   ]              [ A  0  ]

so that one sparse factorisation of K gives the covariance of any unknowns (the block of
K^{-1}: the Hessian reduced to the null space of A, every other unknown marginalised),
the scatter by sensor noise, and the sensitivity to whatever was assumed.  The unknowns
are ordered by time, hence the cost is linear in the number of samples.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from .kkt import factorised

TIE = 1e2  # [-] a multiplier within this factor of its slack is neither on nor off
FIRM = 1e6  # [-] price of leaving active constraints, in Hessian entries
NEGATIVE = 1e-10  # [-] of the largest curvature: less than rounding is no direction
GROWTH = 4.0  # [-] of a shift that does not make a matrix positive definite
ROUNDS = 40  # of inverse iteration


@dataclass(frozen=True, eq=False)
class Curvature:
    """The second derivatives of a solved programme, by term, and its active set.

    hessians: (unknowns, unknowns) of every cost, and of every constraint times its
    multipliers, SI; A (active, unknowns): scaled Jacobian of what is active, rows of
    unit length; rows, lengths (active constraints,): which of all constraint rows
    these are (bounds follow), and by what they were divided; active, ambiguous: how
    many rows of each constraint or bound are so.
    """

    problem: object
    x: np.ndarray
    data: np.ndarray
    multipliers: dict[str, np.ndarray]
    hessians: dict[str, sp.csc_matrix]
    A: sp.csc_matrix
    rows: np.ndarray
    lengths: np.ndarray
    active: dict[str, int]
    ambiguous: dict[str, int]

    def hessian(self, names: Iterable[str] | None = None) -> sp.csc_matrix:
        """Return the sum of the Hessians of some terms, or of all, SI."""
        names = self.hessians if names is None else names
        zero = sp.csc_matrix((len(self.x), len(self.x)))
        return sum((self.hessians[name] for name in names), zero)

    def with_hessians(self, hessians: dict[str, sp.csc_matrix]) -> Curvature:
        """Return the same programme with other Hessians of its terms."""
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Curvature(**{**fields, "hessians": hessians})

    def response_of(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how the chosen unknowns answer (n, k) pulls, (rows, k) constraints.

        If the gradient of L changes by ds and the values of all constraints by dg, the
        chosen unknowns change by -(pulls' ds + constraints' dg), everything in SI.
        """
        scale, n = self.problem.scale, len(self.x)
        right = np.zeros((n + self.A.shape[0], len(chosen)))
        right[chosen, np.arange(len(chosen))] = scale[chosen]
        answer = self.factor.solve(right)
        held = np.zeros((self.problem.rows, len(chosen)))
        held[self.rows] = answer[n : n + len(self.rows)] / self.lengths[:, None]
        return scale[:, None] * answer[:n], held

    @cached_property
    def factor(self):
        """The factorised matrix K, scaled."""
        return factorised(self._scaled(self.hessian()), self.A)

    @cached_property
    def negative(self) -> tuple[str, np.ndarray] | None:
        """The term and direction (n,) [SI] of most negative curvature, None if none.

        Inertia by the pivots of H + FIRM A'A, which is positive definite if and only
        if the Hessian reduced to the null space of A is.  A Hessian that is not finite,
        as that of a failed solve may be, curves nowhere that can be named.
        """
        H = self._scaled(self.hessian())
        largest = max(abs(H).max(), 1.0)
        tight = H + FIRM * self.A.T @ self.A
        if not np.isfinite(tight.data).all():
            return None
        shift = NEGATIVE * largest
        if _positive_definite(tight + shift * sp.identity(H.shape[0])):
            return None
        direction = _lowest(tight, shift) * self.problem.scale
        bends = {n: direction @ (h @ direction) for n, h in self.hessians.items()}
        return min(bends, key=bends.get), direction

    def _scaled(self, H):
        D = sp.diags(self.problem.scale)
        return (D @ H @ D).tocsc()


def curvature_of(problem, solution) -> Curvature:
    """Return the curvature of a problem at a solution of it."""
    x, data = problem.pack(solution.values), problem.data(solution.parameters)
    hessians = {name: problem.hessian(name, x, data) for name in problem.costs}
    rows, numbers, active, ambiguous = [], [np.zeros(0, int)], {}, {}
    for name, term in problem.constraints.items():
        multiplier = solution.multipliers[name]
        hessians[name] = problem.hessian(name, x, data, multiplier)
        value = problem.value(name, x, data)
        slack = np.minimum(value - term.lower, term.upper - value).ravel()
        on, unsure = classified(np.abs(multiplier).ravel(), slack)
        rows.append(problem.jacobian(name, x, data)[on])
        numbers.append(term.first_row + np.nonzero(on)[0])
        active[name], ambiguous[name] = int(on.sum()), int(unsure.sum())
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    slack = np.minimum(x - lower, upper - x) / problem.scale
    pull = np.abs(problem.pack(solution.bound_multipliers)) * problem.scale
    on, unsure = classified(pull, slack)
    for name, variable in problem.variables.items():
        bound = f"bounds of {name}"
        active[bound] = int(on[variable.span].sum())
        ambiguous[bound] = int(unsure[variable.span].sum())
    rows.append(sp.identity(len(x), format="csc")[np.nonzero(on)[0]])
    A = sp.vstack(rows, format="csc") @ sp.diags(problem.scale)
    length = np.sqrt(np.asarray(A.multiply(A).sum(axis=1)).ravel())
    length = np.maximum(length, 1e-12)
    numbers = np.concatenate(numbers)
    return Curvature(
        problem, x, data, dict(solution.multipliers), hessians,
        (sp.diags(1 / length) @ A).tocsc(), numbers, length[: len(numbers)], active,
        ambiguous,
    )  # fmt: skip


def classified(multiplier, slack):
    """Classify: active where the multiplier outweighs the slack; unsure near a tie."""
    on = multiplier > slack
    unsure = (multiplier > slack / TIE) & (multiplier < slack * TIE)
    return on, unsure


def _positive_definite(M) -> bool:
    """Tell by the signs of the pivots of a symmetric factorisation."""
    try:
        lu = splu(
            M.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip
    except RuntimeError:  # "exactly singular": not definite
        return False
    return bool(np.all(lu.U.diagonal() > 0))


def _lowest(M, shift: float) -> np.ndarray:
    """Return a unit vector along which M curves down the most, or nearly so.

    Inverse iteration of M + shift 1, shift grown until that is positive definite: it
    always ends, where Lanczos' method on a large M may not.
    """
    one = sp.identity(M.shape[0])
    while not _positive_definite(M + shift * one):
        shift *= GROWTH
    inverse = splu((M + shift * one).tocsc(), permc_spec="MMD_AT_PLUS_A")
    v = np.random.default_rng(0).normal(size=M.shape[0])
    for _ in range(ROUNDS):
        v = inverse.solve(v)
        v /= np.linalg.norm(v)
    return v
