"""The style of all pictures: colours, fonts, legends, and the checks of axes."""

from __future__ import annotations

from functools import wraps
from inspect import signature

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import ScaledTranslation

from ..common.validation import check_types
from ..errors import OptionError
from ..interface.result import Estimate
from ..output.colours import FINGER_RGB

# Colours that the colour-blind can distinguish (Okabe, Ito, "Color Universal Design").
DEEP_BLUE, VERMILION, GREEN = "#0072B2", "#D55E00", "#009E73"
TOUCHED_COLOUR, UNTOUCHED_COLOUR = DEEP_BLUE, "#B5B5B5"
BAND_COLOUR, TRUTH_COLOUR, INK = "#56B4E9", VERMILION, "#333333"
STYLE = {
    "font.size": 8, "legend.fontsize": 8, "legend.frameon": False, "figure.dpi": 150,
    "axes.spines.top": False, "axes.spines.right": False, "axes3d.grid": False,
    "axes.titlesize": 9, "axes.xmargin": 0.01, "figure.constrained_layout.use": True,
}  # fmt: skip
KEY_DISTANCE = 0.42  # [inch] from an axis to the legend below its ticks and label


def picture(draw):
    """Wrap a function that draws an Estimate: check the arguments, set the style."""

    @wraps(draw)
    def styled(estimate, *arguments, **named):
        check_types(estimate=(estimate, Estimate))
        given = signature(draw).bind(estimate, *arguments, **named).arguments
        with plt.rc_context(STYLE):
            if given.get("axis") is not None:
                for axis in check_axes(given["axis"]):
                    dress(axis)
            return draw(estimate, *arguments, **named)

    return styled


def finger_colour(finger: int) -> str:
    """Return the colour of a finger; they repeat where there are many fingers."""
    return "#{:02X}{:02X}{:02X}".format(*FINGER_RGB[finger % len(FINGER_RGB)])


def dress(axis) -> None:
    """Apply the style to an axis that was made without it."""
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


def check_axes(axis, *counts: int) -> list:
    """Return a list of so many axes, without counts of any number; else OptionError."""
    axes, counts = [*np.ravel(np.asarray(axis, dtype=object))], dict.fromkeys(counts)
    others = [type(a).__name__ for a in axes if not isinstance(a, Axes)]
    if len(axes) in (counts or [len(axes)]) and not others:
        return axes
    raise OptionError(
        "no axes" if others else "wrong number of axes", where="axis",
        got=f"a {others[0]}" if others else len(axes),
        expected=f"{' or '.join(map(str, counts))} matplotlib Axes".strip(),
    )  # fmt: skip


def one_axis(axis, *size: float, **style):
    """Return the given axis, checked, or that of a new figure of a size (2,) [inch]."""
    if axis is None:
        return plt.figure(figsize=size).add_subplot(**style)
    return check_axes(axis, 1)[0]


def below(axis) -> dict:
    """Return the arguments of a legend below an axis of any height."""
    down = ScaledTranslation(0, -KEY_DISTANCE, axis.figure.dpi_scale_trans)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncols": 2}
    return where | {"bbox_transform": axis.transAxes + down}


def with_key(owner, axis, **where):
    """Add a legend with every label once to a figure or an axis; return the figure."""
    entries = dict(zip(*axis.get_legend_handles_labels()[::-1], strict=True))
    owner.legend(entries.values(), entries, **where)
    return axis.figure
