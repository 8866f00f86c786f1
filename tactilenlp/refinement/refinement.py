"""Refinement: the page solved from what the search found, by multistart.

Where the scene lets an object tilt, it is first solved as if it slid: the optimum of
free motion is close.
"""

from __future__ import annotations

import logging
from dataclasses import asdict, replace

import numpy as np

from formulations.names import BETWEEN_ACTIONS

from ..certificates.certify import planar_certificate
from ..data.sensor_noise import precise
from ..geometry.transforms import is_planar
from ..information.goodness_of_fit import PHYSICS_ROW
from ..interface.result import Estimate
from ..local.comparison import distinct
from ..local.levels import levels_of
from ..local.local_solve import freed_to_tilt, warm_started
from ..local.margins import (
    DECISIVE,
    LEAST_MOTION_BEHIND,
    NEGLIGIBLE,
    PHYSICS_SHARE,
    STEPS_OF_ACTION,
    UNCHANGED,
)
from ..local.solved import Solved, best_first
from ..problem.reductions import Reductions, required_reductions
from ..search.multistart import multistart
from .axis_names import under_distinct_relabellings
from .incremental import (
    can_update,
    new_actions,
    past_solution,
    still_explained,
    update_limit,
)
from .incremental_polytope import continuation_if_implausible

log = logging.getLogger("tactilenlp")


def solve_from_hypotheses(job, kept, solves, start=None, earlier=()) -> list[Solved]:
    """Return the page solved from hypotheses, best first.

    kept: hypotheses, those of a search that are promising are solved; solves: Solves,
    where they are added; start: an estimate of this page that this one continues;
    earlier: solves from some of the hypotheses, which compete.
    """
    of_vertices = job.shape.of_vertices
    required = required_reductions(job.page, Reductions())
    lying = job.scene.ground is not None and all(is_planar(h.x) for h in kept)
    lying = lying and not job.shape.rolls
    if lying and required.planar and not job.reductions.planar:
        flat = replace(job, reductions=required)
        slid = solve_from_hypotheses(flat, kept, solves.provisional(), start)
        slid = continuation_if_implausible(slid)
        if of_vertices or planar_certificate(flat, slid[0]).holds:
            return _solve_in_free_motion(job, slid[:1] if of_vertices else slid, solves)
    start = None if of_vertices else start
    return _solve_best_hypotheses(job, kept, solves, start, earlier)


def _solve_in_free_motion(job, slid, solves) -> list[Solved]:
    """Return the page in free motion, from planar solves that are close to the best."""
    ends = [s.at for s in slid]
    near = distinct(job.shape, ends, len(ends), DECISIVE)
    slid = [s for s, end in zip(slid, ends, strict=True) if end in near]
    return best_first(solves.add(freed_to_tilt(job, s)) for s in slid)


def _solve_best_hypotheses(job, kept, solves, start, earlier) -> list[Solved]:
    """Return the page solved from the best hypotheses, best first.

    Where the first ones, which continue `start`, explain the new data, they are solved
    alone.  Of the same data, the solution of `start` competes.
    """
    limit = min(h.objective for h in kept) + LEAST_MOTION_BEHIND
    levels = levels_of(job)
    promising = [h for h in kept if h.objective <= limit]
    promising = under_distinct_relabellings(job, promising)
    paths = [s.hypothesis.x for s in earlier]
    promising = [h for h in promising if not any(np.array_equal(h.x, x) for x in paths)]
    few = start is not None and promising and not earlier
    close = promising[0].objective + UNCHANGED if few else np.inf
    first = [h for h in promising if h.objective <= close]
    again = [*earlier, *([] if start is None else solve_from_estimate(job, start))]
    solved = multistart(job, first, levels, again, solves)
    solved = best_first([*solved, *again])
    if len(first) < len(promising) and not still_explained(solved[0], start):
        rest = promising[len(first) :]
        others = multistart(job, rest, levels, solved, solves.part())
        solved = best_first([*solved, *others])
    return [s for s in solved if s.solution.success] or solved


def solve_from_estimate(job, start) -> list[Solved]:
    """Return the page solved from the solution of `start`, if it is of all the data."""
    same_data = start.success and start.measurements.samples == job.data.samples
    if not same_data or {**start.reductions} != asdict(job.reductions):
        return []
    return [warm_started(job, past_solution(job, start))]


def far_behind(request, best: Solved) -> bool:
    """Tell whether a class is of no weight beside another one, whose fit is good.

    Its turned sensors and soft fingertips are tried, since they may explain the data as
    well; tilts, another search and certificates are not: a trajectory that was lost is
    found from the poses of the other class.
    """
    behind = best.solution.objective > request.to_beat + NEGLIGIBLE
    if behind:
        log.info("far behind another class: no other motions, no certificates")
    return behind


def update_costs_too_much(request, best: Solved) -> bool:
    """Tell whether an update costs more than its new actions should.

    It applies to shapes with sizes.  The posterior from which the update started no
    longer contains the right trajectory.
    """
    start, job = request.start, request.job
    if job.shape.of_vertices or not can_update(start, job):
        return False
    most = update_limit(start, new_actions(start, job.data))
    return job.deadline.left > 0 and best.solution.objective > most


def fits_badly(request, best: Solved, physics_least: float = DECISIVE) -> bool:
    """Tell whether a body on the ground may have moved otherwise than it was found.

    Its touches cost more than expected: the fit is not good; or it moved between two
    actions, but neither slid on nor was pushed on (noise leaves this open for a
    polytope); or precise touches agree with poses that physics does not, by more than
    physics_least [nats] and what each action leaves, a long one more.
    A second search may find a lower optimum: action by action, with more process noise,
    or without a body that is carried.  Of a class with sizes that is no box, the class
    may be wrong.
    """
    job = best.job
    sought = job.shape.faced or job.shape.of_vertices
    sought = sought or isinstance(request.start, Estimate)
    sought = sought and request.job.reductions.planar
    if not (sought and best.solution.success):
        return False
    problem, fit = best.problem, best.fit
    if fit is not None and fit.verdict != "good":
        return True
    # Of soft fingertips physics has no row.
    rows = {} if fit is None else fit.terms
    physics = rows[PHYSICS_ROW].actual if PHYSICS_ROW in rows else 0.0
    count = max(job.data.actions, len(best.window.step) / STEPS_OF_ACTION)
    limit = physics_least + PHYSICS_SHARE * count
    exact = precise(job.data, job.precision)
    if exact and physics > limit:
        return True
    if job.shape.of_vertices and not exact:
        return False
    if BETWEEN_ACTIONS not in problem.costs or not len(best.window.gap):
        return False
    x, data = best.solution.at(problem)
    return bool(problem.value(BETWEEN_ACTIONS, x, data).max() > DECISIVE)
