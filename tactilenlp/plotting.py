"""Draw estimates with matplotlib: pictures for people, in millimetres.

Blue was touched, grey was not, a dashed line is the truth, each finger has a colour.
Every function returns the figure and draws into `axis` where one is given.  `truth` has
`position`, `quaternion` (wxyz) and `side_lengths` like an Estimate, or is a dict that
does: one pose, or one for every sample.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import rc_context
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle, PathPatch, Polygon
from matplotlib.path import Path
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from .information import ENOUGH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .result import Estimate

# Colours that the colour-blind tell apart (Okabe and Ito, "Color Universal Design").
TOUCHED, UNTOUCHED, BAND, TRUTH = "#0072B2", "#B5B5B5", "#56B4E9", "#D55E00"
INK, FINGERS = "#333333", ("#009E73", "#CC79A7", "#E69F00", "#F0E442")
STYLE = {
    "font.size": 8, "axes.titlesize": 9, "legend.fontsize": 8, "legend.frameon": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#888888",
    "figure.dpi": 150, "figure.constrained_layout.use": True,
}  # fmt: skip
WIDTH = 7.0  # [inch] of a figure: the text width of a page
MM = 1e3  # [mm / m], also [mN s / N s]
MARGIN, ABOVE = 30.0, 22.0  # [mm] of room around and above the object: a fingertip
ARROW, GRID = 7.0, 10.0  # [mm] length of a contact normal, spacing of the ground's lines
SEEN = np.radians([28.0, -58.0])  # elevation and azimuth from where a scene is seen
EYE = np.r_[np.cos(SEEN[0]) * np.array([np.cos(SEEN[1]), np.sin(SEEN[1])]), np.sin(SEEN[0])]
LIGHT = np.array([0.35, -0.55, 0.76])  # [1] towards the light
WORDS = {True: "face touched", False: "face not touched"}


@rc_context(STYLE)
def plot_scene(
    estimate: Estimate, sample: int = -1, truth=None, axis: Axes | None = None
) -> Figure:
    """Draw object, fingers and contacts at a sample in three dimensions.

    What the object hides is left out.  White marks: one sigma of a face, as in plot_top.
    """
    if axis is None:
        axis = plt.figure(figsize=(4.5, 4.2)).add_subplot(projection="3d")
    _draw_scene(axis, estimate, sample, truth, _view(estimate, [sample]))
    return _with_key(axis.figure, [axis], 2)


@rc_context(STYLE)
def plot_top(
    estimate: Estimate, sample: int = -1, truth=None, axis: Axes | None = None
) -> Figure:
    """Draw object, one-sigma band, finger paths and contacts at a sample from above.

    The band is where each face may be, along its normal: at the last sample from the
    covariance of sizes and pose, at others from that of the sizes alone.  Contacts of
    all actions are carried along with the object; those of the sample's action are big.
    """
    axis = axis or plt.figure(figsize=(4.5, 4.9)).subplots()
    _draw_top(axis, estimate, sample, truth, _view(estimate, [sample]))
    return _with_key(axis.figure, [axis], 2)


@rc_context(STYLE)
def plot_estimate(estimate: Estimate, truth=None) -> Figure:
    """Draw the first and the last sample side by side, from above and in 3-D."""
    figure, view = plt.figure(figsize=(WIDTH, 6.6)), _view(estimate, [0, -1])
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1))
    sigma = estimate.information.sigma("side_lengths") * MM
    sides = [
        f"{side:.2f} ± {s:.2f}" if s < 0.1 else f"{side:.1f} ± {s:.1f}"
        for side, s in zip(estimate.theta * MM, sigma, strict=True)
        if estimate.shape == "cuboid"
    ]
    title = [f"{estimate.shape.capitalize()}", f" of {' × '.join(sides)} mm" if sides else ""]
    figure.suptitle("".join(title), fontsize=11)
    for column, sample in enumerate((0, -1)):
        _draw_top(figure.add_subplot(grid[0, column]), estimate, sample, truth, view)
        below = figure.add_subplot(grid[1, column], projection="3d")
        _draw_scene(below, estimate, sample, truth, view)
        below.set_title("")
    return _with_key(figure, figure.axes, 3)
