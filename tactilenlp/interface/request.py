"""The request of a caller, read and checked: measurements, shape, page, start."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace

import numpy as np

from ..common.deadline import Deadline
from ..common.validation import check_types
from ..data.contact_segments import consecutive_contacts
from ..data.ground import Ground, frame_of
from ..data.measurements import Measurements
from ..data.mistakes import check_mistakes
from ..data.scene import Scene
from ..data.sensor_noise import (
    Precision,
    precise,
    precision_of,
    smooth_paths,
    with_sensors_earlier,
)
from ..errors import StartError
from ..geometry.transforms import planar_matrix, rotation_of
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..problem.options import Options
from ..problem.pages import name_of, page_of, shape_of
from ..problem.reductions import required_reductions
from ..search.proposals_poses import as_polytope
from ..tracking.process_noise import PROCESS_NOISE_FACTOR
from .checks import check_executor, check_page, check_round_fingertips, check_touched
from .result import Estimate
from .session import Guess, Session

log = logging.getLogger("tactilenlp")
# [s] of the information, and of a long limit: 3 to 9 s with 3000 samples
READOUT_TIME, READOUT_SHARE, MOST_READOUT_TIME = 2.0, 0.15, 10.0

CHECK_FOR_MISTAKES = "check for mistakes"  # purpose of time that a deadline counts


@dataclass(frozen=True, eq=False)
class Request:
    """What a caller asks for, checked.

    data: the measurements as given; job: the same in the ground's frame and smoothed,
    with all that a solve needs; start: an Estimate, a Guess or None; executor: of
    concurrent.futures, or None; axes: see kept_axes, also where the start itself is
    given up; doubtful: whether to search more widely; to_beat: objective [nats] of a
    class that fits well, far above which this one is not refined.
    """

    data: Measurements
    job: Job
    start: Estimate | Guess | None = None
    executor: object = None
    axes: tuple | None = None
    doubtful: bool = False
    to_beat: float = np.inf

    def job_until(self, share: float, strict: bool = True) -> Job:
        """Return the job with an earlier deadline, at which a solve ends.

        share [-]: of the time until the readout, which takes a third at most.
        """
        limit, deadline = self.job.options.time_limit, self.job.deadline
        reserve = max(READOUT_TIME, min(READOUT_SHARE * limit, MOST_READOUT_TIME))
        end = deadline.before_end(limit - share * (limit - min(reserve, limit / 3)))
        return replace(self.job, deadline=deadline.until(end, strict))

    @property
    def widths(self) -> tuple[int, int]:
        """How many hypotheses are kept, and starts solved, after an action."""
        job = self.job
        return job.options.widths(precise(job.data, job.precision), self.doubtful)

    def from_scratch(self) -> Request:
        """Return the request without the estimate that it starts from."""
        start = None if isinstance(self.start, Estimate) else self.start
        return replace(self, start=start)

    def less_sure_of_pushes(self) -> Request:
        """Return a request that trusts predicted pushes less; no body is carried."""
        settings = {"process_noise": PROCESS_NOISE_FACTOR, "may_be_carried": False}
        return replace(self, job=self.job.with_search(**settings))

    def jobs_by_action(self) -> list[Job]:
        """Return jobs of the first actions, from the first touch on, one more each.

        An update of a polytope has the job of all actions alone: the estimate that it
        starts from was found action by action.
        """
        job, data = self.job, self.job.data
        if isinstance(self.start, Estimate) and job.shape.of_vertices:
            return [job]
        actions = np.unique(data.action)
        touched = data.action[1:][consecutive_contacts(data).any(axis=1)][0]
        chosen = [actions[actions <= a] for a in actions[actions >= touched]]
        return [job.of_data(lambda data, of=of: data.select(of)) for of in chosen]


def read_request(
    data, scene, shape, formulation="violation_implicit", options=None, start=None,
    executor=None, session: Session | None = None,
) -> tuple[Request, list[Hypothesis]]:  # fmt: skip
    """Return the request, and the hypotheses of the first actions that it starts from.

    session: by default a new one.  Raises NoContactError, MistakeError,
    MeasurementError, OptionError, SceneError or StartError for what cannot be solved.
    """
    began, checking = time.monotonic(), Deadline()
    session = Session() if session is None else session
    check_types(data=(data, Measurements), session=(session, Session))
    scene, shape, options, page = checked_request(
        scene, shape, formulation, options, executor
    )
    keeps_latency = scene.latency is None and isinstance(start, Estimate)
    if options.check_mistakes:
        told = Precision(0.0, 0.0, latency=scene.latency or 0.0)
        late = start.sensors if keeps_latency else told
        with checking.spending(CHECK_FOR_MISTAKES):
            check_mistakes(with_sensors_earlier(data, late), scene)
    scene.check(data)
    check_touched(data)
    functions = session.functions_for(start, scene, shape, page)
    scene = scene.on_ground_of(getattr(start, "scene", scene))
    job = make_job(data, scene, shape, options, began, page, functions)
    job.deadline.spent.update(checking.spent)
    job = job.as_late_as(start.sensors) if keeps_latency else job
    known = [] if start is None else hypotheses_to_continue(start, shape, scene, data)
    if not shape.of_vertices and isinstance(start, Estimate):
        # What another page found is no posterior of this one.
        known = known if start.formulation == name_of(page) else []
    return Request(data, job, start, executor, kept_axes(start, job)), known


def checked_request(scene, shape, formulation, options, executor) -> tuple:
    """Return scene, shape, options and page, or raise what is wrong with them."""
    scene = Scene() if scene is None else scene
    options = Options() if options is None else options
    check_types(scene=(scene, Scene), options=(options, Options))
    shape = shape_of(shape)
    if scene.ground is None:  # its motion is not known well enough to compare counts
        shape = replace(shape, counts=())
    page = page_of(formulation, shape)
    check_page(page, shape, scene)
    made = required_reductions(page, options.reductions)
    stated = [name for name in options.without if getattr(made, name)]
    if stated:
        log.warning("the page %s states %s: Options(without=...) does not change that",
                    name_of(page), ", ".join(stated))  # fmt: skip
    check_executor(executor, shape)
    if shape.of_vertices:
        check_round_fingertips(scene)
    return scene, shape, options, page


def make_job(data, scene, shape, options, began, page, functions=None) -> Job:
    """Return what a solve needs: data in the ground's frame, noisy paths smoothed.

    That frame is the world w of pages, search and information.  Poses, impulses and
    finger offsets are turned back in interface/readout.py, covariances by R_wg in
    information (tangent_space.py, trajectory.py).

    began [s] of time.monotonic(); functions: those of a Job to share, by default new.
    """
    frame = frame_of(scene.ground)
    data = data.transformed(frame.rotation, frame.translation)
    precision = precision_of(data, scene)
    made = options.reductions
    if scene.ground is None or shape.rolls:  # nothing keeps the object flat
        made = replace(made, planar=False)
    job = Job(
        data=smooth_paths(data, precision), scene=scene, shape=shape,
        precision=precision, reductions=required_reductions(page, made), page=page,
        options=options, deadline=Deadline.within(options.time_limit, began),
        functions={} if functions is None else functions,
    )  # fmt: skip
    return job.as_late_as(precision)


def check_start(start, shape, scene) -> None:
    """Raise for an Estimate or a Guess from which this shape cannot start."""
    if start is not None:
        data = getattr(start, "measurements", None)
        hypotheses_to_continue(start, shape, scene, data)
        first_guess(start, shape, frame_of(scene.ground))


def first_guess(start, shape, ground: Ground) -> Hypothesis | None:
    """Return a user's guess in the frame of the ground, one planar pose; or None."""
    if not isinstance(start, Guess):
        return None
    theta = start.side_lengths
    if theta.shape != (shape.theta,):
        raise StartError(
            "sizes do not fit the shape", where="start.side_lengths",
            got=theta.tolist(), expected=f"{shape.theta} positive lengths [m]",
        )  # fmt: skip
    if (theta > np.asarray(shape.bounds[1])).any():
        raise StartError(
            "too large", where="start.side_lengths", got=theta.tolist(),
            expected=f"lengths of at most {shape.bounds[1]} m",
            next="divide by 1000 if these are millimetres",
        )  # fmt: skip
    place = ground.to_ground(ground.point(start.position))
    x = np.r_[place[:2], start.yaw][:, None]
    return Hypothesis(theta, x, np.inf, ("guess",))


def kept_axes(start, job) -> tuple | None:
    """Return side lengths (3,) and first rotation (3, 3) whose axes keep names.

    Those of a guess, or of an estimate that was solved.
    """
    if isinstance(start, Guess):
        guess = first_guess(start, job.shape, frame_of(job.scene.ground))
        return guess.theta, planar_matrix(guess.x[2, 0])
    if start is None or not start.success or start.shape != job.shape.name:
        return None
    R = rotation_of(start.quaternion[0]).as_matrix()
    return start.theta, frame_of(job.scene.ground).rotation @ R


def hypotheses_to_continue(start, shape, scene, data) -> list[Hypothesis]:
    """Return the hypotheses of an earlier estimate, to continue from.

    Where that ends within an action which goes on, this action is fitted again. A
    polytope may start from an estimate of any shape, with its vertices and poses (where
    classes are compared, from one of a polytope alone: refinement/model_selection.py).
    """
    if isinstance(start, Guess):
        if shape.of_vertices:
            raise StartError(
                "a polytope starts without a guess", where="start", got="a Guess",
                expected="an Estimate, or None",
            )  # fmt: skip
        return []
    check_types(start=(start, Estimate))
    if not start.measurements.is_prefix_of(data):
        raise StartError(
            "the start is no estimate of the first actions of these data",
            where="start", got=f"{start.measurements.samples} samples that differ",
            expected="an estimate whose measurements are a prefix of data",
            next="start from scratch, or append to the same measurements",
        )  # fmt: skip
    if not start.hypotheses:  # the time limit ended its search
        return []
    done = start.measurements.samples
    last = np.flatnonzero(data.action == data.action[done - 1])
    if last[-1] >= done:  # it ends within this action
        done = int(last[0])
    if shape.of_vertices:
        return [as_polytope(start, scene, done)] if done else []
    if start.shape != shape.name:
        raise StartError(
            "the start is of another shape", where="start", got=start.shape,
            expected=shape.name, next="pass its shape=; a polytope starts from all",
        )  # fmt: skip
    return [h.at(done) for h in start.hypotheses] if done else []
