"""The belief before an action: weighted Gaussians about the hypotheses of an estimate.

This module has the beliefs of shapes with sizes, polytope_beliefs.py has those of
polytopes.  The Gaussian of the best hypothesis has the exact information of the
estimate, reduced to its sigma where that is larger.  Where this information is
indefinite, and for the other hypotheses, it is eq:obsinfo of all samples.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, eigh

from formulations import between_actions
from formulations.finger import SPHERE
from formulations.likelihood import steepness
from formulations.names import FINGER_OFFSET
from formulations.rigid_body import ARM, FREE, PLANAR
from formulations.violation_implicit import NORMAL, TOUCH

from ..data.contact_segments import intervals
from ..information.comparisons import sample_information
from ..information.error_budget_terms import REACHED
from ..information.laplace_approximation import prior_of_offsets
from ..information.tangent_space import rotations, tangent_of, widest_deviations
from ..local.comparison import distinct
from ..problem.hypothesis import Hypothesis
from ..problem.poses import rotations_on_ground
from ..tracking.standing import lying

log = logging.getLogger("tactilenlp")
POSE_PRIOR_SIGMA = REACHED, 3.0  # [m], [rad] of a pose before any touch
# [-] to that of the best: hypotheses of a smaller weight are omitted.
MIN_RELATIVE_WEIGHT = 0.02
ROUNDED_TO_ZERO = 1e-14  # [-] least eigenvalue of a correlation over its largest
# Friction shears a rubber pad by up to 0.75 of its indentation where mu is 0.5
# (Mindlin, 1949): the turn of a felt normal, of indentation over radius; uniform.
SHEAR_TURN = 0.75 / 3**0.5  # [-]
INDENTATION_ERROR = 0.5  # [-] of a predicted one: push and compliance are 30 % off each


@dataclass(frozen=True, eq=False)
class Belief:
    """A Gaussian about one hypothesis.

    z:           (k,), theta and x_T; for a polytope, vertices about its centroid [m]
    information: (k, k), SI; with unknown finger offsets (k + 3 F, k + 3 F)
    before:      the same before any touch: the prior
    weight:      [1], of the hypothesis; the weights of a belief sum to one
    shift:       (F, 3) [m], added to finger positions, ground frame: the estimated
                 offset; for a polytope, minus its centroid
    """

    z: np.ndarray
    information: np.ndarray
    before: np.ndarray
    weight: float
    shift: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """The covariance of z (k, k), SI; unknown offsets are marginalised."""
        k = len(self.z)
        return np.linalg.inv(self.information)[:k, :k]


def beliefs_of(estimate, shape, fingers: int, count: int) -> list[Belief]:
    """Return at most `count` beliefs, best first; their weights sum to one.

    fingers: the number of fingers, whose offsets may be unknown.  A body that leans at
    the last sample, against a finger, lies when that has let go.
    """
    n = shape.theta
    best = np.r_[estimate.theta, estimate.unknowns["x"][:, -1]]
    if has_free_poses(estimate, shape) and not shape.rolls:
        best = lying(shape, best)
    offset = estimate.unknowns.get(FINGER_OFFSET, np.zeros((3, 1))).T
    before = prior_matrix(estimate, shape, fingers)
    rest = []
    if not has_free_poses(estimate, shape):  # same end: the better one
        here = Hypothesis(best[:n], best[n:, None], -np.inf, ())
        ended = here, *estimate.hypotheses
        rest = distinct(shape, ended, count, np.inf, samples=(-1,))[1:]
    information = information_of_best(estimate, shape, before, best, offset)
    beliefs = [Belief(best, information, before, 1.0, offset)]
    for h in rest:
        weight = np.exp(min(0.0, estimate.objective - h.objective))
        if weight > MIN_RELATIVE_WEIGHT:
            off = np.zeros((1, 3)) if h.offset is None else h.offset.T
            at = h.theta, h.x, off
            information = information_of_samples(estimate, shape, *at, before)
            beliefs.append(Belief(h.end, information, before, weight, off))
    total = sum(b.weight for b in beliefs)
    return [
        replace(
            b, weight=b.weight / total,
            information=_after_retraction(b, n, _tangent_at(estimate, shape, b.z)),
        )
        for b in beliefs
    ]  # fmt: skip


def has_free_poses(estimate, shape) -> bool:
    """Tell whether poses have six unknowns (free motion), not three (planar)."""
    return not shape.of_vertices and len(estimate.information.names) > shape.theta + 3


def prior_matrix(estimate, shape, fingers: int) -> np.ndarray:
    """Return the prior information: size prior, wide Gaussian of the pose.

    With the prior of the finger offsets, where they are unknown.
    """
    k = len(estimate.information.names)
    information = np.diag(1 / widest_deviations(shape, k, *POSE_PRIOR_SIGMA) ** 2)
    if estimate.finger_offset is None:
        return information
    return block_diag(information, prior_of_offsets(estimate.scene, fingers))


def information_of_best(estimate, shape, before, best, offset) -> np.ndarray:
    """Return the information of the estimate; eq:obsinfo where it is indefinite.

    before, best, offset: before, z and shift of its Belief.  The prior of the pose is
    added where this makes it definite: negative curvature of a smaller magnitude means
    an unobserved direction.  The priors of sizes and offsets are part of the estimate's
    objective already.
    """
    T = np.eye(len(before))
    k = len(estimate.information.names)
    T[:k, :k] = _tangent_at(estimate, shape, best)
    pose, anywhere = slice(shape.theta, k), np.zeros_like(before)
    anywhere[pose, pose] = before[pose, pose]
    matrix = estimate.information.matrix
    if estimate.finger_offset is not None:
        matrix = estimate.information.with_offsets
    for information in (matrix, matrix + anywhere):
        scale = 1 / np.sqrt(np.abs(np.diag(information)))
        least = np.linalg.eigvalsh(information * np.outer(scale, scale))[0]
        if least > 0:
            information = widened_to_sigma(information, estimate)
            return T.T @ information @ T
    log.warning(
        "the information of the estimate is indefinite (least eigenvalue %.2g): "
        "actions are chosen with the sum over its samples (eq:obsinfo)", least,
    )  # fmt: skip
    x = _poses(estimate, has_free_poses(estimate, shape))
    return information_of_samples(estimate, shape, estimate.theta, x, offset, before)


def widened_to_sigma(known: np.ndarray, estimate) -> np.ndarray:
    """Return the information, reduced where its variance is below that of sigma.

    The optimum of an unobserved size can be at a kink, where the Hessian is large and
    the profile likelihood is wide; sigma is from the latter (profile_likelihood.py).
    The variance between modes is not included: other modes are hypotheses themselves.
    """
    information, modes = estimate.information, estimate.information.modes
    k = len(information.names)
    wider = 1.0 if estimate.fit is None else estimate.fit.widening
    S = information.covariance_matrix - wider**2 * (
        modes.covariance - modes.covariances[0]
    )
    C = made_definite(np.linalg.inv(known))
    values, V = eigh(S, C[:k, :k])  # V'CV = 1
    back = C[:k, :k] @ V
    C[:k, :k] += (back * np.maximum(values - 1, 0.0)) @ back.T
    wider = np.linalg.inv(C)
    return (wider + wider.T) / 2


def made_definite(C: np.ndarray) -> np.ndarray:
    """Return a covariance, with variances below rounding raised to rounding.

    The inverse of an information with a kink (a stiff direction) is not definite.
    """
    sd = np.sqrt(np.abs(np.diag(C)))
    values, vectors = np.linalg.eigh(C / np.outer(sd, sd))
    least = ROUNDED_TO_ZERO * values[-1]
    if values[0] > least:
        return C
    values = np.maximum(values, 10 * least)  # the product is rounded too
    return (vectors * values) @ vectors.T * np.outer(sd, sd)


def _tangent_at(estimate, shape, at) -> np.ndarray:
    """Return the matrix (k, k) from steps of theta, x_T at `at` to tangent space."""
    motion = FREE if has_free_poses(estimate, shape) else PLANAR
    return tangent_of(shape, motion, at, estimate.scene.ground.rotation.T)


def information_of_samples(estimate, shape, theta, x, offset, before) -> np.ndarray:
    """Return the prior `before` and eq:obsinfo of all samples at poses x (u, T), SI."""
    data = estimate.measurements
    points = estimate.scene.ground.to_ground(data.finger_position) + offset
    t, f = np.nonzero(data.valid)
    k = len(theta) + len(x)
    z = np.vstack([np.repeat(theta[:, None], len(t), axis=1), x[:, t]])
    motion = FREE if len(x) > 3 else PLANAR
    each = sample_information(shape, motion, SPHERE).map(len(t))(
        z, points[t, f].T, data.finger_radius[f][None],
        data.contact[t, f][None].astype(float), sensor_model(estimate),
    )  # fmt: skip
    each = each.full().reshape(k + 3, len(t), k + 3)
    information = np.zeros_like(before)
    information[:k, :k] += each[:k, :, :k].sum(axis=1)
    for finger in range(data.fingers) if len(before) > k else ():
        of_finger, at = f == finger, k + 3 * finger + np.arange(3)
        both = np.r_[:k, at]
        part = each[:, of_finger].sum(axis=1)
        part[:k, :k] = 0.0
        information[np.ix_(both, both)] += part
    return before + information


def sensor_model(estimate, touch=TOUCH, normal=NORMAL) -> np.ndarray:
    """Return alpha [1/m], sigma [m] of a gap in contact, sigma_n [rad].

    touch [m], normal [rad]: their deviations without the noise of sensors, by default
    those of the pages.  Of soft fingertips a predicted touch is off by a share of the
    indentation, and its normal is turned by the shear of the pad: they tell less.
    """
    p, n = estimate.precision["position"], estimate.precision["normal"]
    alpha, sigma, sigma_n = steepness(p), np.hypot(touch, p), np.hypot(normal, n)
    compliance = estimate.compliance or estimate.scene.compliance
    if not compliance:
        return np.array([alpha, sigma, sigma_n])
    data = estimate.measurements
    felt = data.contact
    push = [estimate.impulses[f"finger {f}"] for f in range(data.fingers)]
    normal = np.abs((np.stack(push, axis=1) * data.normal).sum(axis=2))
    force = (normal / intervals(data)[:, None])[felt]
    depth = compliance * np.sqrt(np.mean(force**2))
    shear = SHEAR_TURN * depth / data.finger_radius.mean()
    off = INDENTATION_ERROR * depth
    return np.array([alpha, np.hypot(sigma, off), np.hypot(sigma_n, shear)])


def _poses(estimate, free: bool) -> np.ndarray:
    """Return the poses of an estimate as unknowns (u, T), ground frame."""
    ground = estimate.scene.ground
    turn = rotations_on_ground(ground, estimate.quaternion)
    x = np.hstack([ground.to_ground(estimate.position), turn.as_rotvec()]).T
    return x if free else x[[0, 1, 5]]


def _after_retraction(belief: Belief, theta: int, tangent) -> np.ndarray:
    """Return the information after the retraction, in which the body may move slightly.

    tangent (k, k): from steps of z to steps with rotations about the world's axes.
    """
    k, C = len(belief.z), np.linalg.inv(belief.information)
    slip = np.zeros(k)
    slip[theta:] = between_actions.GAP
    slip[-rotations(theta, k) :] /= ARM
    back = np.linalg.inv(tangent)
    C[:k, :k] += (back * slip**2) @ back.T
    loosened = np.linalg.inv(C)
    return (loosened + loosened.T) / 2
