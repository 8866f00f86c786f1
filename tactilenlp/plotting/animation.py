"""Film an estimate: the object and the fingers, sample by sample."""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.figure import Figure

from ..common.progress import progress
from ..common.validation import check_numbers, check_path, check_types
from ..errors import OptionError
from ..estimation.result import Estimate
from .drawing import draw_scene, draw_top, true_corners, view_of
from .style import STYLE, check_axes

WRITERS = {".gif": PillowWriter, ".mp4": FFMpegWriter}
VIEWS = {"scene": draw_scene, "top": draw_top}


def animate(
    estimate: Estimate,
    path: str | os.PathLike,
    *,
    view: str = "scene",
    truth=None,
    every: int = 1,
    rate: float = 15.0,
    axis=None,
) -> Figure:
    """Write a film of the motion, .gif (pillow) or .mp4 (ffmpeg); return its figure.

    view: "scene" (3-D) or "top".  every: samples from frame to frame [1]; rate: frames
    per second [1/s]; axis: is drawn into, 3-D for "scene".

    Raises OptionError for another suffix or view, or where ffmpeg is not installed.
    """
    check_types(estimate=(estimate, Estimate))
    check_path(path)
    check_numbers("", "frames per second above 0", rate=(rate, 0, np.inf))
    path = Path(path)
    kind = WRITERS.get(path.suffix.lower())
    for where, got, known in (
        ("path", path.suffix, WRITERS), ("view", view, VIEWS),
    ):  # fmt: skip
        if got not in known:
            expected = f"one of {[*known]}"
            raise OptionError("not known", where=where, got=got, expected=expected)
    if not kind.isAvailable():
        raise OptionError(
            "no program to write it", where="path", got=path.suffix,
            expected="ffmpeg on the path", next="install ffmpeg, or write a .gif",
        )  # fmt: skip
    if not (isinstance(every, int) and every >= 1):
        got = f"every={every}"
        raise OptionError("out of range", where="animate", got=got)
    if truth is not None:  # an error while a film is written would leave half of it
        true_corners(truth, 0)
    with plt.rc_context(STYLE | {"figure.dpi": 100}):
        style = {"projection": "3d"} if view == "scene" else {}
        if axis is None:
            axis = plt.figure(figsize=(4.6, 3.8)).add_subplot(**style)
        (axis,) = check_axes(axis, 1)
        figure = axis.figure
        samples = range(0, len(estimate.position), every)
        box = view_of(estimate, samples)
        data = estimate.measurements

        def draw(sample):
            axis.clear()
            VIEWS[view](axis, estimate, sample, truth, box)
            axis.set_title(f"{data.time[sample]:.2f} s, action {data.action[sample]}")

        frames = progress(samples, "drawing")
        film = FuncAnimation(
            figure, draw, frames, init_func=lambda: None, save_count=len(samples)
        )
        film.save(path, kind(fps=rate))
    return figure
