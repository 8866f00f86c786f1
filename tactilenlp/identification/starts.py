"""Starts of an identification: steps, first guesses, the gauge, and their checks."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..common.layout import has_volume
from ..common.validation import as_floats
from ..errors import MeasurementError, MotionError, OptionError, shortened
from ..geometry.transforms import rotation_of
from .impacts import MIN_TOSSES, Steps, gravity_of, steps_of
from .support import LARGEST_HALF, support_of, tilt_at_rest

CUBE_SIGNS = np.array(np.meshgrid([-1.0, 1], [-1.0, 1], [-1.0, 1])).reshape(3, 8)
LARGEST_GAUGE = 0.1  # [1] error of a tracker's metre; beyond it, dt or unit is wrong
SURE = 3.0  # [sigma] from which free falls contradict dt and unit
FIRST_SAMPLES = 16  # of a toss, which begins in the air
ALIKE, FAR_OFF = 0.2, 0.25  # [1] scatter of their gravity, its logarithmic error
LEAST_ACCELERATION = 1e-9  # [m/s^2]
TILTED, FLAT = 5.0, 2.0  # [deg] medians at rest that tell xyzw from wxyz


def prepared(trajectories, scene, shape, guess, gauge) -> tuple:
    """Return steps in the ground's frame, starts, signs, and the gauge with sigma.

    starts: theta (3, columns) [m] of each; signs (3, V).
    """
    turn = Rotation.from_matrix(scene.ground.rotation)
    where = scene.ground.to_ground(trajectories.position)
    where = where - [*where[:, :2].mean(axis=0), 0]  # slopes turn about the middle
    fall = trajectories.dt, scene.gravity

    def read(wxyz, scale=1.0):
        rotation = turn * rotation_of(wxyz)
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
        theta, signs = _given(guess, shape)
        starts = [theta]
    ruler = _gauge(gauge, steps, (starts[0] * signs).T, fall)
    steps = read(trajectories.quaternion, ruler[0])
    if guess is None:
        starts = [ruler[0] * theta for theta in starts]
    return steps, starts, signs, ruler


def nothing_lands(steps: Steps) -> MotionError:
    """Return the error of motion in which nothing touches the ground."""
    return MotionError(
        "no corner comes near the ground", where="trajectories",
        got=f"origins at {1e3 * steps.p_wo[:, 2].min():.0f} mm and higher",
        expected="tosses that land", next="check scene.ground, or give a guess",
    )  # fmt: skip


def _given(guess, shape) -> tuple:
    """Return theta (3, columns) [m] and signs (3, V) of a user's guess."""
    cuboid, given = shape == "cuboid", as_floats(guess)
    fits = (
        given.shape == (3,) if cuboid else given.ndim == 2 and given.shape[1:] == (3,)
    )
    if not fits or not np.isfinite(given).all() or (cuboid and given.min() <= 0):
        raise OptionError(
            "cannot start there", where="guess", got=shortened(guess, most=80),
            expected="half widths (3,) > 0 [m]" if cuboid else "vertices (V, 3) [m]",
        )  # fmt: skip
    if not (cuboid or has_volume(given)):
        raise OptionError(
            "no body", where="guess", got=f"{len(given)} vertices without a volume",
            expected="vertices whose convex hull has a volume",
        )  # fmt: skip
    return (given[:, None], CUBE_SIGNS) if cuboid else (given.T, np.ones(given.T.shape))


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
    if abs(g - gravity) < SURE * sigma:
        return 1.0, 0.0
    raise _wrong_fall(g, dt, gravity)


def _check_fall(toss, height, dt, gravity) -> None:
    """Raise MeasurementError where the first samples fall alike, but not with gravity.

    height (T,) [m].  Tosses that begin in a hand or on the ground scatter.
    """
    found = []
    for number in np.unique(toss):
        z = height[toss == number][:FIRST_SAMPLES]
        if len(z) == FIRST_SAMPLES:
            found.append(-2 * np.polyfit(np.arange(FIRST_SAMPLES) * dt, z, 2)[0])
    if len(found) < MIN_TOSSES:
        return
    g = float(np.median(found))
    spread = float(np.median(abs(np.array(found) - g)))
    if (
        spread < ALIKE * abs(g)
        and abs(np.log(max(g, LEAST_ACCELERATION) / gravity)) > FAR_OFF
    ):
        raise _wrong_fall(g, dt, gravity)


def _wrong_fall(g, dt, gravity) -> MeasurementError:
    return MeasurementError(
        "free falls contradict the interval or the unit", where="dt, position",
        got=f"{g:.3g} m/s^2 in free falls", expected=f"about {gravity:.3g}",
        next=f"check dt (it would be {dt * np.sqrt(max(g, 0) / gravity):.3g} s) and "
        "that positions are in metres, or give gauge",
    )  # fmt: skip


def _check_order(steps, rolled, fall) -> None:
    """Raise MeasurementError where boxes lie flat if quaternions are read as xyzw."""
    dt, gravity = fall
    given, other = (tilt_at_rest(read, gravity, dt) for read in (steps, rolled))
    if given > TILTED and other < FLAT:
        raise MeasurementError(
            "looks like xyzw", where="quaternion",
            got=f"boxes at rest tilted by {given:.0f} deg, as xyzw by {other:.1f}",
            expected="wxyz", next="give np.roll(quaternion, 1, axis=1)",
        )  # fmt: skip
