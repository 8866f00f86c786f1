r"""Compute how errors of measured touches move an estimate: noise and model errors.

An estimate z answers a change of the measurements y by

    dz/dy = - K^{-1} d^2 L / dx dy       (the rows of shape and final pose)

so that its scatter under repeated measurements is (dz/dy) cov(y) (dz/dy)': what the
sensors' noise makes of it, whatever weight a term has in the objective.  Positions act
through all terms (gaps and slip), smoothed first where the estimate smooths them.

Model errors enter in the same way: touched gaps are off by what the page states,
normals by what their residuals show, and whole touches by the gap that the estimate
leaves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from formulations.names import (
    COMPLIANCE,
    DEPTH_OF_TOUCH,
    FINGER_OFFSET,
    FINGER_TURN,
    INDENTATION,
)

from ..data.contact_segments import rate_of
from ..data.sensor_noise import RAYLEIGH_MEDIAN, smoothing_matrices
from ..errors import PageError
from ..geometry.faces import KNOWN_FACE
from ..geometry.transforms import rotate_back
from ..nlp.kkt import KKTSystem
from ..problem.fingertips import moved, touch_scales
from ..problem.job import Job

DATUM_STEP = 1e-6  # [-] of a datum within DATA: of the central differences
DATA = 1e-2, 1.0  # [SI]: far from the world's origin touches curve as near to it
CODE = 1e-6  # [m] times a measurement's number: shifts that tell them apart
WHOLE_NUMBER = 1e-2  # [-] how far a decoded number may lie from a whole one
CONTRADICTION = 2.0  # [touch scale] the gap of a whole touch beyond this is no noise


@dataclass(frozen=True, eq=False)
class MixedDerivatives:
    """d^2 L / dx dy and dg / dy of a term, for the measurements y that it reads.

    slope (instances, unknowns, data); value (instances, rows, data), None of a cost;
    number (instances, data): which measurement each datum is, -1 if none.
    """

    term: object
    slope: np.ndarray
    value: np.ndarray | None
    number: np.ndarray


def mixed_derivatives(kkt: KKTSystem, job: Job, window) -> list[MixedDerivatives]:
    """Return the mixed derivatives of every term that reads measurements of a job."""
    source, mixed = measurement_numbers(kkt, job, window), []
    for name, term in kkt.problem.terms.items():
        number = source[term.data]
        columns = np.nonzero((number >= 0).any(axis=0))[0]
        if len(columns):
            slope, value = _differences(kkt, name, columns)
            value = value if name in kkt.problem.constraints else None
            mixed.append(MixedDerivatives(term, slope, value, number))
    return mixed


def sensitivity_to_measurements(
    through: Iterable[MixedDerivatives], data, by_gradient, by_constraint
) -> tuple[np.ndarray, np.ndarray]:
    """Return how the chosen unknowns move with what each finger measured.

    By its position and by its normal, (k, T, F, 3) each [SI], through some terms.
    by_gradient, by_constraint: see KKTSystem.sensitivity.
    """
    shape = (*data.contact.shape, 3)
    sensitivity = np.zeros((2 * int(np.prod(shape)), by_gradient.shape[1]))
    for mixed in through:
        term, read = mixed.term, mixed.number >= 0
        change = np.einsum("ivk,ivd->idk", by_gradient[term.unknowns], mixed.slope)
        if mixed.value is not None:
            rows = by_constraint[term.span].reshape(*mixed.value.shape[:2], -1)
            change += np.einsum("irk,ird->idk", rows, mixed.value)
        np.add.at(sensitivity, mixed.number[read], -change[read])
    by_position, by_normal = sensitivity.T.reshape(-1, 2, *shape).swapaxes(0, 1)
    return by_position, by_normal


def sensor_covariance(by_position, by_normal, job: Job) -> np.ndarray:
    """Return the covariance (k, k) that the sensors' noise gives the estimate."""
    data, precision, k = job.data, job.precision, len(by_position)
    raw = np.empty_like(by_position)
    for rows, S in smoothing_matrices(data, precision):
        raw[:, rows] = np.einsum("kafc,ab->kbfc", by_position[:, rows], S)
    raw = raw.reshape(k, -1)
    across = tangential(by_normal, data.normal).reshape(k, -1)
    return precision.position**2 * raw @ raw.T + precision.normal**2 * across @ across.T


def tangential(by_normal, normal) -> np.ndarray:
    """Return the part (k, T, F, 3) of moves by normals that keeps their length."""
    along = np.einsum("ktfc,tfc->ktf", by_normal, normal)
    return by_normal - along[..., None] * normal


def _differences(kkt: KKTSystem, name: str, columns: Iterable[int]):
    """Return d^2 L / dx dy and d g / dy of each instance of a term, by its local data.

    (instances, unknowns, data) and (instances, rows, data), by central differences of
    the exact first derivatives; zero for data that are not among `columns`.
    """
    problem = kkt.problem
    term = problem.terms[name]
    function, first = term.function, partial(term.function.evaluated, "first")
    rows, places = (np.array(i, int) for i in function.jacobian_sparsity.get_triplet())
    weight = kkt.multipliers.get(name, np.ones((term.instances, function.rows)))
    z, d = kkt.x[term.unknowns].T, kkt.data[term.data].T
    slope = np.zeros((term.instances, len(z), len(d)))
    value = np.zeros((term.instances, function.rows, len(d)))
    for j in columns:
        step = np.zeros_like(d)
        step[j] = DATUM_STEP * np.clip(np.abs(d[j]), *DATA)
        (v, s), (v_1, s_1) = (first(z, d + side * step) for side in (1, -1))
        bend = (s - s_1) / (2 * step[j]) * weight.T[rows]
        np.add.at(slope[:, :, j].T, places, bend)
        value[:, :, j] = ((v - v_1) / (2 * step[j])).T
    return slope, value


def measurement_numbers(kkt: KKTSystem, job: Job, window) -> np.ndarray:
    """Return for every datum of the programme which measurement it is, -1 if none.

    The problem is built again from measurements shifted by CODE times their number:
    positions count from 1, normals after them.
    """
    shape = (*job.data.contact.shape, 3)
    count = int(np.prod(shape))
    number = np.arange(1, count + 1).reshape(shape)

    def coded(rows, p_wf, sample=None):
        sample = rows.sample if sample is None else sample
        return moved(p_wf, CODE * number[sample, rows.finger])

    touch, free, push = window.touch, window.free, window.push
    normal = CODE * (count + number[touch.sample, touch.finger])
    changed = replace(
        window,
        touch=replace(
            touch, p_wf=coded(touch, touch.p_wf), normal=touch.normal + normal
        ),
        free=replace(free, p_wf=coded(free, free.p_wf)),
        push=replace(
            push,
            p_wf=coded(push, push.p_wf),
            p_wf_1=coded(push, push.p_wf_1, push.before),
        ),
    )
    code = (job.build(changed).data() - kkt.problem.data()) / CODE
    whole = np.rint(code)
    if np.abs(code - whole).max(initial=0.0) > WHOLE_NUMBER:
        raise PageError(
            "the page computes with measurements before its terms read them",
            where="sigma",
            expected="terms that read positions and normals as they are",
            next="move the computation into the term",
        )
    return whole.astype(int) - 1


def model_error(kkt, by_position, by_normal, job: Job, window) -> np.ndarray:
    """Return the covariance (k, k) by touched gaps and normals that are off the model.

    by_position, by_normal: how the estimate moves with both, through the touches alone.
    """
    k, data, precision = len(by_position), job.data, job.precision
    touch, normal = touch_scales(kkt.problem, kkt.data) or (0.0, 0.0)
    gap = max(0.0, touch**2 - precision.position**2)
    turn = max(0.0, normal**2 - precision.normal**2)
    turn = min(turn, residual_of_normals(kkt, window) ** 2)
    along = np.einsum("ktfc,tfc->ktf", by_position, data.normal)
    across = tangential(by_normal, data.normal).reshape(k, -1)
    felt = along[:, window.touch.sample, window.touch.finger]
    whole = [felt[:, rows].sum(axis=1) for rows in touches(window, data).values()]
    whole = np.reshape(whole, (len(whole), k)).T
    off = gaps_of_touches(kkt, window, data).max(initial=0.0)
    # Two that disagree share it.
    apart = 2 * off**2 if off > CONTRADICTION * touch else 0.0
    along = along.reshape(k, -1)
    noise = gap * along @ along.T + turn * across @ across.T
    return noise + apart * whole @ whole.T


def touches(window, data) -> dict[tuple[int, int], list[int]]:
    """Return the rows of window.touch of every touch, by action and finger."""
    touch, rows_of = window.touch, {}
    keys = zip(data.action[touch.sample].tolist(), touch.finger.tolist(), strict=True)
    for row, key in enumerate(keys):
        rows_of.setdefault(key, []).append(row)
    return rows_of


def gaps_of_touches(kkt: KKTSystem, window, data) -> np.ndarray:
    """Return how far each touch as a whole is from the surface [m], by its median.

    Where fingers disagree about a face, neither noise nor any body explains the gap.  A
    touch of fewer than KNOWN_FACE samples may be a wrong boolean: its gap counts as 0.
    """
    touch = window.touch
    values = kkt.problem.unpack(kkt.x)
    p_wf = touch.p_wf
    if FINGER_OFFSET in values:
        p_wf = moved(p_wf, values[FINGER_OFFSET].T[touch.finger])
    gap = at_touches(window, values, p_wf.T, window.finger.gap)[:, 0]
    parameters = kkt.problem.parameters
    if COMPLIANCE in parameters:
        inside = kkt.problem.value(INDENTATION, kkt.x, kkt.data)
        gap = gap + inside[:, 0]
    else:  # compliance that is estimated may stand for another error of the fingers
        gap = gap + np.ravel(values.get(DEPTH_OF_TOUCH, 0.0))[0]
    off = [
        abs(np.median(gap[rows])) if len(rows) >= KNOWN_FACE else 0.0
        for rows in touches(window, data).values()
    ]
    return np.array(off)


def residual_of_normals(kkt: KKTSystem, window) -> float:
    """Return the standard deviation of felt normals about the modelled ones [rad]."""
    touch = window.touch
    if not len(touch):
        return 0.0
    values = kkt.problem.unpack(kkt.x)
    normal = at_touches(window, values, touch.p_wf.T, window.finger.normal)
    off = np.linalg.norm(normal - aligned_normals(touch, values), axis=1)
    return float(np.median(off)) / RAYLEIGH_MEDIAN


def aligned_normals(touch, values) -> np.ndarray:
    """Return the felt normals (n, 3) as sensors that are not turned would tell them."""
    if FINGER_TURN not in values:
        return touch.normal
    return rotate_back(touch.normal, values[FINGER_TURN].T[touch.finger])


def at_touches(window, values, p_wf, of) -> np.ndarray:
    """Return what a finger's function gives at every touch sample, a row each.

    of(shape, theta, pose, p_wf, rho): window.finger.gap or normal; p_wf (numbers, n).
    """
    import casadi as ca

    touch, shape = window.touch, window.shape
    seen = window.seen_by_touches(values["theta"])
    sizes = len(seen), window.motion.unknowns, len(p_wf), 1
    symbols = [ca.SX.sym("s", n) for n in sizes]
    theta, x, p, rho = symbols
    value = of(shape, theta, window.motion.pose(shape, theta, x), p, rho)
    modelled = ca.Function("modelled", symbols, [value]).map(len(touch))(
        seen, values["x"][:, touch.pose], p_wf, touch.radius[None]
    )  # fmt: skip
    return np.asarray(modelled).T


def fingers_earlier(window, data, lag: float):
    """Return the window with all fingers where they were a lag [s] earlier.

    Ways within a sample stay: with slopes of slips by accelerations, which change where
    a finger sticks or slides, Newton steps on the latency end too early (21 of 33 ms).
    """
    rate = rate_of(data, data.finger_position)
    return window.with_fingers(
        lambda rows, p_wf: moved(p_wf, -lag * rate[rows.sample, rows.finger])
    )
