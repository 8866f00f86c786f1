r"""Compute the information of a solved problem: a Laplace approximation.

matrix              the exact information, by the reduced Hessian of the Lagrangian
                    (nlp/kkt.py)
covariance_matrix   what `sigma` reports: the error budget (error_budget.py), of sizes
                    with a mixture of the local optima that were found (mixture.py)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag
from scipy.special import softmax

from formulations.names import FINGER_OFFSET

from ..geometry.convex_hull import centroid, hausdorff_distance
from ..nlp.kkt import KKTSystem
from .error_budget import errors_by_name, summed, variances_by_name
from .error_budget_terms import beyond_mixture
from .information import LEAST_DEVIATION, Information
from .linearisation import Linearisation, Response, vertices_at_end
from .mixture import (
    SAME_MODE,
    bounded,
    distinct_modes,
    laplace_mixture,
    one_mode,
)
from .tangent_space import inverse, known_faces, open_directions, slope_of_centroid
from .trajectory import (
    deviations_of_path,
    response_to_ground,
    trajectory_variance,
)

if TYPE_CHECKING:
    from ..local.solved import Solved

MAX_NAMES = 4  # unknowns that name a direction


def information_of(
    linearisation: Linearisation, solved: Solved, faces, others
) -> Information:
    """Return the information about shape and last pose of a search's Solved page.

    faces: how many samples touched each, (axes, 2) of a box; others: LocalOptima of the
    same data, of a polytope Solved pages.
    """
    kkt, tangent = linearisation.kkt, solved.tangent
    by_ground, ground = response_to_ground(linearisation, tangent)
    response = linearisation.response(tangent.chosen, tangent.jacobian, by_ground)
    if solved.window.shape.of_vertices:
        fields, errors = _of_vertices(response, solved, faces, others)
    else:
        fields, errors = _of_sizes(response, solved, faces, others)
    by_gradient, matrix = response.by_gradient, fields["matrix"]
    parts = {
        name: matrix @ (by_gradient.T @ (H @ by_gradient)) @ matrix
        for name, H in kkt.hessians.items()
    }
    given = linearisation.consider_parameters
    roles = {name: kkt.problem.terms[name].role or "constraint" for name in parts}
    return Information(
        names=tangent.names, parts=parts, roles=roles, maps=tangent.maps,
        fixed=tangent.fixed, active=kkt.active, ambiguous=kkt.ambiguous, ground=ground,
        considered={name: r.considered for name, r in given.items()},
        budget=variances_by_name(errors, tangent.maps), **fields,
    )  # fmt: skip


def _of_sizes(response: Response, solved: Solved, faces, others) -> tuple:
    """Return fields of the Information about sizes, and the errors (k, k) by name."""
    linearisation, tangent, C = response.linearisation, solved.tangent, response.hessian
    shape = solved.window.shape
    errors, at_bounds = errors_by_name(response), sizes_at_bounds(solved)
    optima = distinct_modes(shape, [solved.optimum, *others])
    modes = laplace_mixture(shape, optima, summed(errors))
    beyond = beyond_mixture(modes, linearisation, tangent, faces, solved.profile)
    if at_bounds.any():
        open_sizes = np.pad(at_bounds, (0, len(C) - len(at_bounds)))
        beyond["active bounds"] = np.diag(open_sizes**2)
    errors, more = modes.of_mixture(errors) | beyond, sum(beyond.values())
    path = deviations_of_path(linearisation, tangent, modes, optima, more)
    covariance, errors = bounded(errors, modes.covariance + more, shape)
    known = known_faces(tangent, faces, solved.job.scene.ground is not None)
    words, directions = open_directions(tangent, covariance, shape, known)
    words += tuple(
        f"{name}: at its bound" for name in np.array(shape.names)[at_bounds > 0]
    )
    fields = {
        "matrix": inverse(C), "covariance_matrix": covariance, "modes": modes,
        "unobserved": words, "directions": directions, "path": path,
        "indefinite": _indefinite(linearisation.kkt),
    }  # fmt: skip
    return fields | fields_of_offsets(linearisation, tangent), errors


def sizes_at_bounds(solved: Solved) -> np.ndarray:
    """Return the deviations (n,) of sizes that end at a bound, SI; of others zero.

    The posterior falls from a bound as exp(-multiplier distance), whose root mean
    square is sqrt(2) / multiplier; it ends at the other bound.
    """
    solution, theta = solved.solution, solved.problem.variables["theta"]
    room = (theta.upper - theta.lower)[:, 0]
    on = solved.kkt.fixed[theta.span] & (room > 0) & ("theta" not in solution.held)
    deviations, force = np.zeros(len(room)), solution.bound_multipliers["theta"][on, 0]
    deviations[on] = np.minimum(np.sqrt(2) / np.abs(force), room[on])
    return deviations


def _of_vertices(response: Response, solved: Solved, faces, others) -> tuple:
    """Return fields of the Information about vertices, and the errors (k, k) by name.

    Some of them a bound holds, by the ground: these vary by LEAST_DEVIATION.  others:
    Solved pages of other hulls.
    """
    linearisation, C = response.linearisation, response.hessian
    linearisation.job.deadline.check()
    floor = LEAST_DEVIATION**2 * np.eye(len(C))
    errors = errors_by_name(response) | {"active bounds": floor}
    besides = of_other_hulls(solved, others, summed(errors))
    errors |= {"other optima": besides}
    covariance, V = summed(errors), solved.solution.values["theta"].T
    maps = solved.tangent.maps
    of_end = besides, np.concatenate([maps["position"], maps["rotation"]])
    middle = centroid(V), slope_of_centroid(V)
    path = trajectory_variance(linearisation, middle, of_end)
    missing = int(np.count_nonzero(faces == 0))
    words = (f"{missing} of {len(faces)} faces never touched",) if missing else ()
    negative = np.linalg.eigvalsh(C)[0] < -(LEAST_DEVIATION**2)
    fields = {
        "matrix": np.linalg.inv(C + floor), "covariance_matrix": covariance,
        "modes": one_mode(solved.solution.objective, covariance), "unobserved": words,
        "directions": np.zeros((len(C), 0)), "path": np.sqrt(path),
        "indefinite": ("vertices",) if negative else (),
    }  # fmt: skip
    return fields, errors


def of_other_hulls(solved: Solved, others, C) -> np.ndarray:
    """Return what other hulls of the same data add to the covariance C (k, k) [m^2].

    sum_m w_m d_m d_m', with d_m = C J' (J C J')^-1 off_m, the likeliest change of the
    vertices that moves the centroid, whose slopes are J (3, k), to that of hull m, and
    w_m the share of its evidence in that of all, as of a mixture of boxes (mixture.py).
    others: Solved pages, of any number of vertices.
    """
    hulls, several = [vertices_at_end(solved.solution.values)], [solved]
    for other in others:
        V = vertices_at_end(other.solution.values)
        if all(hausdorff_distance(V, hull) > SAME_MODE for hull in hulls):
            hulls, several = [*hulls, V], [*several, other]
    weights = softmax([-one.cost - one.occam for one in several])
    best, *middles = map(centroid, hulls)
    off = (np.reshape(middles, (-1, 3)) - best) @ solved.linearised.R_wg.T
    J = solved.tangent.maps["position"]
    d = off @ np.linalg.solve(J @ C @ J.T, J @ C)
    return np.einsum("m,mi,mj->ij", weights[1:], d, d)


def _indefinite(kkt: KKTSystem) -> tuple[str, ...]:
    """Name the term and the unknowns along which the reduced Hessian curves down."""
    if kkt.negative is None:
        return ()
    term, direction = kkt.negative
    share = np.abs(direction / kkt.problem.scale)
    worst, where = np.argsort(share)[::-1][:MAX_NAMES], []
    for name, v in kkt.problem.variables.items():
        for i in worst[(worst >= v.first) & (worst < v.span.stop)] - v.first:
            where.append(f"{name}[{i % v.rows}, {i // v.rows}]")
    return (f"{term} along {', '.join(where)}",)


# Constant offsets of the finger positions


def fields_of_offsets(linearisation: Linearisation, tangent) -> dict:
    """Return the fields of an Information that tell of offsets; none if they are known.

    The covariance of the offsets, finger by finger, (3 F, 3 F) [m^2] by the error
    budget; the information by the Hessian about shape and final pose, in their tangent
    space, and the page's own offsets (k + 3 F, k + 3 F).
    """
    variables = linearisation.kkt.problem.variables
    if FINGER_OFFSET not in variables:
        return {}
    span = variables[FINGER_OFFSET].span
    own = np.arange(span.start, span.stop)
    turn = np.kron(np.eye(len(own) // 3), linearisation.R_wg)
    chosen = np.r_[tangent.chosen, own]
    jacobian = block_diag(tangent.jacobian, np.eye(len(own)))
    C = jacobian @ linearisation.kkt.marginal(chosen) @ jacobian.T
    errors = summed(errors_by_name(linearisation.response(own, turn)))
    return {"offsets": errors, "with_offsets": inverse((C + C.T) / 2)}


def prior_of_offsets(scene, fingers: int) -> np.ndarray:
    """Return the information (3 F, 3 F) [1 / m^2] before any touch, ground's frame."""
    if scene.joints is None:
        return np.eye(3 * fingers) / scene.sigma_offset**2
    return block_diag(*scene.joints.information.reshape(-1, 3, 3))
