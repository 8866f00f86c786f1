"""What is believed before an action: the hypotheses of an estimate, and how well known.

Of a shape with sizes: theta and x_T by the exact information of the estimate, but no
better in any direction than its sigma says; where that information is indefinite, and
of other hypotheses, by eq:obsinfo of all samples.  Polytopes: polytope_beliefs.py.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, eigh

from formulations import between_actions, likelihood, violation_implicit
from formulations.finger_offset import NAME as OFFSET
from formulations.rigid_body import ARM, FREE, PLANAR

from ..geometry.transforms import rotation_of
from ..information.finger_offsets import prior_of_offsets
from ..information.tangent_space import tangent_of
from ..nlp.term_functions import mapped
from ..search.hypothesis import Hypothesis, distinct
from .push_model import sampled

log = logging.getLogger("tactilenlp")
VAGUE = 0.1, 3.0  # [m], [rad] of a pose of which nothing is known
NEGLIGIBLE_WEIGHT = 0.02  # [-] of the best's weight: a hypothesis that is not followed


@dataclass(frozen=True, eq=False)
class Belief:
    """One hypothesis: z (k,), theta and x_T, what is known of them, its weight.

    information (k, k), SI, and before (k, k), that before any touch.  shift (F, 3) [m]:
    of the fingers, ground frame.  Where it is an offset that is not known, information
    and before (k + 3 F, k + 3 F) are about it, too.  Of a hull, z are the vertices
    about its centroid, and shift leads there.
    """

    z: np.ndarray
    information: np.ndarray
    before: np.ndarray
    weight: float
    shift: np.ndarray


def believed(estimate, shape, fingers: int, count: int) -> list[Belief]:
    """Return the hypotheses to follow, best first, weights summing to one.

    fingers: of which offsets may be known; count: hypotheses at most.
    """
    n = shape.theta
    best = np.r_[estimate.theta, estimate.unknowns["x"][:, -1]]
    offset = estimate.unknowns.get(OFFSET, np.zeros((3, 1))).T
    before = before_any_touch(estimate, shape, fingers)
    rest = []
    if not freely(estimate, shape):  # of two pasts that end alike, the better one
        here = Hypothesis(best[:n], best[n:, None], -np.inf, ())
        ended = here, *estimate.hypotheses
        rest = distinct(shape, ended, count, np.inf, samples=(-1,))[1:]
    weights = [np.exp(min(0.0, estimate.objective - h.objective)) for h in rest]
    found = [Belief(best, known_of_best(estimate, shape, before), before, 1.0, offset)]
    for h, weight in zip(rest, weights, strict=True):
        if weight > NEGLIGIBLE_WEIGHT:
            off = h.shift.T
            known = before + told(estimate, shape, h.theta, h.x, off, len(before))
            found.append(Belief(h.end, known, before, weight, off))
    total = sum(b.weight for b in found)
    return [
        replace(
            b, weight=b.weight / total,
            information=_loosened(b, n, _into_names(estimate, shape, b.z)),
        )
        for b in found
    ]  # fmt: skip


def freely(estimate, shape) -> bool:
    """Tell whether poses of an estimate have six unknowns, not three."""
    return len(estimate.information.names) > shape.theta + 3


def before_any_touch(estimate, shape, fingers: int) -> np.ndarray:
    """Return the information before any touch: rough sizes, a pose anywhere.

    Of the fingers' offsets as well, where they are not known.
    """
    k = len(estimate.information.names)
    turns = (k - shape.theta) // 2  # 1 of 3 planar, 3 of 6 free unknowns
    ways = k - shape.theta - turns
    size = np.full(shape.theta, shape.size_prior[1])
    sigma = np.r_[size, np.full(ways, VAGUE[0]), np.full(turns, VAGUE[1])]
    information = np.diag(1 / sigma**2)
    if estimate.finger_offset is None:
        return information
    return block_diag(information, prior_of_offsets(estimate.scene, fingers))


def known_of_best(estimate, shape, before: np.ndarray) -> np.ndarray:
    """Return the information of the estimate; eq:obsinfo where it is indefinite.

    What curves down by less than a vague prior of the pose curves up is not known, no
    more.  Priors of sizes and offsets are in the estimate's programme already.
    """
    T = np.eye(len(before))
    k = len(estimate.information.names)
    at = np.r_[estimate.theta, estimate.unknowns["x"][:, -1]]
    T[:k, :k] = _into_names(estimate, shape, at)
    here = slice(shape.theta, len(estimate.information.names))
    anywhere = np.zeros_like(before)
    anywhere[here, here] = before[here, here]
    matrix = estimate.information.matrix
    if estimate.finger_offset is not None:
        matrix = estimate.information.with_offsets
    for known in (matrix, matrix + anywhere):
        least = np.linalg.eigvalsh(_scaled(known))[0]
        if least > 0:
            known = as_doubtful(known, estimate.information)
            return T.T @ known @ T
    log.warning(
        "the information of the estimate is indefinite (least eigenvalue %.2g): "
        "choosing by the sum of its samples' (eq:obsinfo)", least,
    )  # fmt: skip
    offset = estimate.unknowns.get(OFFSET, np.zeros((3, 1))).T
    x = _poses(estimate, freely(estimate, shape))
    return before + told(estimate, shape, estimate.theta, x, offset, len(before))


def as_doubtful(known: np.ndarray, information) -> np.ndarray:
    """Return what is known, made as doubtful as sigma in every direction.

    The optimum of a size that touch leaves open may be a kink: sharp to a Hessian, and
    not to the profile that sigma tells (profile.py).  Other modes are hypotheses of
    their own, and no doubt about this one.
    """
    modes, k = information.modes, len(information.names)
    S = information.spread - modes.covariance + modes.covariances[0]
    C = np.linalg.inv(known)
    values, V = eigh(S, C[:k, :k])  # V'CV = 1
    back = C[:k, :k] @ V
    C[:k, :k] += (back * np.maximum(values - 1, 0.0)) @ back.T
    wider = np.linalg.inv(C)
    return (wider + wider.T) / 2


def _into_names(estimate, shape, at) -> np.ndarray:
    """Return from a change of theta and x_T, `at` (k,), to one of the names."""
    motion = FREE if freely(estimate, shape) else PLANAR
    return tangent_of(shape, motion, at, estimate.scene.ground.rotation.T)


def told(estimate, shape, theta, x, offset, size: int) -> np.ndarray:
    """Return eq:obsinfo (size, size) of all samples at poses x (u, T)."""
    data = estimate.measurements
    points = estimate.scene.ground.to_ground(data.finger_position) + offset
    t, f = np.nonzero(data.valid)
    k = len(theta) + len(x)
    z = np.vstack([np.repeat(theta[:, None], len(t), axis=1), x[:, t]])
    found = mapped(sampled(shape, len(x) > 3), len(t))(
        z, points[t, f].T, data.finger_radius[f][None],
        data.contact[t, f][None].astype(float), sensors(estimate),
    )  # fmt: skip
    found = found.full().reshape(k + 3, len(t), k + 3)
    information = np.zeros((size, size))
    information[:k, :k] += found[:k, :, :k].sum(axis=1)
    for finger in range(data.fingers) if size > k else ():
        mine, at = f == finger, k + 3 * finger + np.arange(3)
        both = np.r_[:k, at]
        part = found[:, mine].sum(axis=1)
        part[:k, :k] = 0.0
        information[np.ix_(both, both)] += part
    return information


def sensors(estimate) -> np.ndarray:
    """Return alpha [1/m], sigma [m] of a felt gap, sigma_n [rad], as the pages have."""
    p, n = estimate.precision["position"], estimate.precision["normal"]
    touch, normal = violation_implicit.TOUCH, violation_implicit.NORMAL
    return np.array([steepness(p), np.hypot(touch, p), np.hypot(normal, n)])


def steepness(sigma: float) -> float:
    """Return alpha [1/m] of eq:bool where positions are off by sigma [m]."""
    return 1 / np.hypot(1 / likelihood.ALPHA, sigma / 1.7)


def _poses(estimate, free: bool) -> np.ndarray:
    """Return the poses of an estimate as unknowns (u, T), ground frame."""
    from scipy.spatial.transform import Rotation

    ground = estimate.scene.ground
    position = ground.to_ground(estimate.position)
    turn = rotation_of(estimate.quaternion)
    turn = Rotation.from_matrix(ground.rotation) * turn
    x = np.hstack([position, turn.as_rotvec()]).T
    return x if free else x[[0, 1, 5]]


def _scaled(matrix: np.ndarray) -> np.ndarray:
    scale = 1 / np.sqrt(np.abs(np.diag(matrix)))
    return matrix * np.outer(scale, scale)


def _loosened(belief: Belief, theta: int, tangent) -> np.ndarray:
    """Return the information once the fingers have gone: the pose may slip a little.

    tangent (k, k): from a change of z to one whose turns are about the world's axes.
    """
    k, C = len(belief.z), np.linalg.inv(belief.information)
    slip = np.zeros(k)
    slip[theta:] = between_actions.GAP
    slip[k - (1 if k == theta + 3 else 3) :] /= ARM
    back = np.linalg.inv(tangent)
    C[:k, :k] += (back * slip**2) @ back.T
    loosened = np.linalg.inv(C)
    return (loosened + loosened.T) / 2
