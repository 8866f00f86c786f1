r"""The covariance that users get: by how much an estimate is off, not how sharp it is.

The inverse Hessian is the covariance of the error only where every term of the
objective is the negative logarithm of a true density.  Here the middle of the sandwich

    C = K^{-1} G K^{-1},   G = sensors + model + assumed + physics

is what each part is known to err: the sensors' noise as it enters (scatter.py),
smoothed and shared between samples and terms; the model error of touched gaps as the
page states it, that of normals as far as residuals show it; priors and regularisers by
their own curvature; physics by a share PHYSICS of its curvature, since its penalties
are no densities; frictions that were given, to FRICTION; hard ground, to UNEVEN; faces
that nothing touched, to UNSEEN.  The shares are measured: they make sigma cover.
"""

from __future__ import annotations

import numpy as np

from .curvature import Curvature
from .scatter import Sensed, moved_by, scatter, sources, tangential
from .sensitivity import move

PHYSICS = 0.3  # [-] of the physics' curvature is its error: coverage of 20 recordings
FRICTION = 0.1  # [-] relative deviation of a coefficient of friction that was given
UNEVEN = {"ground gap": 1.0}  # [REST] deviation of a corner from the hard ground
UNSEEN = 2.0  # [position noise] deviation of a face that only physics tells
TUMBLED = 0.1  # [size] and where it is told by how the object tumbled
ENOUGH = 3  # contact samples that make a face known
FLAT = 0.99  # [-] cosine between the vertical and the axis of a face on the ground
MEDIAN_2 = 1.1774  # median of the length of a standard normal vector in the plane
PRIORS = ("prior", "regulariser")


def spread(
    curvature: Curvature, pulls, held, sensed: Sensed, window, shape
) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns, SI."""
    problem = curvature.problem
    source = sources(curvature, sensed, window)
    noise = scatter(*moved_by(curvature, pulls, held, sensed, source), sensed)
    if "touch" in problem.terms:
        by = moved_by(curvature, pulls, held, sensed, source, terms=["touch"])
        noise += _model_error(curvature, *by, sensed, window, shape)
    prior = [n for n, term in problem.costs.items() if term.role in PRIORS]
    physics = [n for n, term in problem.costs.items() if term.role == "physics"]
    physics += [*problem.constraints]
    noise += _positive(pulls.T @ (curvature.hessian(prior) @ pulls))
    noise += PHYSICS * _positive(pulls.T @ (curvature.hessian(physics) @ pulls))
    for name in ("finger friction", "ground friction"):
        if name in problem.parameters:
            moved = move(curvature, pulls, held, {name: 1.0}, relative=True)
            noise += FRICTION**2 * np.outer(moved, moved)
    for name, deviation in UNEVEN.items():
        if name in problem.constraints:
            rows = held[problem.constraints[name].span]
            noise += deviation**2 * rows.T @ rows
    return (noise + noise.T) / 2


def _model_error(curvature, by_position, by_normal, sensed, window, shape):
    """Return what touched gaps and normals that are not as modelled make of it."""
    parameters = curvature.problem.parameters
    k, data, precision = len(by_position), sensed.data, sensed.precision
    touch, normal = (
        float(curvature.data[parameters[name].span][0]) if name in parameters else 0.0
        for name in ("touch scale", "normal scale")
    )
    gap = max(0.0, touch**2 - precision.position**2)
    turn = max(0.0, normal**2 - precision.normal**2)
    turn = min(turn, residual_of_normals(curvature, window, shape) ** 2)
    along = np.einsum("ktfc,tfc->ktf", by_position, data.normal).reshape(k, -1)
    across = tangential(by_normal, data.normal).reshape(k, -1)
    return gap * along @ along.T + turn * across @ across.T


def unseen(
    chart, shape, faces, noise: float, grounded: bool = True, profile=None
) -> np.ndarray:
    """Return the covariance (k, k) of faces that nothing touched, SI.

    What physics tells of them is no Gaussian: an optimum among others, and too small
    rather than too large where finger paths are noisy (noise [m]).  faces (axes, 2):
    samples that touched each, grounded: so does the ground at the first and the last
    sample; profile (n,) [m]: deviation by which their sizes may be off at least; a body
    whose unknowns are no lengths of sides has none.
    """
    n, k = shape.theta, len(chart.z)
    total = np.zeros((k, k))
    if not getattr(shape, "symmetries", ()):
        return total
    known = np.asarray(faces) >= ENOUGH
    for R in (chart.R_first, chart.R) if grounded else ():
        down = np.argmax(np.abs(R[2]))
        known[down, 0 if R[2, down] > 0 else 1] |= abs(R[2, down]) > FLAT
    for axis, (low, high) in enumerate(known):
        if low and high:
            continue
        way = np.zeros(k)
        way[axis] = 1.0
        places = k - n - chart.turning
        way[n : n + places] = (int(low) - int(high)) / 2 * chart.R[:places, axis]
        deviation = UNSEEN * noise
        if profile is not None:
            deviation = max(deviation, profile[axis])
        if chart.turning == 3:
            deviation = np.hypot(deviation, TUMBLED * chart.z[axis])
        total += deviation**2 * np.outer(way, way)
    return total


def residual_of_normals(curvature: Curvature, window, shape) -> float:
    """Return the standard deviation of felt normals about the modelled ones [rad]."""
    import casadi as ca

    touch = window.touch
    if not len(touch):
        return 0.0
    values = curvature.problem.unpack(curvature.x)
    seen = window.seen_by_touches(values["theta"])
    sizes = len(seen), window.motion.unknowns, touch.p_wf.shape[1], 1
    symbols = [ca.SX.sym("s", n) for n in sizes]
    theta, x, p_wf, rho = symbols
    pose = window.motion.pose(shape, theta, x)
    normal = window.finger.normal(shape, theta, pose, p_wf, rho)
    modelled = ca.Function("normal", symbols, [normal]).map(len(touch))(
        seen, values["x"][:, touch.knot],
        touch.p_wf.T, touch.radius[None],
    )  # fmt: skip
    off = np.linalg.norm(np.asarray(modelled).T - touch.normal, axis=1)
    return float(np.median(off)) / MEDIAN_2


def _positive(M) -> np.ndarray:
    """Return the positive part of a symmetric matrix: no term makes errors smaller."""
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
