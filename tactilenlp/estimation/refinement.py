"""Refinement: the page solved from what the search found, by multistart.

Where the scene lets an object tilt, it is first solved as if it slid: the optimum of
free motion is close.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations.centre_of_mass import NAME as CENTRE

from ..geometry.transforms import is_planar
from ..problem.certificates import planar_certificate
from ..problem.reductions import Reductions, required_reductions
from ..search.hypothesis import distinct, naming, turned
from ..search.local_solve import (
    RESTART_MU,
    Solved,
    best_first,
    freed_levels,
    freed_to_tilt,
    settings_of,
    solved_from,
    warm_started,
)
from ..search.margins import CLOSE_OPTIMUM, LEAST_MOTION_BEHIND, RAN_AWAY, UNCHANGED
from ..search.multistart import multistart
from .incremental_polytope import repaired


def refined(job, page, kept, options, solved, start=None) -> list[Solved]:
    """Return the page solved from hypotheses, best first.

    solved: an empty list that holds the solves so far when Ctrl-C interrupts; start: an
    estimate of this page that this one continues.
    """
    sized, lean = (
        job.shape.parameters == "sizes",
        required_reductions(page, Reductions()),
    )
    lying = job.scene.ground is not None and all(is_planar(h.x) for h in kept)
    lying = lying and not job.shape.rolls
    if lying and lean.planar and not job.reductions.planar:
        flat = replace(job, reductions=lean)
        found = refined(flat, page, kept, options, solved, start)
        found = repaired(flat, page, found, options)
        if not sized or planar_certificate(flat, page, found[0]).holds:
            return _in_free_motion(job, page, found[: job.shape.hypotheses], options)
    start = start if sized else None
    return _multistart(job, page, kept, options, solved, start)


def _in_free_motion(job, page, slid, options) -> list[Solved]:
    """Return the page in free motion, from planar solves that are close to the best."""
    ends, settings = [s.at for s in slid], settings_of(job, options)
    near = distinct(job.shape, ends, len(ends), CLOSE_OPTIMUM)
    slid = [s for s, end in zip(slid, ends, strict=True) if end in near]
    return best_first(freed_to_tilt(job, page, s, settings, RESTART_MU) for s in slid)


def _multistart(job, page, kept, options, solved, start) -> list[Solved]:
    """Return the page solved from the best hypotheses, best first.

    Where the first one, which continues the path of `start`, explains the new data, it
    is solved alone.
    """
    limit = min(h.objective for h in kept) + LEAST_MOTION_BEHIND
    own = page.LEVELS
    levels = freed_levels(own, final=True) if job.reductions.planar else own
    if job.scene.ground is None or job.shape.rolls:  # guesses in a plane
        levels = getattr(page, "ROUGH", own)
    promising = [h for h in kept if h.objective <= limit]
    first = promising[: None if start is None else 1]
    solved = multistart(job, page, first, options, levels, solved=solved)
    if len(first) < len(promising) and not still_explained(solved[0], start):
        others = multistart(job, page, promising[1:], options, levels, known=solved)
        solved = best_first([*solved, *others])
    good = [s for s in solved if s.solution.success]
    bound = min(h.objective for h in kept) + RAN_AWAY * job.data.actions
    lost = not good or good[0].solution.objective > bound
    if lost and levels is not own and not job.deadline.passed("the page's own levels"):
        # Slower: the page's own levels, which hold poses first.
        good = [*good, solved_from(job, page, solved[0].hypothesis, options)]
    return best_first(good or solved)


def with_named_axes(job, page, solved, options, like) -> Solved:
    """Return a solve, or one of the same optimum with the axes of a box renamed.

    like: see `naming`.  Hypotheses are named before they are solved; sizes that the
    solve found may be in another order.
    """
    order, S = naming(job.shape, solved.at, like)
    if np.array_equal(S, np.eye(3)) or not solved.solution.success:
        return solved
    if job.deadline.passed("the order of a box's axes"):
        return solved
    known = _renamed(job.shape, solved, order, S)
    again = warm_started(job, page, known, settings_of(job, options), RESTART_MU)
    again = replace(again, declined=solved.declined)
    return again if again.rank <= solved.rank else solved


def _renamed(shape, solved, order, S) -> Solved:
    """Return a solve with other names of the axes, to start from.

    Ground contacts are listed by corner, the same ones at each step.
    """
    s, corners = solved.solution, np.array(shape.corners)
    places = [int(np.argmax(corners @ (S @ c))) for c in corners]
    rows = np.arange(len(solved.window.corner)).reshape(-1, len(corners))
    rows = rows[:, places].ravel()

    def moved(values) -> dict:
        ground = {k: values[k][:, rows] for k in ("ground",) if k in values}
        centre = {k: S.T @ values[k] for k in (CENTRE,) if k in values}
        return values | ground | centre | {"theta": values["theta"][order]}

    multipliers = {
        name: old[rows] if name.startswith("ground") and len(old) == len(rows) else old
        for name, old in s.multipliers.items()
    }
    solution = replace(
        s, values=moved(s.values) | {"x": turned(s.values["x"], S)},
        bound_multipliers=moved(s.bound_multipliers), multipliers=multipliers,
    )  # fmt: skip
    h = solved.hypothesis
    h = replace(h, theta=h.theta[order], x=turned(h.x, S))
    return replace(solved, hypothesis=h, solution=solution)


def still_explained(best, start) -> bool:
    """Tell whether the path of an earlier estimate explains the new data as well.

    More data never cost less: where the objective has not risen nothing can be gained.
    """
    risen = best.solution.objective > start.objective + UNCHANGED
    return best.solution.success and not risen
