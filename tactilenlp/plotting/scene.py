"""Draw the object, the fingers and the contacts of an estimate, in millimetres.

Touched faces are blue, untouched ones grey, the truth is dashed, each finger has a
colour.  Every function returns the figure, and draws into `axis` if one is given.
truth: a TrueBody, or a dict or dataclass with position (T, 3) or (3,) [m], quaternion
(wxyz) and side_lengths (3,) or vertices (V, 3) [m]; T poses are those of the samples
of the estimate, or of a recording that goes on after them; OptionError of fewer.
"""

from __future__ import annotations

import textwrap

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure

from ..common.brief import MM_PER_M
from ..geometry.faces import face_sigma, is_box
from ..interface.result import Estimate
from ..output.colours import UNKNOWN_SIGMA, WELL_KNOWN_SIGMA, information_colour
from ..output.summary import headline
from .drawing import (
    contacts_on_body,
    draw_scene,
    draw_seen,
    draw_top,
    set_up,
    title_of,
    view_of,
    visible_area,
)
from .faces import faces_at
from .style import INK, below, check_axes, one_axis, picture, with_key

LABEL_STYLE = {
    "ha": "center", "va": "center", "fontsize": 7,
    "bbox": {"boxstyle": "round,pad=0.2", "fc": "w", "ec": "none", "alpha": 0.8},
}  # fmt: skip
LABEL_DISTANCE = 16.0  # [mm] before its face: labels of two faces are apart
LABELLED_AREA = 100.0  # [mm^2] seen of a face that is large enough for a label

TITLE = 66  # characters of a line above the axes


@picture
def plot_scene(estimate: Estimate, sample: int = -1, truth=None, axis=None) -> Figure:
    """Draw object, fingers and contacts at a sample in 3-D.

    sample: an index, -1 the last; truth: as in this module; axis: one Axes in 3-D.
    Raises OptionError for an index of no sample or another axis.
    """
    axis = one_axis(axis, 4.6, 3.6, projection="3d")
    draw_scene(axis, estimate, sample, truth, view_of(estimate, [sample]))
    axis.set_title(title_of(estimate.measurements, sample))
    return with_key(axis, axis, **below(axis))


@picture
def plot_top(estimate: Estimate, sample: int = -1, truth=None, axis=None) -> Figure:
    """Draw object, one-sigma band, finger paths and contacts at a sample from above.

    The band is one standard deviation of each face along its normal: at the last sample
    from the covariance of sizes and pose, at others from that of the sizes alone.
    Contacts of all actions move with the object; those of the sample's action are big.
    """
    axis = one_axis(axis, 4.5, 4.9)
    draw_top(axis, estimate, sample, truth, view_of(estimate, [sample]))
    return with_key(axis, axis, **below(axis))


@picture
def plot_information(estimate: Estimate, axis=None, key: bool = True) -> Figure:
    """Draw the standard deviation of each face at the last sample: blue 10, red 0.1 mm.

    It is that of the middle of the face along its normal [mm].  key: draw a colour bar.
    """
    axis = one_axis(axis, 4.6, 3.6, projection="3d")
    set_up(axis, estimate, view_of(estimate, [-1]))
    faces, _ = faces_at(estimate, -1)
    for face, sigma in zip(faces, face_sigma(estimate), strict=True):
        colour = information_colour(sigma) / 255
        draw_seen(axis, [face], [colour], INK, 4, shade=False)
        if visible_area(face) > LABELLED_AREA:
            words = f"{sigma * MM_PER_M:.2g}" if sigma < UNKNOWN_SIGMA else "unknown"
            centre = face.corners.mean(axis=0)
            at = centre + LABEL_DISTANCE * face.normal
            axis.plot(*np.stack([centre, at], axis=1), color=INK, lw=0.6, zorder=8.5)
            axis.text(*at, words, zorder=9, **LABEL_STYLE)
    for colour, seen, _, _ in contacts_on_body(estimate, -1):
        axis.scatter(*seen.T, s=5, color=colour, zorder=8, depthshade=False)
    scale = np.geomspace(UNKNOWN_SIGMA, WELL_KNOWN_SIGMA, 64)
    bar = plt.cm.ScalarMappable(
        LogNorm(WELL_KNOWN_SIGMA * MM_PER_M, UNKNOWN_SIGMA * MM_PER_M),
        ListedColormap(information_colour(scale)[::-1] / 255),
    )
    if key:
        axis.figure.colorbar(
            bar, ax=axis, shrink=0.6, pad=0.12, extend="both",
            label="standard deviation of a face [mm]",
        ).ax.invert_yaxis()  # fmt: skip
    axis.set_title("Standard deviation of each face\n(red: known, blue: unknown)")
    return axis.figure


@picture
def plot_estimate(estimate: Estimate, truth=None, axis=None) -> Figure:
    """Draw the first and the last sample side by side, from above and in 3-D.

    truth: as in this module.  axis: four Axes, from above of the first and the last
    sample, then in 3-D of both.
    """
    view = view_of(estimate, [0, -1])
    axes = _four_axes(estimate) if axis is None else check_axes(axis, 4)
    alone = " (band: sizes alone)" if is_box(estimate) else ""
    words = f"First sample: {{}}{alone}", "Last sample: {}"
    for k, (title, sample) in enumerate(zip(words, (0, -1), strict=True)):
        draw_top(axes[k], estimate, sample, truth, view)
        axes[k].set_title(title.format(axes[k].get_title()))
        draw_scene(axes[k + 2], estimate, sample, truth, view)
    if axis is not None:
        return with_key(axes[0], axes[0], **below(axes[0]))
    return with_key(axes[0].figure, axes[0], loc="outside lower center", ncols=3)


def _four_axes(estimate) -> list:
    """Return the axes of a new figure, two flat and two in 3-D."""
    figure = plt.figure(figsize=(7.0, 6.6))
    said = headline(estimate)
    parts = said.replace(" at (", "\nat (").replace(", turned", ",\nturned")
    lines = [textwrap.fill(part, TITLE) for part in parts.split("\n")]
    figure.suptitle("\n".join(lines))
    figure.get_layout_engine().set(rect=(0, 0.012, 0.965, 0.988))  # 3-D labels
    solid = {("c", "d"): {"projection": "3d"}}
    ratios = {"height_ratios": (1.5, 1), "per_subplot_kw": solid}
    return [*figure.subplot_mosaic("ab;cd", **ratios).values()]
