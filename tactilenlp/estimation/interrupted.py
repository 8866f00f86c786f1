"""How a solve ends badly: by Ctrl-C, the time limit, or an estimate not to be used."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

from ..certificates.outliers import check_explained
from ..common.deadline import NEVER, Deadline
from ..data.contact_segments import samples_until
from ..errors import Interrupted, MotionError
from ..interface.readout import read_off
from ..interface.request import Request
from ..interface.result import Estimate
from ..local.local_solve import evaluated_at, in_motion_of, solved_from
from ..local.solved import Solved, Solves
from ..problem.pages import name_of, page_of
from ..problem.reductions import states_planar_motion
from ..refinement.axis_names import solve_in_canonical_axes
from ..solvers.solution import not_converged

SHUTDOWN_TIME = 2.0  # [s] that a solve after Ctrl-C may take


@dataclass
class Incumbents:
    """What a solve has found by now: hypotheses of the first actions, solved pages.

    began, searched: CPU time [s] at the beginning, and of the search.
    """

    kept: list
    solves: Solves = field(default_factory=Solves)
    began: float = field(default_factory=time.process_time)
    searched: float = 0.0

    def keep(self, hypotheses) -> None:
        """Replace the hypotheses of the first actions."""
        self.kept = [*hypotheses]

    @property
    def spent(self) -> float:
        """CPU time [s] since the beginning."""
        return time.process_time() - self.began


def not_solved(request: Request, starts, spent: float) -> tuple[Estimate, Solved]:
    """Return the estimate where the time limit came before the page was solved.

    The best of the starts that the search found, at the cost of least motion; nothing
    is solved, and sigma is that of the prior.  It has no hypotheses, so that a solve
    that starts from it searches all actions again.  spent [s] of CPU time.
    """
    now = request.job.deadline.until(0.0)
    job = replace(request.job, deadline=now)
    job.deadline.omit(f"a solve of {name_of(job.page)}")
    if job.scene.ground is not None:
        job = replace(job, page=page_of("quasi_static", job.shape))
    best = in_motion_of(job, min(starts, key=lambda h: h.rank))
    solved = evaluated_at(job, best)
    seconds = solved.solution.seconds | {"search": spent, "total": spent}
    request, over = replace(request, job=job), replace(now, strict=True)
    return read_off(request, solved, (), seconds, over), solved


def interrupted(request: Request, incumbents: Incumbents) -> Interrupted:
    """Return the error for Ctrl-C, with the best estimate of what was found by now.

    Of solved pages the best, or a provisional one where there is no other; before
    these, least motion of the actions that the search has finished; before the first of
    them, and for a floating object, whose hypotheses lie in a plane of their own, no
    estimate.
    """
    data, job = request.data, request.job
    whole, solved = data.actions, next(iter(incumbents.solves.best_first()), None)
    if solved is None and incumbents.kept and job.scene.ground is not None:
        best = min(incumbents.kept, key=lambda h: h.rank)
        done, deadline = best.x.shape[1], Deadline.within(SHUTDOWN_TIME)
        data = samples_until(data, done)
        job = replace(
            job, data=samples_until(job.data, done), deadline=deadline,
            page=page_of("quasi_static", job.shape),
        )  # fmt: skip
        solved = solved_from(job, best, levels=job.page.LEVELS[-1:])
        request = replace(request, data=data, job=job)
    if solved is None:
        return Interrupted("stopped by Ctrl-C before anything was found")
    in_time = replace(solved.job, deadline=Deadline.within(SHUTDOWN_TIME))
    solved = solve_in_canonical_axes(replace(solved, job=in_time), request.axes)
    kept = [solved.at] if job.shape.of_vertices else incumbents.kept
    seconds = {**solved.solution.seconds, "total": incumbents.spent}
    estimate = read_off(request, solved, kept, seconds, NEVER)
    words = f"interrupted, {data.actions} of {whole} actions"
    estimate = replace(estimate, success=False, status=f"{words}, {estimate.status}")
    return Interrupted(
        f"stopped by Ctrl-C: {words}; the estimate so far is in `.estimate`, and "
        "start=... continues from it",
        estimate,
    )


def raise_unless_good(estimate, solved) -> None:
    """Raise NotConverged or MotionError for an estimate that is not to be used."""
    if not estimate.success:
        raise not_converged(solved.problem, solved.solution, estimate)
    if estimate.scene.ground is None:
        check_explained(solved, estimate)
    tilted = [s for s in estimate.skipped if s.name == "planar" and not s.holds]
    if tilted:
        free = "let it tilt by Options(without='planar')"
        if states_planar_motion(solved.job.page):
            free = "let it tilt by formulation='violation_implicit'"
        raise MotionError(
            "the object did not only slide",
            where="touch",
            got=f"{min(tilted[0].value, 1.0):.0%} of an action's touches not explained",
            expected=f"at most {tilted[0].limit:.0%} by an object that lies flat",
            next="the object may have tilted or tumbled: select the actions before it "
            f"did, {free}, or pass throw=False",
            problem=solved.problem.describe(),
            solution=solved.solution,
            estimate=estimate,
        )
