r"""The covariance that users get: by how much an estimate is off, not how sharp it is.

The inverse Hessian is the covariance of the error only where every term of the
objective is the negative logarithm of a true density.  Here the middle of the sandwich

    C = K^{-1} G K^{-1},   G = sensors + model + assumed + physics

is what each part is known to err: the sensors' noise as it enters (scatter.py),
smoothed and shared between samples and terms; the model error of touched gaps as the
page states it, that of normals as far as residuals show it; priors and regularisers by
their own curvature, as what keeps K from being singular; whole touches that the
estimate cannot bring together, by how far apart it leaves them; physics by a share
PHYSICS of its curvature, since its penalties are no densities, and where it is a hard
constraint by the impulse that such a penalty lets be missing; frictions that were
given, to FRICTION; hard ground, to UNEVEN; faces that nothing touched, to UNSEEN.
The shares are measured: they make sigma cover.
"""

from __future__ import annotations

import numpy as np

from formulations.finger_offset import NAME as OFFSET
from formulations.violation_implicit import WEIGHTS

from ..nlp.kkt import LOOSE
from ..nlp.kkt_sensitivity import Curvature
from .measurement_noise import Sensed, moved_by, scatter, sources, tangential
from .sensitivity import move

PHYSICS = 0.3  # [-] of the physics' curvature is its error: coverage of 20 recordings
BALANCE = WEIGHTS["balance sigma"][0]  # [weights] that may be missing in a step
FRICTION = 0.1  # [-] relative deviation of a coefficient of friction that was given
UNEVEN = {"ground gap": 1.0}  # [REST] deviation of a corner from the hard ground
UNSEEN = 2.0  # [position noise] deviation of a face that only physics tells
TUMBLED = 0.1  # [size] and where it is told by how the object tumbled
ENOUGH = 3  # contact samples that make a face known
DOUBTED = 2.0  # [touch scale] the gap of a whole touch beyond this is no noise
FLAT = 0.99  # [-] cosine between the vertical and the axis of a face on the ground
MEDIAN_2 = 1.1774  # median of the length of a standard normal vector in the plane
PRIORS = ("prior", "regulariser")
AWAY = 0.1  # [m] a body that a finger felt is not farther from there
ANY_TURN = np.pi / np.sqrt(3)  # [rad] deviation of a turn of which nothing is known


def spread(
    curvature: Curvature, pulls, held, sensed: Sensed, window, shape
) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns, SI."""
    problem = curvature.problem
    source = sources(curvature, sensed, window)
    felt = [name for name in curvature.hessians if name == "touch"]
    rest = [name for name in curvature.hessians if name != "touch"]
    by, others = (
        moved_by(curvature, pulls, held, sensed, source, terms=terms)
        for terms in (felt, rest)
    )
    noise = scatter(by[0] + others[0], by[1] + others[1], sensed)
    if felt:
        noise += _model_error(curvature, *by, sensed, window, shape)
    prior = [n for n, term in problem.costs.items() if term.role in PRIORS]
    physics = [n for n, term in problem.costs.items() if term.role == "physics"]
    physics += [*problem.constraints]
    noise += _positive(pulls.T @ (curvature.hessian(prior) @ pulls))
    noise += PHYSICS * _positive(pulls.T @ (curvature.hessian(physics) @ pulls))
    noise += PHYSICS * missing_impulses(curvature, held)
    seen_by_none = pulls / problem.scale[:, None]
    noise += LOOSE * seen_by_none.T @ seen_by_none  # it is a prior of what nothing sees
    for name in ("finger friction", "ground friction"):
        if name in problem.parameters:
            moved = move(curvature, pulls, held, {name: 1.0}, relative=True)
            noise += FRICTION**2 * np.outer(moved, moved)
    for name, deviation in UNEVEN.items():
        if name in problem.constraints:
            slopes = problem.jacobian(name, curvature.x, curvature.data)
            slopes = slopes[:, problem.variables["x"].span]
            rows = window.followed(held[problem.constraints[name].span], slopes)
            noise += deviation**2 * rows.T @ rows
    return (noise + noise.T) / 2


def unheld(C) -> np.ndarray:
    """Return the covariance (k, k) of where the Hessian, of inverse C, curves down.

    Nothing holds what does: no error enters there, and a sandwich would call it known.
    """
    return _positive(-C)


def missing_impulses(curvature: Curvature, held) -> np.ndarray:
    """Return what impulses of BALANCE weights, missing in hard balances, make of it.

    A page reports how such a constraint gives way to one weight, "<its name>, gives".
    """
    problem, total = curvature.problem, np.zeros((held.shape[1],) * 2)
    for name, term in problem.constraints.items():
        if f"{name}, gives" not in problem.reports:
            continue
        gives = problem.value(f"{name}, gives", curvature.x, curvature.data)
        gives = gives.reshape(term.instances, -1, term.kind.rows)  # column by column
        rows = held[term.span].reshape(term.instances, term.kind.rows, -1)
        moved = (gives @ rows).reshape(-1, len(total))
        total += BALANCE**2 * moved.T @ moved
    return total


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
    along = np.einsum("ktfc,tfc->ktf", by_position, data.normal)
    across = tangential(by_normal, data.normal).reshape(k, -1)
    runs = [along[:, t, f].sum(axis=1) for t, f in touches(window, data)]
    runs = np.reshape(runs, (len(runs), k)).T
    off = gaps_of_touches(curvature, window, shape, data).max(initial=0.0)
    apart = 2 * off**2 if off > DOUBTED * touch else 0.0  # two that disagree share it
    along = along.reshape(k, -1)
    noise = gap * along @ along.T + turn * across @ across.T
    return noise + apart * runs @ runs.T


def touches(window, data) -> list:
    """Return (samples, finger) of every touch: a finger's in an action."""
    touch, found = window.touch, {}
    actions = data.action[touch.sample]
    for sample, finger, action in zip(touch.sample, touch.finger, actions, strict=True):
        found.setdefault((action, finger), []).append(sample)
    return [(np.array(samples), finger) for (_, finger), samples in found.items()]


def gaps_of_touches(curvature: Curvature, window, shape, data) -> np.ndarray:
    """Return how far each touch as a whole is from the surface [m], by its median.

    Neither noise nor any body explains it where fingers disagree about a face.  A touch
    of fewer than ENOUGH samples may be a wrong boolean: it counts as none.
    """
    touch = window.touch
    values = curvature.problem.unpack(curvature.x)
    p_wf = touch.p_wf.T.copy()
    if OFFSET in values:
        p_wf[:3] += values[OFFSET][:, touch.finger]
    gap = at_touches(window, shape, values, p_wf, window.finger.gap)[:, 0]
    gap = gap + np.ravel(values.get("depth", 0.0))[0]
    keys = zip(touch.sample, touch.finger, strict=True)
    number = {key: i for i, key in enumerate(keys)}
    return np.array([
        abs(np.median([gap[number[t, finger]] for t in samples]))
        if len(samples) >= ENOUGH else 0.0
        for samples, finger in touches(window, data)
    ])  # fmt: skip


def unseen(chart, shape, faces, noise: float, grounded: bool = True) -> np.ndarray:
    """Return the covariance (k, k) of faces that nothing touched, SI.

    What physics tells of them is no Gaussian: an optimum among others, and too small
    rather than too large where finger paths are noisy (noise [m]).  faces (axes, 2):
    samples that touched each, grounded: so does the ground at the first and the last
    sample; a body whose unknowns are no lengths of sides has none.
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
        if chart.turning == 3:
            deviation = np.hypot(deviation, TUMBLED * chart.z[axis])
        total += deviation**2 * np.outer(way, way)
    return total


def near(C, sizes: int, turning: int) -> np.ndarray:
    """Return the covariance (k, k) of a final pose that lies within AWAY, SI.

    sizes, turning: how many of the first and of the last of k are no position.  Where
    nothing saw the pose, rounding leaves no positive matrix: that is wide, not known.
    """
    widest = np.full(len(C) - sizes, AWAY)
    widest[-turning:] = ANY_TURN
    pose, unit = slice(sizes, None), np.outer(widest, widest)
    values, vectors = np.linalg.eigh(C[pose, pose] / unit)
    C = C.copy()
    C[pose, pose] = (vectors * np.abs(values)) @ vectors.T * unit
    less = C[:, pose] @ np.linalg.solve(C[pose, pose] + np.diag(widest**2), C[pose])
    return C - (less + less.T) / 2


def residual_of_normals(curvature: Curvature, window, shape) -> float:
    """Return the standard deviation of felt normals about the modelled ones [rad]."""
    touch = window.touch
    if not len(touch):
        return 0.0
    values = curvature.problem.unpack(curvature.x)
    normal = at_touches(window, shape, values, touch.p_wf.T, window.finger.normal)
    off = np.linalg.norm(normal - touch.normal, axis=1)
    return float(np.median(off)) / MEDIAN_2


def at_touches(window, shape, values, p_wf, of) -> np.ndarray:
    """Return what a finger's function gives at every touch sample, a row each.

    of(shape, theta, pose, p_wf, rho): window.finger.gap or normal; p_wf (numbers, n).
    """
    import casadi as ca

    touch = window.touch
    seen = window.seen_by_touches(values["theta"])
    sizes = len(seen), window.motion.unknowns, len(p_wf), 1
    symbols = [ca.SX.sym("s", n) for n in sizes]
    theta, x, p, rho = symbols
    found = of(shape, theta, window.motion.pose(shape, theta, x), p, rho)
    modelled = ca.Function("modelled", symbols, [found]).map(len(touch))(
        seen, values["x"][:, touch.pose], p_wf, touch.radius[None]
    )  # fmt: skip
    return np.asarray(modelled).T


def _positive(M) -> np.ndarray:
    """Return the positive part of a symmetric matrix: no term makes errors smaller."""
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
