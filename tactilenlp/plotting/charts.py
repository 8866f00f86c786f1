"""Draw charts of an estimate: impulses, costs, progress of IPOPT, errors by action.

Every function returns the figure, and draws into `axis` if one is given.
"""

from __future__ import annotations

from collections.abc import Iterable

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from formulations.names import FINGER_FRICTION

from ..common.brief import MM_PER_M
from ..common.validation import check_types
from ..errors import OptionError
from ..geometry.convex_hull import nearest_points
from ..geometry.transforms import rotation_of
from ..interface.result import Estimate
from ..solvers.solution import Solution
from .style import (
    DEEP_BLUE,
    GREEN,
    INK,
    STYLE,
    TOUCHED_COLOUR,
    UNTOUCHED_COLOUR,
    VERMILION,
    below,
    check_axes,
    finger_colour,
    one_axis,
    picture,
)

SIDES = (("x", DEEP_BLUE, "o"), ("y", VERMILION, "s"), ("z", GREEN, "^"))
LEAST_DRAWN = 1e-3  # [mm] of an error on a logarithmic axis
LOG_FLOOR = 1e-12  # drawn in place of zero on logarithmic axes


@picture
def plot_impulses(estimate: Estimate, axis=None) -> Figure:
    """Draw normal and tangential impulses of each finger, and its friction cone.

    The cone is mu times the normal impulse, where mu is known.  axis: one Axes, or one
    for each finger.
    """
    data = estimate.measurements
    if axis is None:
        figure = plt.figure(figsize=(7.0, 0.6 + 1.8 * data.fingers))
        axis = figure.subplots(data.fingers, sharex=True)
    axes = check_axes(axis, 1, data.fingers)
    axes *= data.fingers // len(axes)
    shown = np.flatnonzero(data.contact.any(axis=1))
    starts = np.flatnonzero(np.diff(data.action[shown], prepend=-1))
    ticks = [f"{data.time[t]:.1f}\n{data.action[t]}" for t in shown[starts]]
    mu, at = _friction(estimate), np.arange(len(shown))
    for finger, axis in enumerate(axes):
        normal, tangential = _parts(estimate, finger, shown)
        colour = finger_colour(finger)
        axis.bar(at, normal, 1.0, color=(colour, 0.5), label="normal")
        if mu is not None:
            axis.step(at, mu * normal, where="mid", color=INK, lw=1,
                      label=f"friction cone: {mu:.2g} × normal")  # fmt: skip
        axis.plot(at, tangential, "o", c=colour, ms=4, mec=INK, label="tangential")
        axis.grid(axis="x", linestyle=":")
        axis.set_xticks(starts - 0.5, ticks, ha="left")
        axis.set_ylabel(f"finger {finger} [mN s]")
        axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    axes[-1].set_xlabel("samples with contact; time [s], then action, where one begins")
    return axes[0].figure


@picture
def plot_costs(estimate: Estimate, axis=None) -> Figure:
    """Draw the costs by term, largest first; they add up to the objective."""
    costs = dict(sorted(estimate.costs.items(), key=lambda cost: abs(cost[1])))
    axis = one_axis(axis, 5.6, 0.8 + 0.24 * len(costs))
    values = np.array([*costs.values()])
    bars = axis.barh(
        [*costs], values, color=np.where(values < 0, UNTOUCHED_COLOUR, TOUCHED_COLOUR)
    )
    axis.bar_label(bars, [f"{value:.2g}" for value in values], padding=3)
    axis.margins(x=0.15)
    axis.set(xlabel="cost [nats]", title=f"Objective {estimate.objective:.2f} nats")
    return axis.figure


@picture
def plot_cones(estimate: Estimate, axis=None) -> Figure:
    """Draw the tangential against the normal part of every impulse of a finger.

    Inside the shaded cone a contact sticks; on its boundary it slides.  The normal is
    that of the nearest face.  Pages round edges, so that points of contacts near an
    edge may lie slightly outside.
    """
    axis = one_axis(axis, 4.2, 3.4)
    data, mu, most = estimate.measurements, _friction(estimate), 1e-3
    shown = np.flatnonzero(data.contact.any(axis=1))
    for finger in range(data.fingers):
        normal, tangential = _parts(estimate, finger, shown)
        pushes = normal > LOG_FLOOR * MM_PER_M
        axis.scatter(normal[pushes], tangential[pushes], 14, lw=0.4, ec=INK, zorder=3,
                     color=finger_colour(finger),
                     label=f"finger {finger}")  # fmt: skip
        most = max(most, *normal)
    if mu is not None:
        axis.fill_between([0, most], [0, mu * most], lw=0,
                          color=UNTOUCHED_COLOUR, alpha=0.35,
                          label=f"friction cone: {mu:.2g} × normal")  # fmt: skip
        axis.plot([0, most], [0, mu * most], color=INK, lw=1)
    axis.set(xlabel="normal part [mN s]", ylabel="tangential part [mN s]",
             xlim=(0, None), ylim=(0, None))  # fmt: skip
    axis.legend(loc="upper left")
    return axis.figure


@plt.rc_context(STYLE)
def plot_progress(solved, axis=None) -> Figure:
    """Draw IPOPT's progress: infeasibility, optimality, barrier at every iteration.

    solved: an Estimate or a Solution.  Dotted lines separate the levels.
    """
    check_types(solved=(solved, (Estimate, Solution)))
    progress = solved.progress
    if not len(progress.get("level", ())):
        raise OptionError(
            "no iterations are stored", where="progress", got=f"status {solved.status}",
            next="estimate again: files of older versions have none",
        )  # fmt: skip
    axis = one_axis(axis, 5.6, 3.2)
    for name, label, colour in (
        ("primal", "constraint violation [scaled]", TOUCHED_COLOUR),
        ("dual", "gradient of the Lagrangian [scaled]", VERMILION),
        ("barrier", "barrier parameter mu [nats]", UNTOUCHED_COLOUR),
    ):
        axis.semilogy(
            np.maximum(progress[name], LOG_FLOOR), c=colour, lw=1.4, label=label
        )
    for start in np.flatnonzero(np.diff(progress["level"])):
        axis.axvline(start + 0.5, color=INK, lw=0.8, ls=":")
    objective = progress["objective"][-1]
    axis.set(xlabel="iteration [1]", ylabel="magnitude [see legend]",
             title=f"{solved.status}, {objective:.2f} nats")  # fmt: skip
    axis.legend(**below(axis))
    return axis.figure


@plt.rc_context(STYLE)
def plot_errors(estimates, truth=None, axis=None) -> Figure:
    """Draw error and predicted sigma of each side against the number of actions.

    estimates: of a cuboid after each action, `step.estimate` of the steps of `explore`.
    truth: side lengths (3,) [m], or a dict with `side_lengths`; None: sigma alone.  The
    horizontal sides are matched with the true ones by rank: their order is arbitrary.
    """
    check_types(estimates=(estimates, Iterable))
    estimates = list(estimates)
    if not estimates:
        raise OptionError(
            "nothing to draw", where="estimates", got="none",
            expected="one Estimate or more",
        )  # fmt: skip
    check_types(**{f"estimates[{k}]": (e, Estimate) for k, e in enumerate(estimates)})
    axis = one_axis(axis, 4.6, 3.4)
    actions = [estimate.measurements.actions for estimate in estimates]
    sides = np.array([estimate.side_lengths for estimate in estimates]) * MM_PER_M
    sigma = (
        np.array([e.information.sigma("side_lengths") for e in estimates]) * MM_PER_M
    )
    wrong = None if truth is None else _errors_of_sides(sides, truth)
    for k, (name, colour, marker) in enumerate(SIDES):
        axis.semilogy(actions, sigma[:, k], "--", color=colour, lw=1.2,
                      label=f"side {name}: predicted ±1σ")  # fmt: skip
        if wrong is not None:
            axis.semilogy(actions, np.maximum(wrong[:, k], LEAST_DRAWN), marker,
                          color=colour, ms=5, label=f"side {name}: error")  # fmt: skip
    if wrong is not None and wrong.min() < LEAST_DRAWN:
        axis.set_title(f"errors below {LEAST_DRAWN:g} mm are drawn at that")
    axis.set(xlabel="actions [1]", ylabel="error, standard deviation of a side [mm]")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.legend(**below(axis))
    return axis.figure


def _errors_of_sides(sides, truth) -> np.ndarray:
    """Return the errors (n, 3) [mm] of sides (n, 3) [mm]; truth: as in plot_errors."""
    true = truth.get("side_lengths") if isinstance(truth, dict) else truth
    if np.shape(true) != (3,):
        raise OptionError(
            "cannot be drawn", where="truth", got=repr(truth)[:80],
            expected="side lengths (3,) [m], or a dict that has them",
        )  # fmt: skip
    order = np.argsort(np.argsort(sides[:, :2], axis=1), axis=1)  # z is vertical
    flat = np.sort(np.ravel(true)[:2])[order]
    upright = np.full(len(sides), np.ravel(true)[2])
    return abs(sides - np.c_[flat, upright] * MM_PER_M)


def _friction(estimate) -> float | None:
    """Return the friction coefficient of the fingers; None: neither known nor found."""
    mu = estimate.unknowns.get(FINGER_FRICTION, estimate.scene.friction_finger)
    return None if mu is None else float(np.ravel(mu)[0])


def _parts(estimate, finger, shown):
    """Return normal and tangential parts [mN s] of a finger's impulses at samples."""
    R_ow = rotation_of(estimate.quaternion[shown]).inv()
    p_wf = estimate.seen_positions[shown, finger]
    p_of = R_ow.apply(p_wf - estimate.position[shown])
    n_o = p_of - nearest_points(estimate.vertices, p_of)
    n_o /= np.linalg.norm(n_o, axis=1, keepdims=True)
    impulse = R_ow.apply(estimate.impulses[f"finger {finger}"][shown]) * MM_PER_M
    normal = -np.sum(impulse * n_o, axis=1)
    return normal, np.linalg.norm(impulse + normal[:, None] * n_o, axis=1)
