"""solve_estimate: from measurements to shape, poses and impulses.

The steps, in this order: request, search, refinement, certificates, readout.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import ModuleType

import numpy as np

from formulations.shape import Shape

from ..common.deadline import Deadline
from ..common.interrupt import interruptible
from ..common.threads import on_one_thread
from ..data.scene import Scene
from ..errors import typed_call
from ..geometry.transforms import is_planar
from ..nlp.solution import check_finite
from ..problem.reductions import Reductions
from ..search.hypothesis import Hypothesis, Job, distinct, same
from ..search.local_solve import Solved, best_first
from ..search.margins import LEAST_MOTION_BEHIND
from ..search.multi_hypothesis import search_boxes
from ..search.multistart import multistart
from ..search.polytope_init import search_polytope
from ..search.proposals_floating import (
    in_free_motion,
    in_plane,
    in_search_plane,
    search_plane,
    with_faces_tracked,
    with_tilted_normals,
)
from ..search.proposals_surface import on_poses
from .certification import certified, checked, with_profiles
from .coarse_to_fine import (
    at_full_rate,
    at_rows,
    at_tracked,
    interpolated,
    tracked_rows,
)
from .incremental_polytope import repaired, updated
from .interrupted import SoFar, interrupted, not_solved, raise_unless_good
from .model_selection import (
    classes_of,
    likeliest_class,
    most_probable_first,
    with_nuisance_parameters,
)
from .options import PROCESS, Guess, Options, Session
from .readout import name_of, read_off
from .refinement import (
    continues,
    costs_too_much,
    misses,
    on_leaning_ground,
    refined,
    with_named_axes,
    with_rough_motion,
)
from .request import Request, first_guess, read_request
from .result import Estimate

log = logging.getLogger("tactilenlp")
# [-] of the time until the readout, at which each step ends
SEARCH_END, REFINEMENT_END, CERTIFICATES_END = 0.5, 0.85, 1.0


@typed_call()
@on_one_thread
def solve_estimate(
    data,
    scene: Scene | None = None,
    *,
    shape: str | Shape | Sequence = "cuboid",
    formulation: str | ModuleType = "violation_implicit",
    options: Options | None = None,
    start: Estimate | Guess | None = None,
    executor=None,
    throw: bool = True,
    session: Session | None = None,
) -> Estimate:
    """Find shape, poses and impulses that explain the measurements (eq:vimp).

    data: Measurements.  scene: what is known (default Scene()).  shape: "cuboid",
    "polytope" (20 vertices), formulations.polytope.polytope(30), a Shape, or a list of
    them, or "auto": the class of the largest evidence is returned, with the odds of all
    in estimate.classes.
    formulation: "quasi_static", "violation_implicit", "multiple_shooting", "shooting",
    "complementarity", "paper" or a page (module with `build`, `LEVELS`).  start: an
    earlier Estimate of the first actions (for a polytope: of any shape), even of a part
    of an action that still runs, or a Guess.  executor: any concurrent.futures executor
    of processes.  session: keeps term functions for solves that start from this
    estimate; by default one for the process.

    Raises NoContactError, MeasurementError, OptionError, StartError before any solve,
    and NotConverged or MotionError after it unless `throw` is False; their `estimate`
    is what throw=False returns, also where the time limit ended the solve.  Ctrl-C
    raises Interrupted, whose `estimate` of the actions done by then can be a start.
    """
    given = {
        "formulation": formulation, "executor": executor, "throw": throw,
        "session": PROCESS if session is None else session,
    }  # fmt: skip
    if classes := classes_of(shape):
        one = partial(estimate_of_class, data, scene, **given)
        return likeliest_class(classes, one, start, options or Options())
    return estimate_of_class(
        data, scene, shape=shape, options=options, start=start, **given
    )


def estimate_of_class(
    data, scene, *, shape, formulation, options, start, executor, throw, session,
    poses=None, most=np.inf,
) -> Estimate | None:  # fmt: skip
    """Return the estimate of one class of shapes; arguments as of solve_estimate.

    poses: an Estimate of another class, whose poses are taken instead of a search.
    None if they leave touches that cost more than `most` [nats].
    """
    if poses is not None:
        scene = (Scene() if scene is None else scene).on_ground_of(poses.scene)
        start = poses if shape.parameters == "vertices" else None
    request, known = read_request(
        data, scene, shape, formulation, options, start, executor, session
    )
    if poses is not None and start is None:
        path = on_poses(request.job, poses)
        if path is None or path.objective > most:
            return None
        request = replace(request, job=replace(request.job, path=path))
    so_far = SoFar(known)
    try:
        with interruptible():
            estimate, best = _estimated(request, so_far)
    except KeyboardInterrupt as stop:
        raise interrupted(request, so_far) from stop
    session.keep(estimate, request.job, request.page)
    if throw:
        raise_unless_good(estimate, best)
    return estimate


@dataclass(frozen=True, eq=False)
class _Found:
    """What search and refinement found.

    job: of the best; best: the most probable optimum, certified, None if time was out;
    solved: all optima; kept, starts: hypotheses of the search for the next action, and
    as which the page started; searched [s].
    """

    job: Job
    best: Solved | None
    solved: list[Solved]
    kept: list[Hypothesis]
    starts: list[Hypothesis]
    searched: float

    @property
    def modes(self) -> list[Solved]:
        """The optima in the kind of motion of the best one."""
        motion = self.best.window.motion
        return [
            s for s in self.solved if s.solution.success and s.window.motion is motion
        ]


def _estimated(request: Request, so_far: SoFar) -> tuple[Estimate, Solved]:
    """Return the estimate of a request, and the solved page that it was read from."""
    page, options, start = request.page, request.options, request.start
    job, update, accepted = request.job_until(CERTIFICATES_END), None, False
    with job.deadline.ending("an incremental update"):
        update, accepted = updated(job, page, start, options, certified)
    if accepted:
        so_far.kept = [update.at]
        return _read(request, update, so_far, 0.0, [update]), update
    rows = tracked_rows(request)
    if rows is None:
        found = _optima(request, so_far, update)
    else:
        found = _optima_of_dense(request, rows, so_far)
    if found.best is None:
        return not_solved(request, found.starts, so_far.spent)
    so_far.kept = _carried_on(found.job, found.solved, found.kept, request.widths[0])
    return _read(request, found.best, so_far, found.searched, found.modes), found.best


def _optima(request: Request, so_far: SoFar, update=None) -> _Found:
    """Return the optima of the page, by search and refinement, the best certified."""
    kept, starts = _searched(request, so_far.kept)
    so_far.kept, searched = kept, so_far.spent
    job, solved = _refined(request, starts, so_far, update)
    if solved and costs_too_much(request, solved[0]):
        anew = replace(request, start=None)
        more, starts = _searched(anew, [])
        other, found = _refined(anew, starts, so_far, update)
        if found and found[0].rank < solved[0].rank:
            job, solved, kept = other, found, more
    if not solved:
        return _Found(job, None, [], kept, starts, searched)
    best, solved = _checked(request, job, solved)
    sought = request.job.path is None and misses(request, best)
    if sought and request.job_until(SEARCH_END).deadline.left > 0:
        rough = with_rough_motion(request)
        more, starts = _searched(rough, [])
        other, found = _refined(rough, starts, so_far, None)
        if found and not any(same(job.shape, found[0].at, s.at) for s in solved):
            again, found = _checked(rough, other, found)
            if again.rank < best.rank:
                best, job, solved, kept = again, other, found, more
    with job.deadline.ending("profile likelihoods"):
        best = with_profiles(request.page, best, request.options)
    return _Found(job, best, solved, kept, starts, searched)


def _optima_of_dense(request: Request, rows, so_far: SoFar) -> _Found:
    """Return the optima at all samples, from those at some rows (coarse_to_fine.py)."""
    page, options, data = request.page, request.options, request.job.data
    part = SoFar([at_tracked(h, rows) for h in so_far.kept])
    try:
        found = _optima(at_rows(request, rows), part)
    except KeyboardInterrupt:
        flat = [s.at for s in part.solved if is_planar(s.at.x)] or part.kept
        so_far.kept = [interpolated(h, data, rows) for h in flat]
        raise
    kept, starts = (
        [interpolated(h, data, rows) for h in some]
        for some in (found.kept, found.starts)
    )
    so_far.kept = kept
    if found.best is None:
        return replace(found, kept=kept, starts=starts)
    dense = at_full_rate(request, found.best.job)
    optima = [interpolated(s.at, data, rows) for s in (found.best, *found.modes)]
    optima = distinct(dense.job.shape, optima, request.widths[1], LEAST_MOTION_BEHIND)
    job, solved = dense.job_until(REFINEMENT_END), so_far.solved
    with job.deadline.ending("other solves of the page"):
        multistart(job, page, optima, options, page.LEVELS, solved=solved)
    job = dense.job_until(CERTIFICATES_END)
    solved = [_restamped(s, job.deadline) for s in best_first(solved)]
    if not solved:
        return _Found(job, None, [], kept, optima, found.searched)
    best = solved[0]
    with job.deadline.ending("certificates"):
        if not job.deadline.passed("evidence of other optima"):
            best, *_ = most_probable_first(job, solved)
        best = certified(job, page, best, options)
    known = found.best
    best = replace(best, declined=known.declined, profile=known.profile)
    return _Found(job, best, solved, kept, optima, found.searched)


def _checked(request, job, solved) -> tuple[Solved, list[Solved]]:
    """Return the most probable solve, certified, and all solves."""
    page, options = request.page, request.options
    best, *_ = solved = [_restamped(s, job.deadline) for s in solved]
    cut = replace(job, cuts=best.job.cuts)
    with job.deadline.ending("certificates"):
        if not job.deadline.passed("evidence of other optima"):
            best, *_ = most_probable_first(job, solved)
        named = with_named_axes(cut, page, best, options, request.axes)
        solved = [named if s is best else s for s in solved]
        best = named
        best = checked(cut, page, best, options, request.executor)
    return best, solved


def _refined(request, starts, so_far, update) -> tuple[Job, list[Solved]]:
    """Return the page solved, best first, and the job that the best was solved by.

    No solves if the time limit came before the first one ended.
    """
    page, options, start = request.page, request.options, request.start
    job, solved = request.job_until(REFINEMENT_END), None
    earlier = start if continues(start, page) else None

    def freed(free, first, alone: bool) -> list[Solved]:
        """Solve a larger model from the optimum of the smaller, and from all starts."""
        first = replace(first, objective=starts[0].objective)  # of the search
        several = [first] if alone else [first, *starts]
        found = refined(free, page, several, options, so_far.solved, earlier)
        return [s for s in found if s.job is free]

    with job.deadline.ending("other solves of the page"):
        solved = refined(job, page, starts, options, so_far.solved, earlier)
        check_finite(solved[0].problem, solved[0].solution)
        job, solved = on_leaning_ground(job, page, solved, options)
        job, solved = with_nuisance_parameters(job, page, solved, options, freed)
        solved = repaired(job, page, solved, options, update)
    if solved is None:
        solved = best_first(so_far.solved)
        job = solved[0].job if solved else job
    return replace(job, deadline=request.job_until(CERTIFICATES_END).deadline), solved


def _restamped(solved: Solved, deadline: Deadline) -> Solved:
    """Return a solve whose job has another deadline."""
    return replace(solved, job=replace(solved.job, deadline=deadline))


def _read(request, best, so_far, searched: float, modes) -> Estimate:
    """Return the estimate read from the best page; searched [s] of CPU time."""
    seconds = best.solution.seconds | {"search": searched, "total": so_far.spent}
    deadline = request.job.deadline
    deadline = deadline.until(deadline.at, strict=True)
    return read_off(request, best, so_far.kept, seconds, deadline, modes)


def _searched(request: Request, kept) -> tuple[list[Hypothesis], list[Hypothesis]]:
    """Return hypotheses for the next action, and the same as the page starts from them.

    kept: a list of those to begin with; holds those of the actions done so far.  A
    floating object is searched in the plane of its touches.
    """
    start, plane = request.start, None
    if (path := request.job.path) is not None:
        return [path], [path]
    job = request.job_until(SEARCH_END, strict=False)
    lean = replace(job, reductions=Reductions())  # whatever the last solve leaves out
    if job.scene.ground is None:
        plane = search_plane(job, start if isinstance(start, Guess) else None)
        lean = in_search_plane(lean, plane)
    search = {"sizes": _search_sizes, "vertices": _search_vertices}
    found = search[job.shape.parameters](request, lean, plane, kept)
    if plane is None:
        return found, found
    starts = [in_free_motion(h, plane, job.shape) for h in found]
    if job.shape.last_pose_held:
        starts += [with_faces_tracked(h, job.data) for h in starts]
    return found, starts


def _search_sizes(request: Request, job, plane, kept) -> list[Hypothesis]:
    """Return hypotheses of a shape with sizes: multi-hypothesis tracking.

    What another page found, or a search that was interrupted, is no posterior of this
    page: all actions are tracked again.
    """
    start, starts = request.start, request.widths[1]
    job = replace(job, first=first_guess(start, job.shape))
    if isinstance(start, Estimate) and start.formulation != name_of(request.page):
        kept[:] = []
    kept[:] = search_boxes(job, kept, starts, request.executor, so_far=kept)
    return kept


def _search_vertices(request: Request, job, plane, kept) -> list[Hypothesis]:
    """Return hypotheses of a polytope: poses and planes, then its vertices."""
    if plane is None:
        return search_polytope(job, kept, so_far=kept)
    kept[:] = [in_plane(h, plane) for h in kept]
    found = search_polytope(job, kept, so_far=kept)
    (other,) = search_polytope(with_tilted_normals(job), kept, so_far=kept)
    # Its objective has other weights.
    return [*found, replace(other, objective=found[0].objective)]


def _carried_on(job, solved, kept, width: int) -> list[Hypothesis]:
    """Return the hypotheses for the next action: the distinct optima of the page."""
    if job.shape.hypotheses is not None:
        return [s.at for s in solved[: job.shape.hypotheses]]
    if not job.reductions.planar:
        return kept[:width]
    return distinct(job.shape, [s.at for s in solved], width, LEAST_MOTION_BEHIND)
