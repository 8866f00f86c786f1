r"""How the noise of the sensors moves an estimate: the middle of H^{-1} G H^{-1}.

An estimate z answers a change of the measurements y by

    dz/dy = - K^{-1} d^2 L / dx dy       (the rows of shape and final pose)

so that its scatter under repeated measurements is (dz/dy) cov(y) (dz/dy)': what the
sensors' noise makes of it, whatever weight a term has in the objective.  Positions act
through all terms (gaps and slip), smoothed first where the estimate smooths them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..data.sensor_noise import Precision, smoothing
from ..errors import PageError
from ..nlp.kkt_sensitivity import Curvature
from ..nlp.term_functions import mapped

STEP = 1e-6  # [-] of a datum, at least of SMALL: of the central differences
SMALL = 1e-2  # [SI]
CODE = 1e-6  # [m] times a measurement's number: shifts that tell them apart
EXACT = 1e-2  # [-] how far a decoded number may lie from a whole one


@dataclass(frozen=True, eq=False)
class Sensed:
    """What was measured, how precisely, and how a window becomes a programme again."""

    data: object
    precision: Precision
    build: Callable


def moved_by(
    curvature: Curvature, pulls, held, sensed: Sensed, source, terms=None
) -> tuple[np.ndarray, np.ndarray]:
    """Return how the chosen unknowns move with what each finger measured.

    By its position and by its normal, (k, T, F, 3) each [SI], through all terms or the
    named ones.  pulls, held: see Curvature.response_of; source: see sources.
    """
    shape = (*sensed.data.contact.shape, 3)
    count = int(np.prod(shape))
    moved = np.zeros((2 * count, pulls.shape[1]))
    for name in curvature.hessians if terms is None else terms:
        term = curvature.problem.terms[name]
        number = source[term.data]
        read = number >= 0
        if not read.any():
            continue
        slope, value = cross(curvature, name, np.nonzero(read.any(axis=0))[0])
        change = np.einsum("ivk,ivd->idk", pulls[term.unknowns], slope)
        if name in curvature.problem.constraints:
            rows = held[term.span].reshape(term.instances, term.kind.rows, -1)
            change += np.einsum("irk,ird->idk", rows, value)
        np.add.at(moved, number[read], -change[read])
    by_position, by_normal = moved.T.reshape(-1, 2, *shape).swapaxes(0, 1)
    return by_position, by_normal


def scatter(by_position, by_normal, sensed: Sensed) -> np.ndarray:
    """Return the covariance (k, k) that the sensors' noise gives the estimate."""
    data, precision, k = sensed.data, sensed.precision, len(by_position)
    raw = np.empty_like(by_position)
    for rows, S in smoothing(data, precision):
        raw[:, rows] = np.einsum("kafc,ab->kbfc", by_position[:, rows], S)
    raw = raw.reshape(k, -1)
    across = tangential(by_normal, data.normal).reshape(k, -1)
    return precision.position**2 * raw @ raw.T + precision.normal**2 * across @ across.T


def tangential(by_normal, normal) -> np.ndarray:
    """Return the part (k, T, F, 3) of moves by normals that keeps their length."""
    along = np.einsum("ktfc,tfc->ktf", by_normal, normal)
    return by_normal - along[..., None] * normal


def cross(curvature: Curvature, name: str, columns: Iterable[int]):
    """Return d^2 L / dx dy and d g / dy of each instance of a term, by its local data.

    (instances, unknowns, data) and (instances, rows, data), by central differences of
    the exact first derivatives; zero for data that are not among `columns`.
    """
    problem = curvature.problem
    term = problem.terms[name]
    kind, first = term.kind, mapped(term.kind.first, term.instances)
    rows, places = (np.array(i, int) for i in kind.jacobian_sparsity.get_triplet())
    weight = curvature.multipliers.get(name, np.ones((term.instances, kind.rows)))
    z, d = curvature.x[term.unknowns].T, curvature.data[term.data].T
    slope = np.zeros((term.instances, len(z), len(d)))
    value = np.zeros((term.instances, kind.rows, len(d)))
    for j in columns:
        step = np.zeros_like(d)
        step[j] = STEP * np.maximum(np.abs(d[j]), SMALL)
        ends = [[np.asarray(o) for o in first(z, d + side * step)] for side in (1, -1)]
        (v, s), (v_1, s_1) = ends
        bend = (s - s_1) / (2 * step[j]) * weight.T[rows]
        np.add.at(slope[:, :, j].T, places, bend)
        value[:, :, j] = ((v - v_1) / (2 * step[j])).T
    return slope, value


def sources(curvature: Curvature, sensed: Sensed, window) -> np.ndarray:
    """Return for every datum of the programme which measurement it is, -1 if none.

    The programme is built again from measurements shifted by CODE times their number:
    positions count from 1, normals after them.
    """
    shape = (*sensed.data.contact.shape, 3)
    count = int(np.prod(shape))
    number = np.arange(1, count + 1).reshape(shape)

    def coded(rows, p_wf, before=0):
        code = np.zeros_like(p_wf)  # a capsule's orientation follows the position
        code[:, :3] = CODE * number[rows.sample - before, rows.finger]
        return p_wf + code

    touch, free, push = window.touch, window.free, window.push
    normal = CODE * (count + number[touch.sample, touch.finger])
    changed = replace(
        window,
        touch=replace(
            touch, p_wf=coded(touch, touch.p_wf), normal=touch.normal + normal
        ),
        free=replace(free, p_wf=coded(free, free.p_wf)),
        push=replace(
            push, p_wf=coded(push, push.p_wf), p_wf_1=coded(push, push.p_wf_1, 1)
        ),
    )
    code = (sensed.build(changed).data() - curvature.problem.data()) / CODE
    whole = np.rint(code)
    if np.abs(code - whole).max(initial=0.0) > EXACT:
        raise PageError(
            "the page computes with measurements before its terms read them",
            where="scatter",
            expected="terms that read positions and normals as they are",
            next="move the computation into the term",
        )
    return whole.astype(int) - 1
