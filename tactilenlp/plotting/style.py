"""One style of all pictures: colours, sizes, keys, and which axes they take."""

from __future__ import annotations

from functools import wraps
from inspect import signature

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import ScaledTranslation

from ..common.validation import check_types
from ..errors import OptionError
from ..estimation.result import Estimate

# Colours that the colour-blind tell apart (Okabe and Ito, "Color Universal Design").
TOUCHED, UNTOUCHED, BAND, TRUTH = "#0072B2", "#B5B5B5", "#56B4E9", "#D55E00"
INK, FINGER_COLOURS = "#333333", ("#009E73", "#CC79A7", "#E69F00", "#F0E442")
STYLE = {
    "font.size": 8, "legend.fontsize": 8, "legend.frameon": False, "figure.dpi": 150,
    "axes.spines.top": False, "axes.spines.right": False, "axes3d.grid": False,
    "axes.titlesize": 9, "axes.xmargin": 0.01, "figure.constrained_layout.use": True,
}  # fmt: skip
MM = 1e3  # [mm / m], also [mN s / N s]
UNDER = 0.42  # [inch] from an axis to the key below it: room for ticks and label


def picture(draw):
    """Return a function that draws an Estimate in our style, and nothing else."""

    @wraps(draw)
    def styled(estimate, *arguments, **named):
        check_types(estimate=(estimate, Estimate))
        given = signature(draw).bind(estimate, *arguments, **named).arguments
        with plt.rc_context(STYLE):
            if given.get("axis") is not None:
                count = np.size(np.asarray(given["axis"], object))
                for axis in check_axes(given["axis"], count):
                    dress(axis)
            return draw(estimate, *arguments, **named)

    return styled


def dress(axis) -> None:
    """Give an axis that was made without our style the letters and lines of it."""
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    size = plt.rcParams["font.size"]
    solid = [axis.zaxis] if hasattr(axis, "zaxis") else []
    for ruler in (axis.xaxis, axis.yaxis, *solid):
        ruler.label.set_size(size)
        ruler.set_tick_params(labelsize=size)
    axis.title.set_size(plt.rcParams["axes.titlesize"])
    if solid:
        axis.grid(False)


def check_axes(axis, count: int) -> list:
    """Return so many axes as a list; OptionError where there are not so many."""
    axes = [*np.ravel(np.asarray(axis, dtype=object))]
    if len(axes) == count and all(isinstance(a, Axes) for a in axes):
        return axes
    raise OptionError(
        "wrong number of axes", where="axis", got=f"{len(axes)} things",
        expected=f"{count} matplotlib Axes",
    )  # fmt: skip


def check_solid(axis):
    """Return an axis that is 3-D; OptionError otherwise."""
    if hasattr(axis, "zaxis"):
        return axis
    raise OptionError(
        "a flat axis", where="axis", got=type(axis).__name__,
        expected='an axis of add_subplot(projection="3d")',
    )  # fmt: skip


def below(axis) -> dict:
    """Return where a key lies under an axis, whatever its height."""
    down = ScaledTranslation(0, -UNDER, axis.figure.dpi_scale_trans)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncols": 2}
    return where | {"bbox_transform": axis.transAxes + down}


def with_key(owner, axis, **where):
    """Give a figure or an axis one legend, with every label once; return the figure."""
    entries = dict(zip(*axis.get_legend_handles_labels()[::-1], strict=True))
    owner.legend(entries.values(), entries, **where)
    return axis.figure
