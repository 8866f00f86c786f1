"""solve_estimate: from measurements to shape, poses and impulses."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from types import ModuleType

from formulations.shape import Shape

from ..common.interrupt import interruptible
from ..common.validation import check_types
from ..data.measurements import Measurements
from ..data.scene import Scene
from ..data.sensor_noise import precise, precision_of, smoothed
from ..errors import MotionError
from ..nlp.solution import not_converged
from ..problem.certificates import certify, without
from ..problem.outliers import check_explained, contradicts
from ..problem.pages import is_polytope
from ..problem.reductions import Reductions, flat, insisted
from ..search.beam import RIVAL, beam
from ..search.hypothesis import Hypothesis, Job, distinct, same
from ..search.local_solve import CLOSE, Solved, gone_on, settings_of, solved_from
from ..search.polytope_init import search as polytope_search
from ..search.profile_likelihood import profiled
from ..search.proposals_floating import (
    flattened,
    floated,
    followed,
    laid_out,
    plane_for,
    tilting,
)
from ..search.proposals_tumble import recovered
from .incremental_polytope import explained, updated
from .interrupted import SoFar, interrupted
from .options import Guess, Options
from .readout import name_of, read_off
from .refinement import refined
from .request import asked, carried, check_touched, first_guess
from .result import Estimate

log = logging.getLogger("tactilenlp")
ASTRAY = 1.0  # [nats] more freedom costs no more than what new resting steps do
PUT_BACK = 2  # times that a problem is solved again with what it needs after all
TUMBLES = 3  # guesses of a tumble at most that are solved in free motion


def solve_estimate(
    data,
    scene: Scene | None = None,
    *,
    shape: str | Shape = "cuboid",
    formulation: str | ModuleType = "violation_implicit",
    options: Options | None = None,
    start: Estimate | Guess | None = None,
    executor=None,
    throw: bool = True,
) -> Estimate:
    """Find shape, poses and impulses that explain what the fingers felt (eq:vimp).

    data: Measurements.  scene: what is known (default Scene()).  shape: "cuboid",
    "polytope" (20 vertices), formulations.polytope.polytope(30), or a Shape.
    formulation: "quasi_static", "violation_implicit", "multiple_shooting", "shooting",
    "complementarity", "paper" or a page (module with `build`, `LEVELS`).  start: an
    earlier Estimate of the first actions (for a polytope: of any shape), even of a part
    of an action that still runs, or a Guess.
    executor: any concurrent.futures executor; processes, not threads.

    Raises NoContactError, MeasurementError, OptionError, StartError before any solve,
    and NotConverged or MotionError after it unless `throw` is False.  Ctrl-C raises
    Interrupted, whose `estimate` is of the actions done by then: a start to go on from.
    """
    check_types(data=(data, Measurements))
    scene, shape, options, page = asked(scene, shape, formulation, options, executor)
    scene.check(data)
    check_touched(data)
    job = _job(data, scene, shape, options, time.monotonic(), page)
    so_far = SoFar([] if start is None else carried(start, shape, scene, data))
    try:
        with interruptible():
            estimate, best = _found(data, job, page, start, options, executor, so_far)
    except KeyboardInterrupt as stop:
        raise interrupted(data, job, page, options, so_far) from stop
    if throw:
        _raise_unless_good(estimate, best)
    return estimate


def _found(data, job, page, start, options, executor, so_far):
    """Return the estimate of a job, and the solved page that it was read off."""
    update, good = updated(job, page, start, options, _certified)
    if good:
        so_far.kept = [update.at]
        return _read(data, job, page, options, update, so_far, 0.0, [update]), update
    kept, starts = _searched(job, page, so_far.kept, start, options, executor)
    so_far.kept, searched = kept, so_far.spent
    known = start if _was_challenged(start, page) else None
    solved = refined(job, page, starts, options, so_far.solved, known)
    solved = explained(job, page, solved, options, update)
    best = _certified(replace(job, cuts=solved[0].job.cuts), page, solved[0], options)
    fell = "planar" in best.certificates.broken and not flat(page)
    if fell and not is_polytope(job.shape):
        best = _tumbled(job, page, best, options, executor)
    elif options.rivals and best.solution.success:
        best = _profiled(job, page, best, options)
    so_far.kept = _carried_on(job, solved, kept, _widths(job, options)[0])
    alike = [s for s in solved if s.solution.success]
    others = [s for s in alike if s.window.motion is best.window.motion]
    return _read(data, job, page, options, best, so_far, searched, others), best


def _read(data, job, page, options, best, so_far, searched, rivals) -> Estimate:
    """Return the estimate read off the best page; searched [s] of CPU."""
    seconds = best.solution.seconds | {"search": searched, "total": so_far.spent}
    given = page, options, best, so_far.kept, seconds, time.monotonic() > job.deadline
    return read_off(data, job, *given, rivals)


def _was_challenged(start, page) -> bool:
    """Tell whether a start is an estimate whose rivals this page was asked for."""
    if not (isinstance(start, Estimate) and start.success):
        return False
    return start.options["rivals"] and start.formulation == name_of(page)


def _searched(job, page, kept, start, options, executor):
    """Return hypotheses to carry on, and the same as the page starts from them.

    kept: a list of those to begin with; holds those of the actions done so far.
    """
    # A search is as lean as it can be, whatever the last solve leaves out.
    search, plane = replace(job, reductions=Reductions()), None
    if job.scene.ground is None:
        plane = plane_for(job, start if isinstance(start, Guess) else None)
        search = laid_out(search, plane)
    if is_polytope(job.shape):
        kept[:] = kept if plane is None else [flattened(h, plane) for h in kept]
        found = polytope_search(search, kept, so_far=kept)
        if plane is not None:
            (other,) = polytope_search(tilting(search), kept, so_far=kept)
            found += [replace(other, objective=found[0].objective)]  # of other weights
    else:
        search = replace(search, first=first_guess(start, job.shape))
        ranks = page if plane is None else None
        widths = _widths(job, options)
        found = beam(search, kept, *widths, executor, ranks, so_far=kept)
    if plane is None:
        return found, found
    starts = [floated(h, plane, job.shape) for h in found]
    if is_polytope(job.shape):
        starts += [followed(h, job.data) for h in starts]
    return found, starts


def _widths(job, options) -> tuple[int, int]:
    """Return how many hypotheses are kept, and starts solved, after an action."""
    return options.widths(precise(job.data, job.precision))


def _job(data, scene, shape, options, began, page) -> Job:
    """Return what a solve needs: data in the ground's frame, noisy paths smoothed."""
    ground = scene.ground
    if ground is not None:
        data = data.transformed(ground.rotation, ground.translation)
    precision = precision_of(data, scene)
    made = Reductions.of(options.reduce)
    if ground is None:  # nothing keeps the object flat
        made = without(made, ["planar"])
    return Job(
        data=smoothed(data, precision), scene=scene, shape=shape, precision=precision,
        reductions=insisted(page, made), deadline=began + options.time_limit,
    )  # fmt: skip


def _certified(job, page, solved, options) -> Solved:
    """Check what was dropped; put back what was needed and solve again.

    Still spans are cut first where they would move, and dropped if that was not enough.
    """
    found = certify(job, page, solved)
    for _ in range(PUT_BACK):
        back = [name for name in found.broken if name != "planar"]
        if not back:
            break
        log.info("needed after all: %s", ", ".join(back))
        more = {*found.cuts, *job.cuts}
        if found.cuts and (not job.cuts or is_polytope(job.shape)):
            job = replace(job, cuts=tuple(sorted(more)))
            back.remove("still")
        job = replace(job, reductions=without(job.reductions, back))
        again = _solved_on(job, page, solved, options)
        if again.solution.objective > solved.solution.objective + ASTRAY:
            break  # another optimum, which is worse: what does not hold is said
        solved, found = again, certify(job, page, again)
    return replace(solved, certificates=found)


def _profiled(job, page, best, options) -> Solved:
    """Return the best with the profile of its sizes; or a better one that is met."""
    profile, better = profiled(job, page, best, options)
    if better is not None:
        again = solved_from(job, page, better, options, levels=page.LEVELS[-1:])
        again = _certified(job, page, again, options)
        if again.rank < best.rank:
            best = again
            profile, _ = profiled(job, page, best, options)
    return replace(best, profile=profile)


def _solved_on(job, page, solved, options) -> Solved:
    """Solve again, with less left out, from where a solve ended."""
    again = gone_on(job, page, solved, settings_of(job, options), CLOSE)
    if again.solution.success:
        return again
    return solved_from(job, page, solved.at, options)


def _tumbled(job, page, flat, options, executor) -> Solved:
    """Solve in free motion from guesses of a tumble; keep the best, or the flat one."""
    evidence = contradicts(job, flat.window, flat.solution.values)
    found = recovered(job, evidence, *options.widths(precise=False), executor)
    free = replace(job, reductions=without(job.reductions, ["planar"]))
    levels = getattr(page, "ROUGH", page.LEVELS)
    solved = [
        solved_from(free, page, h, options, levels=levels) for h in found[:TUMBLES]
    ]
    better = [
        s for s in solved
        if s.solution.success and s.solution.objective < flat.solution.objective
    ]  # fmt: skip
    if not better:
        return flat
    best = min(better, key=lambda s: s.solution.objective)
    return replace(best, certificates=certify(free, page, best))


def _raise_unless_good(estimate, solved) -> None:
    if not estimate.success:
        raise not_converged(solved.problem, solved.solution)
    if estimate.scene.ground is None:
        check_explained(solved)
    tilted = [s for s in estimate.skipped if s.name == "planar" and not s.holds]
    if tilted:
        raise MotionError(
            "the object did not only slide",
            where="touch",
            got=f"{tilted[0].value:.0%} of an action's touches not explained",
            expected=f"at most {tilted[0].limit:.0%} by an object that lies flat",
            next="the object may have tilted or tumbled: select the actions before it "
            "did, let it tilt by Options(reduce='planar'), or pass throw=False",
            problem=solved.problem.describe(),
            solution=solved.solution,
        )


def _carried_on(job, solved, kept, width: int) -> list[Hypothesis]:
    """Return the hypotheses for the next action: those that the page prefers first."""
    if is_polytope(job.shape):
        return [s.at for s in solved[:1]]
    refined = [s.at for s in solved] if job.reductions.planar else []
    refined = distinct(job.shape, refined, width, RIVAL)
    rest = [h for h in kept if not any(same(job.shape, h, k) for k in refined)]
    return [*refined, *rest][:width]
