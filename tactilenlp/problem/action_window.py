"""The window of one action of a polytope, its past held and known as a Gaussian."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .polytope_window import PolytopeWindow
from .window import Group, Window

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
    new = {k: parts[k].sample >= samples for k in ("touch", "free", "step", "push")}
    new["corner"] = new["step"][window.corner.step]
    parts |= {k: parts[k].pick(new[k]) for k in ("touch", "free", "corner")}
    parts |= of_later_steps(window, samples)
    at = {k: np.cumsum(rows) - 1 for k, rows in new.items()}  # where rows go
    corner = parts["corner"]
    parts["corner"] = replace(corner, step=at["step"][corner.step])
    for name, rows in INDEXED_BY:
        parts[name] = parts[name][new[rows]]
    groups = {n: _later(g, new["step"], at) for n, g in window.groups.items()}
    parts |= {"groups": groups, "lower": lower, "upper": upper}
    vertices = past.theta.reshape(-1, 3)
    return ActionWindow(**parts, past=vertices, information=about)


def of_later_steps(window: Window, samples: int) -> dict:
    """Return the fields of a window that are of steps after so many samples.

    The steps, the gaps between actions, and the pushes within the steps.
    """
    step, push = (k.sample >= samples for k in (window.step, window.push))
    step_at, push_at = (np.cumsum(rows) - 1 for rows in (step, push))
    pushes = window.push.pick(push)
    kept = {
        name: push_at[rows[push[rows]]]
        for name, rows in (("unfelt", window.unfelt), ("unseen", window.unseen))
    }
    return kept | {
        "step": window.step.pick(step),
        "gap": window.gap.pick(window.gap.sample >= samples),
        "push": replace(pushes, step=step_at[pushes.step]),
    }


def _later(group: Group, new, at) -> Group:
    """Return the new steps of a group; at: where steps, pushes and corners go."""
    kept = new[group.steps]
    return Group(
        at["step"][group.steps[kept]], at["push"][group.pushes[kept]],
        at["corner"][group.corners[kept]],
    )  # fmt: skip
