"""Write a film of an estimate: object and fingers, sample by sample."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.figure import Figure

from ..common.progress import progress
from ..common.validation import (
    check_numbers,
    check_one_of,
    check_path,
    check_types,
    check_whole,
)
from ..common.whole_file import write_whole
from ..errors import OptionError
from ..interface.result import Estimate
from .drawing import draw_scene, draw_top, true_corners, view_of
from .style import STYLE, one_axis, with_key

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

    view: "scene" (3-D) or "top".  truth: as in plot_scene.  every: [1] samples from one
    frame to the next; rate: [1/s] frames per second; axis: to draw into, 3-D for
    "scene".  Raises OptionError for another suffix, view or truth, or without ffmpeg.
    """
    check_types(estimate=(estimate, Estimate))
    writer = _writer_of(path, view, every, rate, truth, len(estimate.position))
    solid, alone = {"projection": "3d"} if view == "scene" else {}, axis is None
    with plt.rc_context(STYLE | {"figure.dpi": 100}):
        axis = one_axis(axis, 4.6, 4.4, **solid)
        if alone:  # room for a key, and for labels in 3-D
            axis.figure.get_layout_engine().set(rect=(0, 0, 0.93, 1))
        samples, data = range(0, len(estimate.position), every), estimate.measurements
        box = view_of(estimate, samples)

        def draw(sample):
            axis.clear()
            VIEWS[view](axis, estimate, sample, truth, box)
            axis.set_title(f"{data.time[sample]:.2f} s, action {data.action[sample]}")
            if alone:
                _renew_key(axis)

        film = FuncAnimation(
            axis.figure, draw, progress(samples, "drawing"), init_func=lambda: None,
            save_count=len(samples),
        )  # fmt: skip
        _save(film, path, writer(fps=rate))
    return axis.figure


def _save(film: FuncAnimation, path, writer) -> None:
    """Draw the frames of a film; its file is written whole."""
    with TemporaryDirectory() as folder:
        part = Path(folder, Path(path).name)
        film.save(part, writer)
        write_whole(path, part.read_bytes())


def _renew_key(axis) -> None:
    """Replace the legend of a figure by that of what the axis shows now."""
    for key in [*axis.figure.legends]:
        key.remove()
    with_key(axis.figure, axis, loc="outside lower center", ncols=2)


def _writer_of(path, view: str, every: int, rate: float, truth, samples) -> type:
    """Return the writer of a path's format; OptionError for bad arguments."""
    check_path(path)
    check_numbers("frames per second above 0", rate=(rate, 0, np.inf))
    suffix = Path(path).suffix.lower()
    for where, got, known in (("path", suffix, WRITERS), ("view", view, VIEWS)):
        check_one_of(where, got, known, "unknown")
    writer = WRITERS[suffix]
    if not writer.isAvailable():
        raise OptionError(
            "no program to write it", where="path", got=suffix,
            expected="ffmpeg on the path", next="install ffmpeg, or write a .gif",
        )  # fmt: skip
    check_whole("every", every, 1, np.inf)
    if truth is not None:
        true_corners(truth, 0, samples)
    return writer
