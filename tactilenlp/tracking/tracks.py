"""Tracks of bodies side by side: what they are, how they begin, selection, splitting.

A track is a Gaussian of size and planar pose, with its evidence.  After an action the
best distinct tracks and some of every yaw and place are kept, and split.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.deadline import Deadline
from ..data.contact_segments import lasting_contacts, tracked_samples
from ..data.measurements import Measurements
from ..data.scene import typical_friction
from ..errors import MotionError
from ..problem.job import Job
from ..problem.missing_samples import unseen_contact
from ..problem.reductions import coasts
from .filter_steps import begin_compilation
from .geometry import Geometry, geometry_of

# Tracks kept after an action, and what they are split into: of 120 noisy recordings 11
# miss the best optimum known by over 0.5 nats with 200, these 2.
KEPT, TRACKS = 300, 1000
HOPELESS = 60.0  # [nats] behind the best
MOST_KEPT = 0.8  # [-] if more than so many tracks survive, copying them saves nothing
JITTER = 1e-14  # [SI^2] added to covariances before they are factorised
CELL = 6e-4, 6e-4, 0.02  # [m, m, rad] of sizes, place, yaw: tracks this close are one
YAW_CELL = 0.15  # [rad] as wide as a proposal
# Of 419 boxes 400 reach the best optimum known with 200 tracks and cells of yaw alone,
# 407 with these; 15 and 45 mm, which first boxes often have, are not at their borders.
COARSE_CELL = 11e-3, 11e-3, YAW_CELL  # [m, m, rad] as CELL
LEAST_EIGENVALUE = 1e-12  # [-] of the largest: what rounding leaves of an exact state
SPREAD, SHRUNK = 0.8, 0.4  # [deviations] of the parts of a split; their variance
PRESS = 0.7, 1.0  # [weights] median, deviation of the logarithm, of a push on a top
GAP_SIGMA, NORMAL_SIGMA = 0.25e-3, 0.075  # [m], [rad] model errors of a touch


@dataclass(frozen=True, eq=False)
class Tracks:
    """Hypotheses side by side: z (n + 3, S), P (n + 3, n + 3, S), evidence (S,).

    evidence [nats]; press (fingers, S) [weights]: of each finger that is on the top;
    motion (3, S) of the last sample.
    """

    z: np.ndarray
    P: np.ndarray
    evidence: np.ndarray
    press: np.ndarray
    motion: np.ndarray

    def pick(self, rows) -> Tracks:
        """Return the chosen tracks."""
        return Tracks(*(array[..., rows] for array in vars(self).values()))


@dataclass(frozen=True, eq=False)
class SmootherStep:
    """What the smoother needs of a sample: before and after correction and selection.

    since: the sample tracked before, from which on the body may have moved; slopes
    (3, n + 3, S) of the predicted motion, None if nothing moved; parents: of each
    track after selection, among those before; None: none was dropped or split.
    """

    since: int
    sample: int
    predicted: np.ndarray
    predicted_P: np.ndarray
    slopes: np.ndarray | None
    z: np.ndarray
    P: np.ndarray
    parents: np.ndarray | None

    def selected(self, rows) -> SmootherStep:
        """Return the record of some of its tracks, rows, which may repeat."""
        parents = rows if self.parents is None else self.parents[rows]
        return replace(self, z=self.z[:, rows], P=self.P[..., rows], parents=parents)


@dataclass(frozen=True, eq=False)
class KalmanFilter:
    """What a filter (`ekf`) reads: data, contacts (T, F), noise, friction, lower bound.

    tracked (T,): which samples are; felt: contacts that last; hidden: samples that were
    missed and may be contacts; coasts: whether nothing brakes the body; process_noise:
    factor of the deviations of a predicted motion.
    """

    data: Measurements
    tracked: np.ndarray
    felt: np.ndarray
    hidden: np.ndarray
    noise: tuple[float, float]
    friction: tuple[float, float]
    low: np.ndarray
    coasts: bool
    deadline: Deadline
    geometry: Geometry
    process_noise: float


def filter_of(job: Job, data) -> KalmanFilter:
    """Return the filter of a job, of data as spherical fingertips would measure them.

    Gaps are as uncertain as the fingers' positions.
    """
    scene = job.scene
    place = np.hypot(job.precision.position, scene.typical_offset)
    noise = np.hypot(GAP_SIGMA, place), np.hypot(NORMAL_SIGMA, job.precision.normal)
    n = job.shape.theta
    low = np.r_[np.full(n, job.shape.bounds[0]), np.full(3, -np.inf)][:, None]
    felt, tracked = lasting_contacts(data), np.zeros(data.samples, bool)
    tracked[tracked_samples(data)] = True
    begin_compilation(job.shape, data.fingers)
    return KalmanFilter(
        data, tracked, felt, unseen_contact(data), noise, typical_friction(scene), low,
        coasts(scene), job.deadline, geometry_of(job.shape), job.search.process_noise,
    )  # fmt: skip


def new_tracks(z, P, fingers: int, rng) -> Tracks:
    """Return tracks from states z (n + 3, S) and covariances P."""
    S = z.shape[1]
    press = draw_presses(fingers, S, rng)
    return Tracks(z, P, np.zeros(S), press, np.zeros((3, S)))


def draw_presses(fingers, S, rng):
    """Return drawn weights (fingers, S) with which each finger presses on a top."""
    return PRESS[0] * np.exp(PRESS[1] * rng.normal(size=(fingers, S)))


def surviving(tracks):
    """Prune tracks: return those within HOPELESS nats of the best, None if most are."""
    rows = np.flatnonzero(tracks.evidence > tracks.evidence.max() - HOPELESS)
    return rows if len(rows) < MOST_KEPT * tracks.z.shape[1] else None


def split_tracks(ekf, tracks, final, rng):
    """Select distinct tracks; return them split (Gaussian mixture), and from which."""
    order = np.argsort(-tracks.evidence, kind="stable")
    order = order[np.isfinite(tracks.P[..., order]).all(axis=(0, 1))]
    if not len(order):
        raise MotionError(
            "no track of the body is left", where="search",
            got="states that are not finite", expected="a motion of the body",
            next="look for fingers or times that jump",
        )  # fmt: skip
    tracks = replace(tracks, P=_made_definite(tracks.P, order))
    order = order[tracks.evidence[order] > tracks.evidence[order[0]] - HOPELESS]
    cells = np.round(tracks.z[:, order] / ekf.geometry.each(*CELL)[:, None])
    _, first = np.unique(cells, axis=1, return_index=True)
    order = order[np.sort(first)]
    coarse = np.round(tracks.z[:, order] / ekf.geometry.each(*COARSE_CELL)[:, None])
    chosen = order[diverse(KEPT, coarse[-1:], coarse)]
    if final:
        return tracks.pick(chosen), chosen
    each = int(np.clip(round(TRACKS / len(chosen)), 1, 8))
    rows = np.repeat(chosen, each)
    return parts_of(ekf, tracks, rows, rng), rows


def diverse(count: int, *cells) -> np.ndarray:
    """Stratified selection: return which of tracks, ordered by evidence, are kept.

    cells (k, S): whole numbers, each column a cell.  The places are shared alike by the
    best tracks, and in turn by the cells of each kind: only the next actions may tell
    whether a face or an edge was touched first, and where.
    """
    best, *shares = (len(s) for s in np.array_split(range(count), 1 + len(cells)))
    kept = np.arange(cells[0].shape[1]) < best
    for kind, places in zip(cells, shares, strict=True):
        others = np.flatnonzero(~kept)
        order = np.argsort(_turns(kind)[others], kind="stable")
        kept[others[order[:places]]] = True
    return np.flatnonzero(kept)


def _turns(cells) -> np.ndarray:
    """Return how many columns of cells (k, S) before each one are in its cell."""
    _, cell = np.unique(cells, axis=1, return_inverse=True)
    order = np.argsort(cell.ravel(), kind="stable")
    members, turn = cell.ravel()[order], np.empty(cells.shape[1], int)
    turn[order] = np.arange(len(order)) - np.searchsorted(members, members)
    return turn


def _made_definite(P, rows):
    """Return covariances (k, k, S), those of some rows positive beyond rounding."""
    each = np.moveaxis(P[..., rows], -1, 0)
    values, vectors = np.linalg.eigh(each)
    least = LEAST_EIGENVALUE * values[:, -1:]
    low = values[:, 0] < least[:, 0]
    if not low.any():
        return P
    values = np.maximum(values, least)[low, None]
    made = (vectors[low] * values) @ vectors[low].transpose(0, 2, 1)
    P = P.copy()
    P[..., rows[low]] = np.moveaxis(made, 0, -1)
    return P


def parts_of(ekf, tracks, rows, rng) -> Tracks:
    """Return tracks split: the rows, each repeated as often as it has parts, in order.

    The first part stays; the others are off by a random deviation and narrower.
    """
    part = np.r_[False, rows[1:] == rows[:-1]]
    parts = tracks.pick(rows)
    L = np.linalg.cholesky(np.moveaxis(parts.P, -1, 0) + JITTER * np.eye(len(parts.P)))
    off = np.einsum("sij,sj->is", L, rng.normal(size=(len(rows), len(parts.P))))
    z = np.maximum(parts.z + SPREAD * part * off, ekf.low)
    P = parts.P * np.where(part, SHRUNK, 1.0)
    press = draw_presses(len(parts.press), len(rows), rng)
    return replace(parts, z=z, P=P, press=press)
