"""Optima of the page: search, local solves, model selection, certificates.

After the page is solved from the starts of a search, its model is revised, each step
from the best solve before.  Modules of refinement/, when each is used, its changes:

    sensor_lags           promised by a Newton step: latency, lag of normals
    ground_tilt           touches cost too much: the tilt of the ground
    nested_models         touches cost too much: turned sensors, compliance, centre
    ground_tilt           turns of sensors were freed: a tilt in their place
    incremental_polytope  an update of a polytope costs too much: another one
    model_selection       always: the optimum of the largest evidence is the best
    axis_names            always: order and signs of a box's axes
    certification         a reduction does not hold: it is not made
    rocking_body          touches cost too much: free motion, from tilts; then
                          ground_tilt again
    certification         flat poses are contradicted: free motion, from tumbles
    profile_likelihood    a size was not touched: its sigma, or a better optimum
    certification         flat poses alone tell an untouched height: free motion

A search is repeated from the first touch where the objective says that it has lost the
trajectory, with a latency of the sensors or soft fingertips of a polytope that were
found, and on a ground that was found to lean (second_searches.py).  Where the fit is
not good, or physics costs more than usual, another one draws more bodies at the first
touch; if that does not help, one solves the page after every action, and continues its
optima, not tracks of the filter alone.  Of a polytope the latter comes first, then one
that continues more paths.  The better result counts.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from ..interface.request import Request
from ..interface.result import Estimate
from ..local.comparison import distinct, same_body
from ..local.margins import DECISIVE, DOUBTFUL, LEAST_MOTION_BEHIND
from ..local.solved import Solved, comparable
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..refinement.axis_names import in_canonical_axes
from ..refinement.certification import (
    certified,
    restore_reductions,
    solve_other_motions,
    solve_profiles,
)
from ..refinement.ground_tilt import estimate_ground_tilt, tilt_ground_for_turns
from ..refinement.incremental import can_update
from ..refinement.incremental_polytope import continuation_if_implausible
from ..refinement.model_selection import most_probable
from ..refinement.nested_models import free_nuisance_parameters
from ..refinement.refinement import (
    far_behind,
    fits_badly,
    solve_from_hypotheses,
)
from ..refinement.sensor_lags import estimate_lags, lost_by_latency
from ..solvers.solution import check_finite
from .few_starts import FewStarts, update_from_few_starts
from .initial_search import REFINEMENT_END, initial_hypotheses
from .interrupted import Incumbents
from .second_searches import (
    from_more_hypotheses,
    in_time,
    job_to_search_again,
    search_that_may_gain,
)

log = logging.getLogger("tactilenlp")
CERTIFICATES_END = 1.0  # [-] of the time until the readout
OTHER_SOLVES = "other solves of the page"  # in a status, where time ends them


@dataclass(frozen=True, eq=False)
class Optima:
    """The optima of a page, and the hypotheses that led to them.

    best: the most probable optimum, certified, None if the time limit came first;
    solved: all optima, best first; kept: hypotheses of the search, for the next action;
    starts: those that the page was solved from.
    """

    best: Solved | None
    solved: list[Solved]
    kept: list[Hypothesis]
    starts: list[Hypothesis]

    @property
    def rank(self) -> tuple[bool, float]:
        """The key to sort by: that of the best one."""
        return (True, np.inf) if self.best is None else self.best.rank

    @property
    def modes(self) -> list[Solved]:
        """The optima that are believed beside the best one."""
        return comparable(self.best, self.solved)

    def for_next_action(self, width: int) -> list[Hypothesis]:
        """Return those for the next action: distinct optima, the best among them."""
        job, solved = self.solved[0].job, self.solved
        if job.shape.of_vertices:
            return [solved[0].at]
        if not job.reductions.planar:
            return self.kept[:width]
        best = self.best.at  # by evidence: others may have lower objectives
        ends = [best] * self.best.job.reductions.planar + [s.at for s in solved]
        return distinct(job.shape, ends, width, LEAST_MOTION_BEHIND, first=best)


def optima_of(
    request: Request, incumbents: Incumbents, update: Solved | None = None
) -> Optima:
    """Return the optima of the page of a request.

    incumbents: what is left by Ctrl-C, filled; update: a rejected incremental update,
    which competes.
    """
    optima = _search_once(request, incumbents, update)
    if optima.best is None or far_behind(request, optima.best):
        return optima
    if (second := search_that_may_gain(request, optima.best)) is not None:
        other = _search_once(second, Incumbents([], incumbents.solves), update)
        optima = min(optima, other, key=lambda o: o.rank)

    def certify(solved: Solved) -> Solved:
        flat = restore_reductions(solved)
        return solve_other_motions(solved.job, flat, request.executor)

    optima = certify_best(request, optima, certify)
    searches = [(_search_from_more_hypotheses, DOUBTFUL), (_search_by_action, DECISIVE)]
    if request.job.shape.of_vertices:  # more paths of a polytope are not cheap
        searches = [(search, DECISIVE) for search, _ in reversed(searches)]
    for search, physics_least in searches:
        searched = request.job.search.hypothesis is None
        if not (searched and fits_badly(request, optima.best, physics_least)):
            break
        other = search(request, optima.best.job)
        if other is not None and _differs(other.best, optima.solved):
            other = certify_best(request, other, certify)
            optima = min(optima, other, key=lambda o: o.rank)
    best = optima.best
    with best.job.deadline.ending("profile likelihoods"):
        best = solve_profiles(best)
    return replace(optima, best=best)


def _search_once(
    request: Request, incumbents: Incumbents, update: Solved | None = None, earlier=()
) -> Optima:
    """Return the optima that one search leads to, the best one not certified.

    incumbents: their hypotheses are continued, and replaced by those that are found;
    update: as of `optima_of`; earlier: solves of the same job, which compete.  Where
    sensors are found to be late, which the search took for prompt, and the fit is not
    good, the optima are those of a search from scratch with that latency; of a polytope
    whose fingertips are found to be soft, of one with these.
    """
    first = update_from_few_starts(request, incumbents)
    first = first._replace(solved=[*earlier, *first.solved])
    if first.enough:
        hypotheses = starts = [s.at for s in first.solved]
    else:
        hypotheses, starts = initial_hypotheses(request, incumbents, first.search)
        starts = [in_canonical_axes(request.job.shape, h, request.axes) for h in starts]
    incumbents.kept, incumbents.searched = hypotheses, incumbents.spent
    solved = _solve_page(request, starts, incumbents, first, update)
    if solved and (job := job_to_search_again(request.job, solved[0])) is not None:
        second = replace(request, job=job).from_scratch()
        return _search_once(second, Incumbents([], incumbents.solves), update, solved)
    return Optima(solved[0] if solved else None, solved, hypotheses, starts)


def _search_from_more_hypotheses(request: Request, like: Job) -> Optima | None:
    """Return the optima of a search from more hypotheses, if there is time for one.

    like: as of `_search_by_action`.
    """
    if (wide := from_more_hypotheses(request, like)) is None:
        return None
    optima = _search_once(wide, Incumbents([]))
    return None if optima.best is None else optima


def _search_by_action(request: Request, like: Job) -> Optima | None:
    """Return the optima of a search that solves the page after every action.

    Where the fit after an action is not good, that action is searched again, less sure
    of how pushes move the body, as long as this finds more; of a polytope no pushes are
    predicted.  Of shapes with sizes and noisy sensors, twice as many hypotheses are
    kept, and starts solved, as by the first search.  like: the job of a solve of all
    actions, as which it begins (`Job.as_found`).  None if time ends it.
    """
    jobs, update = request.jobs_by_action(), isinstance(request.start, Estimate)
    with_sizes = searches_rougher = not request.job.shape.of_vertices
    if not (with_sizes or update or len(jobs) > 1):
        return None  # it would be the same search
    log.info("the trajectory is doubtful: searching action by action")
    request = replace(request.from_scratch(), doubtful=with_sizes)
    hypotheses, optima = [], None
    for job in jobs:
        if not in_time(request):
            return None
        so_far = replace(request, job=job.as_found(like))
        optima = _search_once(so_far, Incumbents(hypotheses))
        if optima.best is None:
            return None
        if searches_rougher and fits_badly(so_far, optima.best) and in_time(request):
            rough = so_far.less_sure_of_pushes()
            other = _search_once(rough, Incumbents(hypotheses))
            searches_rougher = other.rank < optima.rank
            optima = other if searches_rougher else optima
        hypotheses, like = optima.for_next_action(request.widths[0]), optima.best.job
    return optima


def _differs(optimum: Solved, solved) -> bool:
    """Tell whether a solve is better than others, or another body where they end.

    Paths to the same end may be far apart on the way.
    """
    alike = (same_body(optimum.job.shape, optimum.at, s.at) for s in solved)
    return optimum.rank < min(s.rank for s in solved) or not any(alike)


def _solve_page(
    request: Request, starts, incumbents: Incumbents, first: FewStarts,
    update: Solved | None,
) -> list[Solved]:  # fmt: skip
    """Return the page solved from the starts, then of larger models, best first.

    incumbents: where solves are added; first: solves from some of the starts, alone
    where they suffice; update: see `optima_of`.  No solves if the time limit came
    before the first one ended.
    """
    job, enough = request.job_until(REFINEMENT_END), first.enough
    solves = incumbents.solves.part(first.solved)
    past = request.start if can_update(request.start, job) else None

    def from_starts(job, starts, earlier=()) -> list[Solved]:
        """Solve one job, whose solves compete with each other alone."""
        return solve_from_hypotheses(job, starts, solves.part(), past, earlier)

    def solve_larger(free, h, alone: bool) -> list[Solved]:
        """Solve a larger model from the optimum of the smaller, and from all starts."""
        h = replace(h, objective=starts[0].objective)  # of the search
        larger = from_starts(free, [h] if alone else [h, *starts])
        return [s for s in larger if s.job is free]

    solved = []
    with job.deadline.ending(OTHER_SOLVES):
        solved = first.solved if enough else from_starts(job, starts, first.solved)
        check_finite(solved[0].problem, solved[0].solution)
        solved = estimate_lags(solved)
        if not lost_by_latency(request.job, solved[0]):
            solved = _solve_larger_models(solved, solve_larger)
            solved = continuation_if_implausible(solved, update)
    return solved or solves.best_first()


def _solve_larger_models(flat, solve_larger) -> list[Solved]:
    """Return solves, on a ground that leans, with what the data set free."""
    leaning = estimate_ground_tilt(flat)
    larger = free_nuisance_parameters(leaning, solve_larger)
    same_model = larger[0].job.reductions == flat[0].job.reductions
    if leaning is not flat and not same_model:
        # The tilt did not explain enough: what was freed then may do without it.
        level = free_nuisance_parameters(flat, solve_larger)
        larger = min(larger, level, key=lambda solves: solves[0].rank)
    return tilt_ground_for_turns(larger)


def certify_best(request: Request, optima: Optima, certify) -> Optima:
    """Return optima of which the most probable one has its axes named, certified.

    certify(solved): a solve with certificates, or a better one.
    """
    deadline = request.job_until(CERTIFICATES_END).deadline
    solved = [replace(s, job=replace(s.job, deadline=deadline)) for s in optima.solved]
    best = solved[0]
    with deadline.ending("certificates"):
        best = most_probable(solved)
        best, solved = certified(best, solved, request.axes, certify)
    return replace(optima, best=best, solved=solved)
