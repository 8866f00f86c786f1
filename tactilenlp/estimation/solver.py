"""solve_estimate: from measurements to shape, poses and impulses.

The steps, in this order: request, search, refinement, certificates, readout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from formulations.shape import Shape

from ..common.interrupt import interruptible
from ..common.threads import on_one_thread
from ..common.validation import check_types
from ..data.scene import Scene
from ..errors import typed_call
from ..interface.readout import read_off
from ..interface.request import Request, read_request
from ..interface.result import Estimate
from ..interface.session import PROCESS, Guess, Session
from ..local.solved import Solved
from ..problem.hypothesis import UNSEARCHED
from ..problem.options import Options
from ..refinement.incremental_polytope import update_by_one_action
from ..refinement.model_selection import classes_of, likeliest_class
from ..search.proposals_poses import body_on_poses
from .coarse_to_fine import coarse_rows, optima_of_dense
from .interrupted import Incumbents, interrupted, not_solved, raise_unless_good
from .optima import CERTIFICATES_END, optima_of


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

    data: Measurements, in whose frame the estimate is.  scene: what is known; Scene()
    has mass and frictions of the recorded scenes, on level ground: give your own.
    shape: "cuboid", "polytope" (4 to 20 vertices, by evidence), polytope(30), a Shape,
    or a list of them, or "auto": the class of the largest evidence is returned, the
    odds of all in estimate.classes.  formulation: "quasi_static", "violation_implicit",
    "multiple_shooting", "shooting", "complementarity", "paper" or a page (module with
    `build`, `LEVELS`).  start: an earlier Estimate of the first actions (for a
    polytope: of any shape), even of a part of an action that still runs, or a Guess.
    executor: of concurrent.futures, of processes.  session: keeps term functions for
    solves that start from this estimate; by default one for the process.

    Read estimate.summary(), .fit and .remarks before a size: one that no touch
    determines has a wide sigma.  The first call compiles, for up to half a minute.
    Raises NoContactError, MistakeError, MeasurementError, SceneError, OptionError or
    StartError before any solve, and NotConverged or MotionError after it unless `throw`
    is False; their `estimate` is what throw=False returns, also where the time limit
    ended the solve.  Ctrl-C raises Interrupted, whose `estimate` can be a start.
    """
    session = PROCESS if session is None else session
    solver = ClassSolver(data, scene, formulation, executor, session, throw)
    if classes := classes_of(shape):
        check_types(options=(options, (Options, type(None))))
        return likeliest_class(classes, solver, start, options or Options())
    return solver.of_class(shape, options, start)


@dataclass(frozen=True, eq=False)
class ClassSolver:
    """Estimates of one class of shapes; arguments as of solve_estimate."""

    data: object
    scene: Scene | None
    formulation: object
    executor: object
    session: Session
    throw: bool

    def of_class(self, shape, options, start, to_beat=np.inf) -> Estimate:
        """Return the estimate of a class by its own search; to_beat: see Request."""
        request, known = self._request_of(self.scene, shape, options, start)
        return self._of_request(replace(request, to_beat=to_beat), known)

    def from_poses(self, shape, options, poses, most) -> Estimate | None:
        """Return the estimate of a class from the poses of another's, not by a search.

        poses: an Estimate, whose ground and latency are taken as well; a polytope
        starts from it.  None if they leave touches that cost more than `most` [nats].
        """
        scene = (self.scene or Scene()).on_ground_of(poses.scene)
        if shape.of_vertices:
            return self._of_request(*self._request_of(scene, shape, options, poses))
        request, hypotheses = self._request_of(scene, shape, options, None)
        job = request.job.as_late_as(poses.sensors)
        hypothesis = body_on_poses(job, poses)
        if hypothesis is None or hypothesis.objective > most:
            return None
        request = replace(request, job=job.with_search(hypothesis=hypothesis))
        return self._of_request(request, hypotheses)

    def _request_of(self, scene, shape, options, start) -> tuple[Request, list]:
        return read_request(
            self.data, scene, shape, self.formulation, options, start,
            executor=self.executor, session=self.session,
        )  # fmt: skip

    def _of_request(self, request: Request, hypotheses) -> Estimate:
        """Return the estimate of a request; Ctrl-C raises Interrupted with one."""
        incumbents = Incumbents(hypotheses)
        try:
            with interruptible():
                estimate, best = _estimated(request, incumbents)
        except KeyboardInterrupt as stop:
            raise interrupted(request, incumbents) from stop
        self.session.keep(estimate, request.job)
        if self.throw:
            raise_unless_good(estimate, best)
        return estimate


def _estimated(request: Request, incumbents: Incumbents) -> tuple[Estimate, Solved]:
    """Return the estimate of a request, and the solved page that it was read from."""
    job, update, accepted = request.job_until(CERTIFICATES_END), None, False
    with job.deadline.ending("an incremental update"):
        update, accepted = update_by_one_action(job, request.start)
    if accepted:
        incumbents.kept = [update.at]
        return _read_estimate(request, update, incumbents, [update]), update
    rows = coarse_rows(request)
    if rows is None:
        optima = optima_of(request, incumbents, update)
    else:
        optima = optima_of_dense(request, rows, incumbents)
    if optima.best is None:
        return not_solved(request, optima.starts, incumbents.spent)
    incumbents.kept = optima.for_next_action(request.widths[0])
    if any(what.startswith(UNSEARCHED) for what in job.deadline.omitted):
        incumbents.kept = []  # a solve that starts from it searches all actions
    return _read_estimate(request, optima.best, incumbents, optima.modes), optima.best


def _read_estimate(request, best, incumbents, modes) -> Estimate:
    """Return the estimate read from the best page."""
    deadline, kept = request.job.deadline, incumbents.kept
    seconds = best.solution.seconds | {
        "search": incumbents.searched, "total": incumbents.spent,
        "compile": deadline.spent.get("compile", 0.0),
    }  # fmt: skip
    strict = deadline.until(deadline.at, strict=True)
    return read_off(request, best, kept, seconds, strict, modes)
