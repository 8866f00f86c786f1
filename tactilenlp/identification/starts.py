"""Starts of an identification: steps, first guesses, the gauge, and their checks.

The lowest corner of a box with half widths h is at the height

    z - sum_i h_i |R_3i|

over the ground, z that of its centre: linear in h.  It is positive in free flight, not
positive at some sample of an impact, and zero at rest.  Least absolute violations of
these (in)equalities are a linear programme: its optimum is global, and a ground that
yields in impacts does not bias it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..common.layout import has_volume
from ..common.validation import numbers_of
from ..errors import MeasurementError, MotionError, OptionError
from ..problem.poses import rotations_on_ground
from .impacts import MIN_TOSSES, TossSteps, gravity_of, phases_of, steps_of

CUBE_SIGNS = np.array(np.meshgrid([-1.0, 1], [-1.0, 1], [-1.0, 1])).reshape(3, 8)
LARGEST_GAUGE = 0.1  # [1] error of a tracker's metre; beyond it, dt or unit is wrong
SURE = 3.0  # [sigma] from which free falls contradict dt and unit
# Samples of a toss, which begins in the air: as many as are one parabola, since at low
# rates the first ones include the landing.
FIRST_SAMPLES = 16, 12, 9, 7, 5
ONE_PARABOLA = 3.0, 0.2e-3  # [-] misfit of more samples over that of the fewest, [m]
ALIKE, FAR_FALL = 0.2, 0.25  # [1] scatter of their gravity, its logarithmic error
LEAST_ACCELERATION = 1e-9  # [m/s^2]
TILTED, FLAT = 5.0, 2.0  # [deg] medians at rest that tell xyzw from wxyz
PULL = 0.02  # [samples] on each half width
LARGEST_HALF = 1.0  # [m]
SAME = 1e-3  # [m] boxes that differ less are one start
WIDEST = 2.0  # [1] of the box most like a cube: where nothing bounds a half width
REST_WEIGHT = 0.03  # [samples] of a sample at rest: many are alike
REST_DEPTH = 0.2e-3  # [m] that a ground yields below a body at rest
LEAST_HALF = 1e-3  # [m]


class Starts(NamedTuple):
    """What fits start from.

    steps: of the motion, in the ground's frame; thetas: (3, columns) [m] each; signs
    (3, V): of the vertices; gauge: with its sigma.
    """

    steps: TossSteps
    thetas: list
    signs: np.ndarray
    gauge: tuple[float, float]


def starts_of(trajectories, scene, shape, guess, gauge) -> Starts:
    """Return what fits of a recorded motion start from; arguments of identify_body."""
    where = scene.ground.to_ground(trajectories.position)
    where = where - [*where[:, :2].mean(axis=0), 0]  # slopes turn about the middle
    fall = trajectories.dt, scene.gravity

    def read(wxyz, scale=1.0):
        rotation = rotations_on_ground(scene.ground, wxyz)
        return steps_of(trajectories.toss, scale * where, rotation, *fall)

    if gauge is None and scene.gravity > 0:
        _check_fall(trajectories.toss, where[:, 2], *fall)
    steps = read(trajectories.quaternion)
    if guess is None:
        support = support_of(steps, scene.gravity, trajectories.dt)
        if support is None or support.like_cube.max() >= LARGEST_HALF:
            raise nothing_lands(steps)
        if shape == "cuboid":
            _check_order(steps, read(np.roll(trajectories.quaternion, 1, axis=1)), fall)
        starts, signs = [half[:, None] for half in support.starts()], CUBE_SIGNS
        if shape == "corners":
            starts, signs = [starts[0] * CUBE_SIGNS], CUBE_SIGNS**2
    else:
        theta, signs = _guess_of(guess, shape)
        starts = [theta]
    ruler = _gauge(gauge, steps, (starts[0] * signs).T, fall)
    steps = read(trajectories.quaternion, ruler[0])
    if guess is None:
        starts = [ruler[0] * theta for theta in starts]
    return Starts(steps, starts, signs, ruler)


def nothing_lands(steps: TossSteps) -> MotionError:
    """Return the error of motion in which nothing touches the ground."""
    return MotionError(
        "no corner comes near the ground", where="trajectories",
        got=f"origins at {1e3 * steps.p_wo[:, 2].min():.0f} mm and higher",
        expected="tosses that land", next="check scene.ground, or give a guess",
    )  # fmt: skip


def _guess_of(guess, shape) -> tuple:
    """Return theta (3, columns) [m] and signs (3, V) of a user's guess."""
    cuboid = shape == "cuboid"
    sizes, unit = ((3,), "[m], half widths") if cuboid else (("V", 3), "[m], vertices")
    of_guess = "guess", guess, OptionError, *sizes
    theta = numbers_of(*of_guess, unit=unit, finite=True, positive=cuboid)
    if not (cuboid or has_volume(theta)):
        raise OptionError(
            "no body", where="guess", got=f"{len(theta)} vertices without a volume",
            expected="vertices whose convex hull has a volume",
        )  # fmt: skip
    return (theta[:, None], CUBE_SIGNS) if cuboid else (theta.T, np.ones(theta.T.shape))


def _gauge(gauge, steps, vertices, fall) -> tuple[float, float]:
    """Return metres per metre of the tracker and its deviation, or MeasurementError.

    1 where it is not asked for and free falls do not tell it.
    """
    dt, gravity = fall
    if gauge is not None or gravity == 0:
        return gauge or 1.0, 0.0
    g, sigma = gravity_of(steps, vertices, dt)
    if not g > 0:
        return 1.0, 0.0
    ratio, deviation = gravity / g, gravity / g**2 * sigma
    if abs(ratio - 1) <= LARGEST_GAUGE:
        return ratio, deviation
    few = steps.toss.max() + 1 < MIN_TOSSES  # one may have been held by a hand
    if abs(g - gravity) < SURE * sigma or (few and abs(np.log(g / gravity)) < FAR_FALL):
        return 1.0, 0.0
    raise _wrong_fall(g, dt, gravity)


def _check_fall(toss, height, dt, gravity) -> None:
    """Raise MeasurementError where the first samples fall alike, but not with gravity.

    height (T,) [m].  Tosses that begin in a hand or on the ground scatter.
    """
    heights = [height[toss == number] for number in np.unique(toss)]
    falls = [_first_fall(heights, count, dt) for count in FIRST_SAMPLES]
    factor, exact = ONE_PARABOLA
    most = factor * falls[-1][1] + exact
    gravities = next(found for found, misfit in falls if misfit <= most)
    if len(gravities) < MIN_TOSSES:
        return
    g = float(np.median(gravities))
    spread = float(np.median(abs(np.array(gravities) - g)))
    if (
        spread < ALIKE * abs(g)
        and abs(np.log(max(g, LEAST_ACCELERATION) / gravity)) > FAR_FALL
    ):
        raise _wrong_fall(g, dt, gravity)


def _first_fall(heights, count: int, dt) -> tuple[list, float]:
    """Return the gravity [m/s^2] by the first samples of each toss, and the misfit [m].

    Of a parabola through `count` samples, of tosses that have so many; the misfit is
    the median over tosses of the root of the mean square.
    """
    time, gravities, misfits = np.arange(count) * dt, [], []
    for z in (z[:count] for z in heights if len(z) >= count):
        curve = np.polyfit(time, z, 2)
        gravities.append(-2 * curve[0])
        off = z - np.polyval(curve, time)
        misfits.append(np.sqrt((off**2).sum() / (count - 3)))
    return gravities, float(np.median(misfits)) if misfits else np.inf


def _wrong_fall(g, dt, gravity) -> MeasurementError:
    """Return the error for free falls at g instead of gravity [m/s^2]."""
    fix = "check that positions are in metres, z up"
    if g > 0:
        would = dt * np.sqrt(g / gravity)
        fix = f"check dt (it would be {would:.3g} s) and that positions are in metres"
    return MeasurementError(
        "free falls contradict the interval or the unit", where="dt, position",
        got=f"{g:.3g} m/s^2 in free falls", expected=f"about {gravity:.3g}",
        next=f"{fix}, or give gauge",
    )  # fmt: skip


def _check_order(steps, rolled, fall) -> None:
    """Raise MeasurementError where boxes lie flat if quaternions are read as xyzw."""
    dt, gravity = fall
    as_wxyz, as_xyzw = (tilt_at_rest(read, gravity, dt) for read in (steps, rolled))
    if as_wxyz > TILTED and as_xyzw < FLAT:
        raise MeasurementError(
            "looks like xyzw", where="quaternion",
            got=f"boxes at rest tilted by {as_wxyz:.0f} deg, as xyzw by {as_xyzw:.1f}",
            expected="wxyz", next="give np.roll(quaternion, 1, axis=1)",
        )  # fmt: skip


@dataclass(frozen=True)
class Support:
    """Half widths (3,) [m] that explain the heights equally well.

    Those most like a cube, the least and the largest.
    """

    like_cube: np.ndarray
    least: np.ndarray
    largest: np.ndarray

    def starts(self) -> list[np.ndarray]:
        """Return half widths (3,) [m] to start from."""
        largest = np.minimum(self.largest, WIDEST * self.like_cube)
        middle = (self.least + largest) / 2
        near = abs(largest - self.least).max() < SAME
        return [middle] if near else [middle, self.like_cube, largest]


def support_of(steps: TossSteps, gravity: float, dt: float) -> Support | None:
    """Return the boxes that fit the heights of the centre; None if nothing touches."""
    touching = phases_of(steps, gravity, dt)[0]
    if not touching.any():
        return None
    R = np.stack([steps.R_wo_1, steps.R_wo, steps.R_wo_next], axis=1)
    extent = abs(R.reshape(-1, 3, 3, 3)[..., 2])
    height = np.stack([steps.p_wo_1, steps.p_wo, steps.p_wo_next], axis=1)[..., 2]
    cube = np.full(3, max(height[touching].min(), LEAST_HALF))
    rows = _rows_of(steps, extent, height, gravity, dt)
    alike = (np.eye(3), cube, [PULL] * 3), (-np.eye(3), -cube, [PULL] * 3)
    like_cube = _half_widths(*map(np.concatenate, zip(rows, *alike, strict=True)), 0.0)
    return Support(like_cube, _half_widths(*rows, PULL), _half_widths(*rows, -PULL))


def tilt_at_rest(steps: TossSteps, gravity: float, dt: float) -> float:
    """Return how far a box is from lying on a face at rest [deg], median of tosses."""
    _, _, still = phases_of(steps, gravity, dt)
    up = abs(steps.R_wo.reshape(-1, 3, 3)[:, :, 2]).max(axis=1)
    tilt = np.degrees(np.arccos(np.minimum(up, 1.0)))
    tosses = np.unique(steps.toss[still])
    if not len(tosses):
        return 0.0
    return float(
        np.median([np.median(tilt[still & (steps.toss == k)]) for k in tosses])
    )


def _rows_of(steps, extent, height, gravity, dt) -> tuple:
    """Return A (m, 3), b (m,) and weights (m,): violations max(A h - b, 0)."""
    touching, hit, still = phases_of(steps, gravity, dt)
    free, impact = ~(hit | still), touching & ~steps.calm
    size = height[touching].min()
    lowest = (height - size * extent.sum(axis=2)).argmin(axis=1)
    low = np.arange(len(steps)), lowest
    rest, level = extent[still, 1], height[still, 1]
    parts = [
        (extent[free].reshape(-1, 3), height[free].ravel(), 1 / 3),
        (-extent[low][impact], -height[low][impact], 1.0),
        (rest, level + REST_DEPTH, REST_WEIGHT),
        (-rest, -level + REST_DEPTH, REST_WEIGHT),
    ]
    A, b = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return A, b, np.concatenate([np.full(len(part[1]), part[2]) for part in parts])


def _half_widths(A, b, weight, pull: float) -> np.ndarray:
    """Return half widths (3,) of least violation, pulled to small or large ones."""
    from scipy.optimize import linprog
    from scipy.sparse import hstack, identity

    rows = hstack([A, -identity(len(b))]).tocsr()
    bounds = [(LEAST_HALF, LARGEST_HALF)] * 3 + [(0, None)] * len(b)
    return linprog(np.r_[np.full(3, pull), weight], rows, b, bounds=bounds).x[:3]
