"""Draw the expected information gain of each direction of a finger."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from formulations.shape import Shape

from ..common.brief import MM_PER_M
from ..common.validation import check_types
from ..exploration.action_search import Choice
from ..exploration.expected_information import ExpectedInformation
from ..geometry.transforms import planar_matrix
from .drawing import outline
from .style import INK, STYLE, below, check_axes, finger_colour

TOP_VIEW_MARGIN = 35.0  # [mm] beside the object in the view from above
LEAST_GAP = 10.0  # [deg] between the directions of two fingers that holds a label
DIRECTIONS = 33, 17  # directions by azimuth and declination, for each finger
# [-], [nats]: two gains that differ by less are the same, the latter is half a digit
SAME_SHARE, SAME_GAIN = 1e-3, 0.05


@plt.rc_context(STYLE)
def plot_gain(
    estimate, choice: Choice, axis=None, *, shape: Shape | None = None
) -> Figure:
    """Draw the expected gain over the directions of each finger, and the chosen action.

    The directions of one finger vary while the others keep the chosen ones.  Left: the
    gain by azimuth and declination, hatched where no finger may come from; right: the
    action from above.  axis: these two Axes, or one for the gain alone.  shape: the
    Shape of the estimate if it is your own.

    All gains of the map are given the measurements so far, of ExpectedInformation.  An
    action that was chosen by other gains (prior_only, slopes, hypotheses) has another
    one in its search: then the title tells both.
    """
    check_types(estimate=(estimate, "Estimate"), choice=(choice, Choice))
    if axis is None:
        axis = plt.figure(figsize=(8.4, 3.6)).subplots(1, 2, width_ratios=(1.6, 1))
    sphere, *top = check_axes(axis, 1, 2)
    figure = sphere.figure
    space, fingers = choice.action.workspace, choice.action.workspace.fingers
    expected = ExpectedInformation(estimate, space, shape=shape)
    chosen = expected.gain(choice.action)
    gains = [_scan(expected, choice, finger) for finger in range(fingers)]
    norm = plt.Normalize(0, max(chosen, *(g.max() for *_, g in gains)))
    for azimuth, declination, gain in gains:
        area = sphere.pcolormesh(
            np.degrees(azimuth), np.degrees(declination), gain, norm=norm,
            cmap="viridis", shading="gouraud",
        )  # fmt: skip
    _explain_gaps(sphere, gains)
    figure.colorbar(area, ax=sphere, label="expected information gain [nats]")
    _mark_directions(sphere, choice.action)
    sphere.set(xlabel="azimuth [deg]", ylabel="declination [deg]",
               title=_gain_in_words(choice.gain, chosen))  # fmt: skip
    for beside in top:
        _draw_lines(beside, estimate, choice.action, expected)
    return figure


def _gain_in_words(searched: float, drawn: float) -> str:
    """Return the gain of the chosen action in its search, and on the map if another."""
    words = f"Chosen: {searched:.1f} nats"
    if np.isclose(searched, drawn, rtol=SAME_SHARE, atol=SAME_GAIN):
        return words
    return f"{words} in its search, {drawn:.1f} nats on this map"


def _mark_directions(sphere, action) -> None:
    """Draw a circle at the direction of each finger, and label it."""
    for finger, (a, b) in enumerate(action.angles.reshape(-1, 2)):
        azimuth = np.degrees(a + 2 * np.pi * finger / action.workspace.fingers)
        sphere.plot(azimuth, np.degrees(b), "o", ms=9, mfc="none", mec="w", mew=2)
        sphere.annotate(f"finger {finger}", (azimuth, np.degrees(b)), (0, 9), c="w",
                        textcoords="offset points", ha="center")  # fmt: skip


def _explain_gaps(sphere, gains) -> None:
    """Hatch the gaps between the directions of the fingers, and label them."""
    edges = np.degrees([azimuth[0, [0, -1]] for azimuth, _, _ in gains])
    middle = np.degrees([gains[0][1].min(), gains[0][1].max()]).mean()
    for end, start in zip(edges[:-1, 1], edges[1:, 0], strict=True):
        if start - end > LEAST_GAP:
            sphere.axvspan(end, start, fc="#EEEEEE", hatch="///", ec="#CCCCCC", lw=0)
            sphere.text((end + start) / 2, middle, "outside the workspace",
                        rotation=90, ha="center", va="center")  # fmt: skip


def _scan(expected, choice, finger: int):
    """Return azimuths, declinations (n, m) [rad] and gains [nats] of one finger."""
    space, at = choice.action.workspace, slice(2 * finger, 2 * finger + 2)
    low, high = space.lower[at], space.upper[at]
    ascension = np.linspace(low[0], high[0], DIRECTIONS[0])
    declination = np.linspace(low[1], high[1], DIRECTIONS[1])
    a, b = np.meshgrid(ascension, declination)
    gain = np.empty_like(a)
    for index in np.ndindex(a.shape):
        angles = choice.action.angles.copy()
        angles[at] = a[index], b[index]
        gain[index] = expected.gain(space.action(angles))
    return a + 2 * np.pi * finger / space.fingers, b, gain


def _draw_lines(axis, estimate, action, expected) -> None:
    """Draw the action from above, the object now and where it is expected after it."""
    way = action.positions(expected.target, 31) * MM_PER_M
    now = estimate.mesh().vertices
    motion = expected.prospect(action).motion[-1]
    then = moved_on_ground(now, estimate.scene.ground, expected.target, motion)
    for points, style, words in (
        (now, "-", "estimate"),
        (then, ":", "expected after it"),
    ):
        axis.plot(*outline(points * MM_PER_M).T, style, color=INK, label=words)
    for finger in range(way.shape[1]):
        colour = finger_colour(finger)
        axis.plot(*way[:, finger, :2].T, color=colour, label=f"finger {finger}")
        radius = action.workspace.finger_radius * MM_PER_M
        spot = plt.Circle(way[-1, finger, :2], radius, fc=(colour, 0.3), ec=colour)
        axis.add_patch(spot)
    low = (now[:, :2] * MM_PER_M).min(axis=0) - TOP_VIEW_MARGIN
    high = (now[:, :2] * MM_PER_M).max(axis=0) + TOP_VIEW_MARGIN
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal",
             xlabel="x [mm]", ylabel="y [mm]", title="From above")  # fmt: skip
    axis.legend(**below(axis))


def moved_on_ground(points, ground, about, motion) -> np.ndarray:
    """Return points (n, 3) [m] of a body after a planar motion on a ground.

    motion (3,) [m, m, rad]: along x and y of the ground frame, and the turn about the
    ground's normal through `about` (3,) [m].  Points are in the world frame.
    """
    centre, shift = ground.to_ground(about), np.array([*motion[:2], 0.0])
    arms = ground.to_ground(points) - centre
    return ground.from_ground(arms @ planar_matrix(motion[2]).T + centre + shift)
