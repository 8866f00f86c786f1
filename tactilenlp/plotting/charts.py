"""Draw numbers with matplotlib: impulses, costs, progress, errors against actions.

Every function returns the figure and draws into `axis` where
one is given.
"""

from __future__ import annotations

from collections.abc import Iterable

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from matplotlib.figure import Figure

from ..common.validation import check_types
from ..errors import OptionError
from ..estimation.result import Estimate
from ..geometry.transforms import rotation_of
from ..nlp.solution import Solution
from .style import (
    FINGER_COLOURS,
    INK,
    MM,
    STYLE,
    TOUCHED,
    UNTOUCHED,
    below,
    check_axes,
    picture,
)

SIDES = (("x", "#0072B2", "o"), ("y", "#D55E00", "s"), ("z", "#009E73", "^"))
LOG_ZERO = 1e-12  # what is zero is drawn there on logarithmic axes


@picture
def plot_impulses(estimate: Estimate, axis=None) -> Figure:
    """Draw normal and tangential parts of each finger's impulses where it touched.

    The friction cone is mu times the normal part.  axis: one Axes, or one per finger.
    """
    data = estimate.measurements
    if axis is None:
        figure = plt.figure(figsize=(7.0, 0.6 + 1.8 * data.fingers))
        axis = figure.subplots(data.fingers, sharex=True)
    one = np.size(np.asarray(axis, dtype=object)) == 1
    axes = check_axes(axis, 1) * data.fingers if one else check_axes(axis, data.fingers)
    shown = np.flatnonzero((data.contact & data.valid).any(axis=1))
    starts = np.flatnonzero(np.diff(data.action[shown], prepend=-1))
    ticks = [f"{data.time[t]:.1f}\n{data.action[t]}" for t in shown[starts]]
    mu, at = _friction(estimate), np.arange(len(shown))
    for finger, axis in enumerate(axes):
        normal, tangential = _parts(estimate, finger, shown)
        colour = FINGER_COLOURS[finger % len(FINGER_COLOURS)]
        axis.bar(at, normal, 1.0, color=(colour, 0.5), label="normal")
        axis.step(at, mu * normal, where="mid", color=INK, lw=1,
                  label=f"friction cone: {mu:.2g} × normal")  # fmt: skip
        axis.plot(at, tangential, "o", c=colour, ms=4, mec=INK, label="tangential")
        axis.grid(axis="x", linestyle=":")
        axis.set_xticks(starts - 0.5, ticks, ha="left")
        axis.set_ylabel(f"finger {finger} [mN s]")
        axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    axes[-1].set_xlabel("time [s] over action, where an action's contact begins")
    return axes[0].figure


@picture
def plot_costs(estimate: Estimate, axis=None) -> Figure:
    """Draw the costs by term, largest first."""
    costs = dict(sorted(estimate.costs.items(), key=lambda cost: abs(cost[1])))
    axis = axis or plt.figure(figsize=(5.6, 0.8 + 0.24 * len(costs))).subplots()
    values = np.array([*costs.values()])
    bars = axis.barh([*costs], values, color=np.where(values < 0, UNTOUCHED, TOUCHED))
    axis.bar_label(bars, [f"{value:.2g}" for value in values], padding=3)
    axis.margins(x=0.15)
    axis.set(xlabel="cost [nats]", title=f"Objective {estimate.objective:.2f} nats")
    return axis.figure


@picture
def plot_cones(estimate: Estimate, axis=None) -> Figure:
    """Draw the tangential against the normal part of every impulse of a finger.

    Inside the shaded cone a contact sticks; on its edge it slides.  The normal is that
    of the nearest face: beside an edge, where a page has one between two faces, a point
    may lie a little off.
    """
    axis = axis or plt.figure(figsize=(4.2, 3.4)).subplots()
    data, mu, most = estimate.measurements, _friction(estimate), 1e-3
    shown = np.flatnonzero((data.contact & data.valid).any(axis=1))
    for finger in range(data.fingers):
        normal, tangential = _parts(estimate, finger, shown)
        pushes = normal > LOG_ZERO * MM
        axis.scatter(normal[pushes], tangential[pushes], 14, lw=0.4, ec=INK, zorder=3,
                     color=FINGER_COLOURS[finger % len(FINGER_COLOURS)],
                     label=f"finger {finger}")  # fmt: skip
        most = max(most, *normal)
    axis.fill_between([0, most], [0, mu * most], color=UNTOUCHED, alpha=0.35, lw=0,
                      label=f"friction cone: {mu:.2g} × normal")  # fmt: skip
    axis.plot([0, most], [0, mu * most], color=INK, lw=1)
    axis.set(xlabel="normal part [mN s]", ylabel="tangential part [mN s]",
             xlim=(0, None), ylim=(0, None))  # fmt: skip
    axis.legend(loc="upper left")
    return axis.figure


@plt.rc_context(STYLE)
def plot_progress(solved, axis=None) -> Figure:
    """Draw IPOPT's progress: infeasibility, optimality, barrier at every iteration.

    solved: an Estimate or a Solution.  Dotted lines part the levels.
    """
    check_types(solved=(solved, (Estimate, Solution)))
    progress = solved.progress
    if not len(progress.get("level", ())):
        raise OptionError(
            "no iteration is known", where="progress", got=f"status {solved.status}",
            next="estimate again: older files have none",
        )  # fmt: skip
    axis = axis or plt.figure(figsize=(5.6, 3.2)).subplots()
    for name, label, colour in (
        ("primal", "constraints violated by [scaled]", TOUCHED),
        ("dual", "gradient of the Lagrangian [scaled]", "#D55E00"),
        ("barrier", "barrier [nats]", UNTOUCHED),
    ):
        axis.semilogy(
            np.maximum(progress[name], LOG_ZERO), c=colour, lw=1.4, label=label
        )
    for start in np.flatnonzero(np.diff(progress["level"])):
        axis.axvline(start + 0.5, color=INK, lw=0.8, ls=":")
    objective = progress["objective"][-1]
    axis.set(xlabel="iteration [1]", ylabel="size [see key]",
             title=f"{solved.status}, {objective:.2f} nats")  # fmt: skip
    axis.legend(**below(axis))
    return axis.figure


@plt.rc_context(STYLE)
def plot_errors(estimates, truth=None, axis=None) -> Figure:
    """Draw error and predicted sigma of each side against the number of actions.

    estimates: of a cuboid, with more and more actions, as `explore` yields them.
    truth: side lengths (3,) [m], or a dict with `side_lengths`; None: sigma alone.
    Sides are matched with the true ones by rank: a cuboid has no first side.
    """
    check_types(estimates=(estimates, Iterable))
    estimates = list(estimates)
    if not estimates:
        raise OptionError("nothing to draw", where="estimates", got="none")
    check_types(**{f"estimates[{k}]": (e, Estimate) for k, e in enumerate(estimates)})
    axis = axis or plt.figure(figsize=(4.6, 3.4)).subplots()
    actions = [estimate.measurements.actions for estimate in estimates]
    sides = np.array([estimate.side_lengths for estimate in estimates]) * MM
    sigma = np.array([e.information.sigma("side_lengths") for e in estimates]) * MM
    if truth is not None:
        true = truth.get("side_lengths") if isinstance(truth, dict) else truth
        if np.shape(true) != (3,):
            raise OptionError(
                "cannot be drawn", where="truth", got=repr(truth)[:80],
                expected="side lengths (3,) [m], or a dict that has them",
            )  # fmt: skip
        order = np.argsort(np.argsort(sides[:, :2], axis=1), axis=1)  # z stands alone
        flat = np.sort(np.ravel(true)[:2])[order]
        wrong = abs(sides - np.c_[flat, np.full(len(sides), np.ravel(true)[2])] * MM)
    for k, (name, colour, marker) in enumerate(SIDES):
        axis.semilogy(actions, sigma[:, k], "--", color=colour, lw=1.2,
                      label=f"side {name}: predicted ±1σ")  # fmt: skip
        if truth is not None:
            axis.semilogy(actions, np.maximum(wrong[:, k], 1e-3), marker, color=colour,
                          ms=5, label=f"side {name}: error")  # fmt: skip
    axis.set(xlabel="actions [1]", ylabel="of a side length [mm]")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.legend(**below(axis))
    return axis.figure


def _friction(estimate) -> float:
    mu = estimate.unknowns.get("finger friction", estimate.scene.friction_finger)
    return float(np.ravel(mu)[0])


def _parts(estimate, finger, shown):
    """Return normal and tangential parts [mN s] of a finger's impulses at samples."""
    R_ow = _rotations(estimate.quaternion[shown]).inv()
    p_wf = estimate.seen_positions[shown, finger]
    p_of = R_ow.apply(p_wf - estimate.position[shown])
    body = trimesh.convex.convex_hull(estimate.vertices)
    nearest, distance, _ = trimesh.proximity.closest_point_naive(body, p_of)
    n_o = (p_of - nearest) / distance[:, None]
    impulse = R_ow.apply(estimate.impulses[f"finger {finger}"][shown]) * MM
    normal = -np.sum(impulse * n_o, axis=1)
    return normal, np.linalg.norm(impulse + normal[:, None] * n_o, axis=1)


def _rotations(quaternion):
    return rotation_of(quaternion)
