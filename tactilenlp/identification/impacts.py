"""Time steps of recorded motion, and the vertices that may touch within each.

A step is a sample k with a pose before and one after it; the change of velocity there,
(p_{k+1} - 2 p_k + p_{k-1}) / dt, is caused by the impulses between these two.  The page
`known_trajectory` reads steps and possible touches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations.known_trajectory import SURFACE

from ..problem.window import Rows

NEAR_GROUND = 10e-3  # [m] a vertex that stays higher over a step does not touch
CALM_CHANGE = 0.04, 0.3  # [m/s], [rad/s] a lesser change of velocity is no impact
GLIDE_SPEED = 1.0  # [rad/s] below this and calm, a body rests or glides on a face
GLIDE_KEPT = 4  # one in so many steps of a glide is kept: they are redundant
# Deviation of a change of velocity [m/s], [rad/s], from free flights:
FLIGHT_NOISE = 0.006, 0.04
IMPACT_SIGMA = 0.2  # [1] of a change of velocity: of real impacts from rigid ones
FLIGHT_SAMPLES = 8  # of a fall that measures gravity
# [1] times the median acceleration and its scatter: a bounce, which ends a fall
BOUNCE = 10.0
GRAVITY_SIGMA = 0.016  # [1] of the gravity of one toss (scatter of 76 real ones)
DEEPEST = 20e-3  # [m] that a ground yields
RELEASE = 0.08  # [s]
SETTLED = 0.1  # [s]
LOOSE = 0.5  # [g dt] a greater change of velocity than that of free fall: an impact
MIN_TOSSES = 4  # below which their own scatter is not used


@dataclass(frozen=True, eq=False)
class TossSteps(Rows):
    """All steps: poses now, one sample before (_1) and after (_next), and velocities.

    sample, toss: of `now`; p_wo (n, 3) [m]; R_wo (n, 9) column by column; dv [m/s];
    w, w_1 [rad/s] to the next and from the last sample, world frame, and R_half,
    R_half_1 where the body is then; noise (n, 2) [m/s], [rad/s]; calm (n,) bool: at
    rest or in a glide; resting: left out of these; depth [m]: deviation of corners
    below the ground.
    """

    sample: np.ndarray
    toss: np.ndarray
    p_wo: np.ndarray
    R_wo: np.ndarray
    p_wo_1: np.ndarray
    R_wo_1: np.ndarray
    p_wo_next: np.ndarray
    R_wo_next: np.ndarray
    dv: np.ndarray
    w: np.ndarray
    w_1: np.ndarray
    R_half: np.ndarray
    R_half_1: np.ndarray
    noise: np.ndarray
    resting: np.ndarray
    calm: np.ndarray
    depth: np.ndarray

    def corners(self, vertices: np.ndarray) -> np.ndarray:
        """Return where vertices (V, 3) [m] are now, before, after: (n, V, 3, 3)."""
        poses = (
            (self.p_wo, self.R_wo),
            (self.p_wo_1, self.R_wo_1),
            (self.p_wo_next, self.R_wo_next),
        )
        places = [
            p[:, None] + np.einsum("vi,nij->nvj", vertices, R.reshape(-1, 3, 3))
            for p, R in poses
        ]
        return np.stack(places, axis=2)


@dataclass(frozen=True, eq=False)
class Touches(Rows):
    """Corners that may touch within a step: column of theta, vertex, signs of theta."""

    step: np.ndarray
    column: np.ndarray
    vertex: np.ndarray
    sign: np.ndarray


@dataclass(frozen=True, eq=False)
class TossGroup:
    """Steps (n,) with equally many touches (n, count)."""

    steps: np.ndarray
    touches: np.ndarray


@dataclass(frozen=True, eq=False)
class Impacts:
    """All that the page reads; guess (3, columns) [m]; uniform (3,) [m^2] inertia."""

    step: TossSteps
    touch: Touches
    groups: dict[int, TossGroup]
    columns: int
    vertices: int
    tosses: int
    guess: np.ndarray
    uniform: np.ndarray
    dt: float


def steps_of(toss, position, rotation, dt: float, gravity: float) -> TossSteps:
    """Return the steps of tosses (T,): position (T, 3) [m], rotation: scipy's."""
    from scipy.spatial.transform import Rotation

    k = np.flatnonzero(toss[2:] == toss[:-2]) + 1
    p, R = position, _columns(rotation)
    way_1 = (rotation[k] * rotation[k - 1].inv()).as_rotvec()
    way = (rotation[k + 1] * rotation[k].inv()).as_rotvec()
    dv = (p[k + 1] - 2 * p[k] + p[k - 1]) / dt
    fall = np.linalg.norm(dv + np.array([0, 0, gravity * dt]), axis=1)
    turn = np.linalg.norm(way - way_1, axis=1) / dt
    calm = (np.linalg.norm(dv, axis=1) < CALM_CHANGE[0]) & (turn < CALM_CHANGE[1])
    calm &= np.linalg.norm(way, axis=1) < GLIDE_SPEED * dt
    index = np.unique(toss, return_inverse=True)[1].reshape(-1)[k]
    resting = steps_since(~calm | begins(index)) % GLIDE_KEPT > 0
    return TossSteps(
        sample=k, toss=index, p_wo=p[k], R_wo=R[k], p_wo_1=p[k - 1], R_wo_1=R[k - 1],
        p_wo_next=p[k + 1], R_wo_next=R[k + 1], dv=dv, w=way / dt, w_1=way_1 / dt,
        R_half=_columns(Rotation.from_rotvec(way / 2) * rotation[k]),
        R_half_1=_columns(Rotation.from_rotvec(way_1 / 2) * rotation[k - 1]),
        noise=np.hypot(FLIGHT_NOISE, IMPACT_SIGMA * np.stack([fall, turn], axis=1)),
        resting=resting, calm=calm, depth=np.full(len(k), SURFACE),  # of a hard ground
    )  # fmt: skip


def _columns(rotation) -> np.ndarray:
    """Return rotation matrices (n, 9), column by column."""
    return rotation.as_matrix().transpose(0, 2, 1).reshape(-1, 9)


def begins(toss: np.ndarray) -> np.ndarray:
    """Return which steps are the first of their toss, (n,) bool."""
    return np.diff(toss, prepend=-1) != 0


def steps_since(event: np.ndarray) -> np.ndarray:
    """Return how many steps ago the last event (n,) was: infinity before any, (n,)."""
    k = np.arange(len(event))
    return k - np.maximum.accumulate(np.where(event, k, -np.inf))


def phases_of(steps: TossSteps, gravity: float, dt: float) -> tuple:
    """Return which steps (n,) touch, are of impacts or their end, and lie still.

    A body that a soft ground throws up feels no more force while it is still below: an
    impact ends RELEASE after its last touch.
    """
    pushed = np.linalg.norm(steps.dv + np.array([0, 0, gravity * dt]), axis=1)
    touching = pushed > LOOSE * gravity * dt
    first = begins(steps.toss)
    calm_for = steps_since(~steps.calm | first) * dt
    still = touching & (calm_for > SETTLED)  # on a face
    since = steps_since(touching)
    recent = (since <= steps_since(first)) & (since * dt <= RELEASE)
    return touching, recent & ~still, still


def with_soft_ground(steps: TossSteps, corners, gravity: float, dt: float) -> TossSteps:
    """Return steps whose corners may sink in impacts as deep as they ever do.

    corners (3, V) [m] of a box.
    """
    _, hit, _ = phases_of(steps, gravity, dt)
    lowest = steps.corners(corners.T)[:, :, 0, 2].min(axis=1)
    depth = np.clip(-lowest[hit].min(initial=0.0), SURFACE, DEEPEST)
    return replace(steps, depth=np.where(hit, depth, steps.depth))


def may_touch(steps: TossSteps, vertices: np.ndarray) -> np.ndarray:
    """Return which vertices (V, 3) [m] may touch the ground in which step, (n, V)."""
    low = steps.corners(vertices)[..., 2].min(axis=-1) < NEAR_GROUND
    return low & ~steps.resting[:, None]


def gravity_of(steps: TossSteps, vertices, dt: float) -> tuple[float, float]:
    """Return the gravity [m/s^2] of free falls, and its standard deviation.

    The first steps of each toss in which no vertex is near the ground are one parabola,
    up to a bounce, which comes before where vertices are guessed too near the centre.
    A scale error of the tracker scales the measured gravity alike.  Returns NaN, NaN
    where no toss falls for FLIGHT_SAMPLES samples.
    """
    gravities = []
    high = steps.corners(vertices)[..., 2].min(axis=(1, 2)) > NEAR_GROUND
    for toss in range(steps.toss.max() + 1):
        rows = np.flatnonzero(steps.toss == toss)
        fall = rows[: np.argmin(np.append(high[rows], False))]
        z = before_a_bounce(steps.p_wo[fall, 2])
        if len(z) >= FLIGHT_SAMPLES:
            gravities.append(-2 * np.polyfit(np.arange(len(z)) * dt, z, 2)[0])
    if not gravities:
        return np.nan, np.nan
    mean, count = float(np.mean(gravities)), len(gravities)
    enough = count >= MIN_TOSSES
    sigma = np.std(gravities, ddof=1) if enough else GRAVITY_SIGMA * mean
    return mean, float(sigma / count**0.5)


def before_a_bounce(z: np.ndarray) -> np.ndarray:
    """Return the heights (n,) of a fall up to where the acceleration jumps."""
    if len(z) < FLIGHT_SAMPLES:
        return z
    change = np.diff(z, 2)
    apart = np.abs(change - np.median(change))
    bounce = apart > BOUNCE * max(abs(np.median(change)), np.median(apart))
    return z[: 1 + np.argmax(bounce)] if bounce.any() else z


def impacts(steps: TossSteps, chosen, theta, signs, dt: float) -> Impacts:
    """Return the window of the page: the steps where the chosen vertices may touch.

    chosen (n, V) bool; theta (3, columns) [m] first guess; signs (3, V): vertex v is
    signs[:, v] times column v of theta, or its only one.
    """
    rows = np.flatnonzero(chosen.any(axis=1))
    step, vertex = np.nonzero(chosen[rows])
    column = vertex if theta.shape[1] > 1 else np.zeros_like(vertex)
    touch = Touches(step=step, column=column, vertex=vertex, sign=signs.T[vertex])
    counts, groups = np.bincount(step, minlength=len(rows)), {}
    first = np.cumsum(counts) - counts
    for count in np.unique(counts):
        of = np.flatnonzero(counts == count)
        groups[int(count)] = TossGroup(of, first[of, None] + np.arange(count))
    square = abs(theta).max(axis=1) ** 2
    return Impacts(
        step=steps.pick(rows), touch=touch, groups=groups, columns=theta.shape[1],
        vertices=signs.shape[1], tosses=int(steps.toss.max()) + 1, guess=theta,
        uniform=(square.sum() - square) / 3, dt=dt,
    )  # fmt: skip
