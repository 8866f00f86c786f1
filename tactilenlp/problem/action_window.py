"""The window of one action of a polytope, its past held and known as a Gaussian."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .polytope_window import PolytopeWindow
from .window import Rows, Window

INDEXED_BY = (
    ("near_touch", "touch"), ("near_free", "free"), ("near_push", "push"),
    ("leg", "corner"), ("weight_share", "corner"),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class ActionWindow(PolytopeWindow):
    """The window of one action; past (V, 3) [m]: vertices before it, information."""

    past: np.ndarray = None
    information: np.ndarray = None


def of_action(window: PolytopeWindow, past, about) -> ActionWindow:
    """Return the part of a window that comes after the samples of the past.

    about: information (3 V, 3 V) about the vertices of the past, whose poses are held.
    """
    samples = past.x.shape[1]
    lower, upper = window.holding(past.x, slice(window.pose[samples]))
    parts = dict(vars(window))
    by_time = "touch", "free", "step", "push"
    old = {k: count_before(parts[k], samples) for k in by_time}
    old["corner"] = int((window.corner.step < old["step"]).sum())
    for name, rows in INDEXED_BY:
        parts[name] = parts[name][old[rows] :]
    parts |= {k: parts[k].pick(slice(old[k], None)) for k in ("touch", "free")}
    corner = window.corner.pick(slice(old["corner"], None))
    parts["corner"] = replace(corner, step=corner.step - old["step"])
    parts |= of_later_steps(window, samples) | {"lower": lower, "upper": upper}
    vertices = past.theta.reshape(-1, 3)
    return ActionWindow(**parts, past=vertices, information=about)


def of_later_steps(window: Window, samples: int) -> dict:
    """Return the fields of a window that are of steps after so many samples.

    The steps, the gaps between actions, and the pushes within the steps.
    """
    step, push = (count_before(k, samples) for k in (window.step, window.push))
    pushes = window.push.pick(slice(push, None))
    return {
        "step": window.step.pick(slice(step, None)),
        "gap": window.gap.pick(window.gap.sample >= samples),
        "push": replace(pushes, step=pushes.step - step),
        "unfelt": window.unfelt[window.unfelt >= push] - push,
        "unseen": window.unseen[window.unseen >= push] - push,
    }


def count_before(rows: Rows, samples: int) -> int:
    """Return how many rows, in the order of time, are of the first samples."""
    return int((rows.sample < samples).sum())
