r"""Weigh local optima as a Laplace mixture: its weights, offsets and covariance.

Touch can leave several bodies possible: another face touched, another rotation.  Modes
m are weighted by Laplace's approximation to the evidence of shape z and final pose
(Kass and Raftery, J. Am. Stat. Assoc. 90, 1995, Sec. 4.1),

    w_m  ~  exp(-objective_m) sqrt(det C_m),      sum w = 1,

and the mixture's covariance about the best one is sum w_m (C_m + d_m d_m'), where d_m
is the offset of mode m after the relabelling of the body's axes that rotates it least.
C_m in the weight includes the weak prior of the final pose (`bounded_pose`): a pose
that no touch tells makes no mode likelier.  Only the volume of z counts: that of the
impulses depends on which bounds are active, differs by tens of nats from mode to mode,
and says nothing about the shape.

Classes of shapes s, with other unknowns each, are compared in the same way, with the
volume of the posterior as a share of that of the prior (Occam's factor: MacKay, Neural
Computation 4, 1992):

    p_s  ~  exp(-objective_s) prod_i min(1, deviation_i / prior deviation_i)

over the principal axes i of z in units of the prior, which is a Gaussian of shape and
final pose.  What no touch tells costs nothing, in any class.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import gammaln, softmax

from formulations.rigid_body import ARM

from ..common.brief import printed
from ..nlp.kkt import KKTSystem
from .error_budget import PRIORS
from .error_budget_terms import (
    ANY_ROTATION,
    REACHED,
    bounded_pose,
    positive_semidefinite,
)
from .tangent_space import rotations, widest_deviations

SAME_MODE = 0.3e-3  # [m] modes whose unknowns agree this well (a radian: ARM) are one
NEGLIGIBLE_WEIGHT = 2.7e-3  # [-] beyond three deviations: less does not count


class LocalOptimum(NamedTuple):
    """Laplace's approximation to the posterior of shape and final pose at one optimum.

    z (k,): theta, then position and turn; R (3, 3): the final rotation of the body, in
    the frame of the turn; objective [nats], of wrong touches with their density;
    covariance (k, k): by the Hessian, SI; solution, window: of the solve there.
    """

    z: np.ndarray
    R: np.ndarray
    objective: float
    covariance: np.ndarray
    solution: object = None
    window: object = None


@printed
@dataclass(frozen=True, eq=False)
class Modes:
    """Local optima as plain arrays, best first: weights (m,), offsets (m, k), SI.

    offsets: shape and final pose less those of the best; covariances (m, k, k).
    """

    weights: np.ndarray
    offsets: np.ndarray
    covariances: np.ndarray
    objectives: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (k, k) of the mixture about the best mode."""
        second = np.einsum("mi,mj->mij", self.offsets, self.offsets)
        return np.einsum("m,mij->ij", self.weights, self.covariances + second)

    def of_mixture(self, errors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return errors of the best mode as those of the mixture, others by name."""
        best, *others = self.weights
        shared = {name: best * error for name, error in errors.items()}
        besides = replace(self, weights=np.array([0.0, *others])).covariance
        return shared | {"other optima": besides}


@dataclass(frozen=True)
class ClassOdds:
    """How probable a class of shapes is among those that were compared.

    shape: its name; objective [nats] of its estimate, and log_evidence [nats], both up
    to one constant that all classes share; probability [-]; verdict: of its fit; error:
    why there is no evidence of it, or "".
    """

    shape: str
    objective: float
    log_evidence: float
    probability: float
    verdict: str
    error: str = ""


def odds_of(estimates, errors: dict) -> tuple[ClassOdds, ...]:
    """Return the odds of classes, the most probable first, then those that failed.

    estimates: (log evidence, Estimate) of each class; errors: TactileErrors by class.
    """
    evidence = np.array([own for own, _ in estimates])
    weights = np.exp(evidence - evidence.max()) if np.isfinite(evidence).any() else 0.0
    shares = weights / max(np.sum(weights), 1.0) * np.isfinite(evidence)
    odds = []
    for (own, e), share in zip(estimates, shares, strict=True):
        verdict = e.fit.verdict if e.fit else ""
        ended = "" if np.isfinite(own) else e.status
        odds.append(ClassOdds(e.shape, e.objective, own, float(share), verdict, ended))
    odds.sort(key=lambda one: -one.log_evidence)
    failed = {k: f"{type(error).__name__}: {error}" for k, error in errors.items()}
    odds += [ClassOdds(k, np.inf, -np.inf, 0.0, "", said) for k, said in failed.items()]
    return tuple(odds)


def occam_factor(covariance, prior) -> tuple[float, float]:
    """Return log prior / posterior volume [nats], and how many directions are told.

    covariance (k, k) of the posterior; prior (k, k), positive definite: the information
    before the data.  How many: sum of 1 - posterior / prior variance (as by MacKay).
    """
    L = np.linalg.cholesky(prior)
    shares = np.linalg.eigvalsh(L.T @ ((covariance + covariance.T) / 2) @ L)
    shares = np.clip(np.abs(shares), np.finfo(float).tiny, 1.0)
    return float(-np.log(shares).sum() / 2), float((1 - shares).sum())


def occam_of(kkt: KKTSystem, name: str) -> float:
    """Return what the evidence loses by one unknown of a page, by its name [nats].

    Its information before the data is that of the page's priors.
    """
    problem, own = kkt.problem, kkt.problem.variables[name].span
    prior = kkt.hessian(problem.costs_of("prior"))[own][:, own].toarray()
    return occam_factor(kkt.marginal(name), prior)[0]


def occam_of_hull(kkt: KKTSystem) -> float:
    """Return what the evidence loses by the vertices of a solved page [nats].

    Before the data they are as open as the page's priors and its regulariser `stay`
    leave them, about the ball where it ended.
    """
    problem, own = kkt.problem, kkt.problem.variables["theta"].span
    held = kkt.hessian(problem.costs_of(*PRIORS))[own][:, own].toarray()
    return occam_of_vertices(kkt.marginal("theta"), held)


def occam_of_vertices(covariance, held) -> float:
    r"""Return what the evidence of a hull loses by its V vertices [nats].

        log(prior volume / posterior volume) - log(V! / (V - k)!)

    k: how many vertices the data tell, a third of the directions that they do.  Each
    order in which vertices can be listed is an optimum of its own as far as the data
    tell them apart.  covariance (3 V, 3 V) by the Hessian; held (3 V, 3 V): what holds
    them before the data (PRIORS), of which they lie within REACHED at least.
    """
    prior = positive_semidefinite(held, least=1 / REACHED**2)
    lost, directions = occam_factor(covariance, prior)
    V, k = len(held) / 3, directions / 3
    return float(lost - gammaln(V + 1) + gammaln(V - k + 1))


def one_mode(objective: float, covariance) -> Modes:
    """Return the modes of an estimate without alternatives."""
    zero = np.zeros((1, len(covariance)))
    return Modes(np.ones(1), zero, covariance[None], np.array([objective]))


def laplace_mixture(shape, optima, errors=None) -> Modes:
    """Return the modes of distinct LocalOptima, the first first.

    errors (k, k): the covariance of the first, if it is not that of the Hessian, of
    which the weights are.
    """
    pairs = [aligned(shape, one, optima[0]) for one in optima]
    offsets, covariances = (np.array(part) for part in zip(*pairs, strict=True))
    objectives = np.array([one.objective for one in optima])
    unit = np.outer(*[_units(shape, len(optima[0].z))] * 2) / SAME_MODE**2
    closed = [bounded_pose(C, shape.theta) for C in covariances]
    evidence = np.array([_log_volume(C * unit) for C in closed]) - objectives
    weights = softmax(evidence)
    weights[1:] *= weights[1:] >= NEGLIGIBLE_WEIGHT
    if errors is not None:
        covariances[0] = errors
    return Modes(weights / weights.sum(), offsets, covariances, objectives)


def bounded(errors: dict, covariance, shape) -> tuple[np.ndarray, dict]:
    """Return what `bounded_pose` makes of a covariance (k, k), and of its errors, SI.

    By the gain K of that prior, an error C is (1 - K) C (1 - K)'; the rest is its own.
    """
    n, kept = shape.theta, np.eye(len(covariance))
    covariance = bounded_pose(covariance, n)
    widest = widest_deviations(shape, len(covariance), REACHED, ANY_ROTATION)
    kept[:, n:] -= covariance[:, n:] / widest[n:] ** 2
    errors = {name: kept @ C @ kept.T for name, C in errors.items()}
    errors["bound of the pose"] = covariance - sum(errors.values())
    return covariance, errors


def distinct_modes(shape, optima) -> list[LocalOptimum]:
    """Return those of several LocalOptima that are not one of those before."""
    units, kept, offsets = _units(shape, len(optima[0].z)), [], []
    for one in optima:
        off, _ = aligned(shape, one, optima[0])
        if all(np.abs((off - other) * units).max() > SAME_MODE for other in offsets):
            kept.append(one)
            offsets.append(off)
    return kept


def _units(shape, k: int) -> np.ndarray:
    """Return by what unknowns (k,) are multiplied to compare them, [1] or [m/rad]."""
    return np.where(np.arange(k) < k - rotations(shape.theta, k), 1.0, ARM)


def _log_volume(C) -> float:
    """Return log sqrt(det C), no direction thinner than rounding lets one tell."""
    values = np.linalg.eigvalsh(C)
    least = max(np.finfo(float).eps * values.max(), np.finfo(float).tiny)
    return float(np.log(np.maximum(values, least)).sum() / 2)


def aligned(shape, mode: LocalOptimum, reference: LocalOptimum):
    """Return offset (k,) of a mode from a reference, and its covariance.

    The mode is relabelled (order of theta, rotation) so that it is turned least.
    """
    order, S = relabelling(shape, mode.R, reference.R)
    index = np.r_[np.array(order, int), np.arange(shape.theta, len(mode.z))]
    off = mode.z[index] - reference.z
    turn = turn_between(shape, mode.R @ S, reference.R)
    turning = rotations(shape.theta, len(off))
    off[-turning:] = turn[-turning:]
    return off, mode.covariance[np.ix_(index, index)]


def relabelling(shape, R, R_0) -> tuple:
    """Return the order of theta and the axes (3, 3) by which R is nearest to R_0."""
    ways = relabellings(shape)
    frames = R @ np.array([S for _, S in ways])
    far = np.linalg.norm(turn_between(shape, frames, R_0[None]), axis=1)
    return ways[int(np.argmin(np.round(far, 9)))]


def relabellings(shape, upright: bool = False) -> list[tuple[list[int], np.ndarray]]:
    """Return all orders of theta and axes (3, 3) under which a body is the same.

    upright: those alone that keep which way its z axis points, as in planar motion.
    """
    ways = [(list(order), np.array(S, float)) for order, S in shape.relabellings]
    return [way for way in ways if not upright or way[1][2, 2] > 0]


def turn_between(shape, R, R_0) -> np.ndarray:
    """Return the rotation vectors (..., 3) [rad] from R_0 to R, each (..., 3, 3).

    The turn of a round body about its own axis is left out: it has no effect.
    """
    turn = Rotation.from_matrix(R @ np.swapaxes(R_0, -1, -2)).as_rotvec()
    if not shape.round:
        return turn
    axis = R_0[..., 2]
    return turn - axis * np.sum(axis * turn, axis=-1, keepdims=True)
