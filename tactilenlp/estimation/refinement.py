"""Refinement: the page solved from what the search found, by multistart.

Where the scene lets an object tilt, it is first solved as if it slid: the optimum of
free motion is close.

The ground is taken as it was told, or as an estimate that goes on had found it.  Where
the touches say that it leans, by as many nats as any larger model must gain
(model_selection.py), it is turned by what they say (information/sensitivity.py) and the
page solved again from the solution, a Newton step on the tilt at a time.
"""

from __future__ import annotations

import logging
from dataclasses import asdict, replace

import numpy as np

from formulations.centre_of_mass import NAME as CENTRE
from formulations.page_contract import contract_of

from ..data.sensor_noise import variance_left
from ..geometry.transforms import is_planar
from ..information.goodness_of_fit import fit_of
from ..information.sensitivity import ground_tilt
from ..nlp.kkt_sensitivity import kkt_system_of
from ..problem.certificates import planar_certificate
from ..problem.reductions import Reductions, required_reductions
from ..search.hypothesis import distinct, naming, turned
from ..search.local_solve import (
    RESTART_MU,
    Solved,
    best_first,
    freed_to_tilt,
    settings_of,
    solved_from,
    warm_started,
)
from ..search.margins import (
    CLOSE_OPTIMUM,
    LARGER_MODEL,
    LEAST_MOTION_BEHIND,
    RAN_AWAY,
    UNCHANGED,
    UPDATE_COST,
    UPDATE_SHARE,
)
from ..search.multistart import levels_of, multistart
from .incremental_polytope import past_solution, repaired
from .model_selection import excess_of
from .readout import name_of, problem_builder
from .result import Estimate

log = logging.getLogger("tactilenlp")
ROUGH_MOTION = 3.0  # [-] factor of the tracker's process noise, in a second search
MAX_TILTS = 4  # Newton steps on the tilt of the ground


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

    Where the first ones, which continue `start`, explain the new data, they are solved
    alone.  Of the same data, the solution of `start` competes.
    """
    limit = min(h.objective for h in kept) + LEAST_MOTION_BEHIND
    levels = levels_of(job, page)
    promising = [h for h in kept if h.objective <= limit]
    close = promising[0].objective + (np.inf if start is None else UNCHANGED)
    first = [h for h in promising if h.objective <= close]
    again = [] if start is None else solved_again(job, page, start, options)
    solved = multistart(job, page, first, options, levels, again, solved)
    solved = best_first([*solved, *again])
    if len(first) < len(promising) and not still_explained(solved[0], start):
        rest = promising[len(first) :]
        others = multistart(job, page, rest, options, levels, known=solved)
        solved = best_first([*solved, *others])
    good = [s for s in solved if s.solution.success]
    bound = min(h.objective for h in kept) + RAN_AWAY * job.data.actions
    lost = not good or good[0].solution.objective > bound
    lost = lost and levels is not page.LEVELS
    if lost and not job.deadline.passed("the page's own levels"):
        # Slower: they hold poses first.
        good = [*good, solved_from(job, page, solved[0].hypothesis, options)]
    return best_first(good or solved)


def solved_again(job, page, start, options) -> list[Solved]:
    """Return the page solved from the solution of `start`, if it is of all the data."""
    same_data = start.success and start.measurements.samples == job.data.samples
    if not same_data or {**start.reductions} != asdict(job.reductions):
        return []
    known, settings = past_solution(job, page, start), settings_of(job, options)
    return [warm_started(job, page, known, settings, RESTART_MU)]


def with_named_axes(job, page, solved, options, like) -> Solved:
    """Return a solve, or one of the same optimum with the axes of a box renamed.

    like: see `naming`.  A page that tells the axes apart, as by a prior of one side,
    decides itself: a renamed optimum that costs more is not taken.
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


def on_leaning_ground(job, page, solved, options) -> tuple:
    """Return job and solves, best first, on the ground that the touches tell of.

    Solves that are not close to the best are left out where the ground is turned.
    """
    level = best = solved[0]
    if not (may_lean(job, page) and best.solution.success):
        return job, solved
    excess, spread = excess_of(job, best)
    needed = LARGER_MODEL + spread
    if excess < needed:
        return job, solved
    for _ in range(MAX_TILTS):
        tilt, ground = _tilt_at(best, page), best.job.scene.ground
        if tilt.gain < (needed if ground.told is None else UNCHANGED):
            break
        if job.deadline.passed("a tilt of the ground"):
            break
        turned = ground.turned(tilt.mean, tilt.about)
        again = _on_ground(turned, best, page, options)
        if not again.solution.success or _cost(again) > _cost(best) - UNCHANGED:
            break
        best = again
    needed = needed if job.scene.ground.told is None else UNCHANGED
    if _cost(best) > _cost(level) - needed:
        return job, solved
    ground = best.job.scene.ground
    log.info("the ground leans by %s rad", ground.tilt.round(4))
    close = level.solution.objective + CLOSE_OPTIMUM
    others = [
        _on_ground(ground, s, page, options) for s in solved[1:]
        if s.solution.success and s.solution.objective < close
    ]  # fmt: skip
    return best.job, best_first([best, *others])


def may_lean(job, page) -> bool:
    """Tell whether the ground may lean, and a page be solved on another one."""
    scene = job.scene
    known = scene.ground is None or scene.sigma_tilt == 0
    return not known and "level" in contract_of(page).freed


def _tilt_at(solved: Solved, page):
    """Return the GroundTilt at a solve, about where the body was touched first."""
    job, kkt = solved.job, kkt_system_of(solved.problem, solved.solution)
    build = problem_builder(
        page, job.shape, job.scene, job.term_functions_of, job.deadline
    )
    touch = solved.window.touch
    early = job.data.action[touch.sample] == job.data.action[touch.sample[0]]
    about = touch.p_wf[early, :3].mean(axis=0) * (1, 1, 0)
    given = solved.window, job.data, job.scene, about
    return ground_tilt(kkt, build, *given)


def _on_ground(ground, solved: Solved, page, options) -> Solved:
    """Solve a page again on another ground, from its solution."""
    there = on_ground(solved.job, ground)
    settings = settings_of(there, options)
    again = warm_started(there, page, solved, settings, RESTART_MU)
    return replace(again, declined=solved.declined)


def on_ground(job, ground):
    """Return a job whose data are in the frame of another ground."""
    known = job.scene.ground
    if ground is known:
        return job
    R = ground.rotation @ known.rotation.T
    t = ground.rotation @ known.origin + ground.translation
    scene = replace(job.scene, ground=ground)
    return replace(job, scene=scene, data=job.data.transformed(R, t))


def _cost(solved: Solved) -> float:
    """Return the objective with the prior of the tilt of the ground [nats]."""
    scene = solved.job.scene
    off = scene.ground.tilt / scene.sigma_tilt
    return solved.solution.objective + float(off @ off) / 2


def continues(start, page) -> bool:
    """Tell whether a start is an estimate of this page."""
    good = isinstance(start, Estimate) and start.success
    return good and start.formulation == name_of(page)


def costs_too_much(request, best: Solved) -> bool:
    """Tell whether an update of a box costs more than its new actions should.

    The posterior that it tracked on from had then lost the right path.
    """
    start, job = request.start, request.job
    if job.shape.parameters != "sizes" or not continues(start, request.page):
        return False
    usual = max(start.objective, 0.0) / start.measurements.actions
    new = job.data.actions - start.measurements.actions
    most = start.objective + UPDATE_COST + UPDATE_SHARE * usual * new
    late = job.deadline.left <= 0
    return not late and best.solution.objective > most


def misses(request, best: Solved) -> bool:
    """Tell whether a body on the ground may have moved otherwise than it was found.

    Its touches cost more than expected: the fit is not good.  Another search finds
    more where it starts from the first touch instead of an estimate, or is less sure of
    how pushes move a box.
    """
    job = best.job
    sought = job.shape.is_box or isinstance(request.start, Estimate)
    sought = sought and request.job.reductions.planar
    if not (sought and best.solution.success):
        return False
    left = variance_left(job.data, job.precision)
    fit = fit_of(best.problem, best.solution, best.window, job.data, left)
    return fit is not None and fit.verdict != "good"


def with_rough_motion(request):
    """Return the request from scratch, less sure of how pushes move the body."""
    log.info("the fit is not good: searching again, pushes less exact")
    start = None if isinstance(request.start, Estimate) else request.start
    job = replace(request.job, process_noise=ROUGH_MOTION)
    return replace(request, start=start, job=job)
