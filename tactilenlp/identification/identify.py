"""identify_body: from recorded motion to shape, friction and ground."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from formulations import known_trajectory as page
from formulations.known_trajectory_terms import uniform_cuboid
from formulations.names import WORLD_IMPULSE

from ..common.deadline import Deadline
from ..common.threads import on_one_thread
from ..common.validation import check_numbers, check_one_of, check_types
from ..data.scene import Scene
from ..data.trajectories import Trajectories
from ..errors import SceneError, typed_call
from ..nlp.kkt import kkt_system_of
from ..nlp.problem import Problem
from ..nlp.term_functions import TermFunctionCache
from ..solvers.options import SolverOptions
from ..solvers.solution import Solution, evaluated, not_converged, unfinished
from ..solvers.solve import solve_levels
from .body import UNOBSERVED_VERTEX, Body, BodyFit, body_fit_of, corner_shift
from .impacts import Impacts, impacts, may_touch, with_soft_ground
from .starts import Starts, nothing_lands, starts_of

log = logging.getLogger("tactilenlp")
DEFAULT_SOLVER = SolverOptions(tolerance=1e-5, time_limit=600.0)
BODY_SHAPES = ("cuboid", "corners")
SUNK_DEPTH = 3.0  # [SURFACE] below the ground: a vertex left out must come back
MAX_SOLVES = 3  # with vertices that were wrongly left out restored
SIGMA_SHARE = 0.1  # [-] of the time limit, kept for standard deviations
STARTS, ASSEMBLY_TIME = "starts", 4.0  # [time of the starts] of derivatives; 3 measured
COVARIANCE_TIME = 6.0  # [iterations of the solve] that these take; four were measured
WITH_SIGMA = ("theta", "radius", "friction", "inertia", "plane")


@typed_call()
@on_one_thread
def identify_body(
    trajectories: Trajectories,
    scene: Scene | None = None,
    *,
    shape: str = "cuboid",
    guess: np.ndarray | None = None,
    gauge: float | None = None,
    options: SolverOptions | None = None,
    time_limit: float = 600.0,
    throw: bool = True,
) -> Body:
    """Find shape, friction, inertia and ground from recorded poses (known_trajectory).

    scene: mass, gravity and ground are read (default Scene()).  shape: "cuboid" (three
    half widths) or "corners" (every vertex on its own).  guess: half widths (3,) or
    vertices (V, 3) [m]; by default the boxes that explain the heights of the origin are
    tried (starts.py), and the most likely result is returned.  gauge: metres per metre
    of the tracker; None: such that free falls show scene.gravity, within LARGEST_GAUGE.
    time_limit [s]: of all, compilation included, kept within 10 % or 1 s; the status
    says what was left out, and sigma is infinite where there was no time for it.

    Raises MeasurementError (also for a wrong dt or unit, and quaternions that look like
    xyzw), OptionError, SceneError before the solve, MotionError where nothing touches
    the ground, NotConverged (unless `throw` is False) after it.
    """
    scene = Scene() if scene is None else scene
    options = DEFAULT_SOLVER if options is None else options
    _check(trajectories, scene, shape, gauge, options, time_limit)
    began, deadline = time.process_time(), Deadline.within(time_limit)
    solves = deadline.until(deadline.before_end(SIGMA_SHARE * time_limit))
    with deadline.spending(STARTS):
        starts = starts_of(trajectories, scene, shape, guess, gauge)
    options = replace(options, deadline=solves.until(options.deadline.at))
    best = _best(starts, trajectories.dt, scene, options)
    if throw and not best.solution.success:
        raise not_converged(best.problem, best.solution)
    body = _read_off(trajectories, scene, shape, starts, best, deadline)
    seconds = body.seconds | {"total": time.process_time() - began}
    return replace(body, seconds=seconds, status=deadline.marked(body.status))


class Fitted(NamedTuple):
    """A body fitted to its motion: problem, window, solution.

    chosen (n, V): the vertices that may touch, in every step.
    """

    problem: Problem
    window: Impacts
    solution: Solution
    chosen: np.ndarray

    @property
    def fit(self) -> BodyFit:
        """How well the solution explains the motion."""
        return body_fit_of(self.solution.costs, len(self.window.step))

    @property
    def rank(self) -> tuple[bool, float]:
        """The key to sort by.

        The objective [nats] with the normalisation of depth, a corner a step.
        """
        normalised = np.log(self.window.step.depth / page.SURFACE).sum()
        objective = self.solution.objective + float(normalised)
        return not self.solution.success, objective


def _best(starts: Starts, dt, scene, options) -> Fitted:
    """Return the most likely of several fits.

    A hard ground and the first start come first, then a ground that yields in impacts,
    then all other starts on both: each only where no fit before it is good.
    """
    steps, thetas, signs, _ = starts
    soft = with_soft_ground(steps, thetas[-1] * signs, scene.gravity, dt)
    tried = []
    for theta, ground in product(thetas, (steps, soft)):
        if tried and options.deadline.passed("other starts", _assembly_time(options)):
            break
        tried.append(_solve(ground, theta, signs, dt, scene, options))
        if tried[-1].solution.success and tried[-1].fit.verdict == "good":
            break
    return min(tried, key=lambda fitted: fitted.rank)


def _assembly_time(options) -> float:
    """Return about how long [s] the derivatives of a problem take before its solve."""
    return ASSEMBLY_TIME * options.deadline.spent[STARTS]


def _solve(steps, theta, signs, dt, scene, options) -> Fitted:
    """Return the body as it is fitted from a start.

    theta (3, columns) [m]: the start.  Raises MotionError where nothing touches.

    What was left out and lies below the ground in the solution is added, and the
    problem solved again, MAX_SOLVES times at most.
    """
    chosen = may_touch(steps, (theta * signs).T)
    if not chosen.any():
        raise nothing_lands(steps)
    done = None
    for _ in range(MAX_SOLVES):
        window = impacts(steps, chosen, theta, signs, dt)
        problem, solution = _solve_in_time(window, scene, options)
        if done is not None and solution.iterations == 0:  # no time: the one before
            return done
        back = _too_deep(steps, solution.values, signs) & ~chosen
        if not back.any():
            break
        done = Fitted(problem, window, unfinished(solution), chosen)
        restored = "a solve with all vertices that touch"
        if options.deadline.passed(restored, _assembly_time(options)):
            return done
        log.info("solving again: %d vertices that were left out touch", back.sum())
        chosen = chosen | back
    return Fitted(problem, window, solution, chosen)


def _solve_in_time(window, scene, options):
    """Return problem and solution: its start where there is no time for a solve."""
    strict = options.deadline.until(options.deadline.at, strict=True)
    if not strict.passed("a solve", _assembly_time(options)):
        with strict.ending("a solve"):
            problem = Problem(deadline=strict)
            page.build(problem, window, scene)
            options = replace(options, deadline=strict)
            return problem, solve_levels(problem, page.LEVELS, {}, options)
    problem = Problem(cache=TermFunctionCache(derive=False))
    page.build(problem, window, scene)
    return problem, evaluated(problem, {})


def _check(trajectories, scene, shape, gauge, options, time_limit) -> None:
    check_numbers("a time [s] above 0", time_limit=(time_limit, 0.0, np.inf))
    check_types(
        trajectories=(trajectories, Trajectories),
        scene=(scene, Scene),
        options=(options, SolverOptions),
    )
    check_one_of("shape", shape, BODY_SHAPES, "unknown shape")
    if gauge is not None:
        check_numbers("None, or a number near 1", gauge=(gauge, 0.5, 2))
    if scene.ground is None:
        raise SceneError(
            "nothing to fall on", where="scene.ground", got="None",
            expected="Ground(height=..., normal=...)",
        )  # fmt: skip
    if scene.gravity == 0:
        raise SceneError(
            "a body that falls is identified by its weight", where="scene.gravity",
            got="0", expected="above 0 m/s^2",
        )  # fmt: skip


def _too_deep(steps, values, signs) -> np.ndarray:
    """Return which vertices lie below the ground in which step, (n, V)."""
    level = (values["plane"] + values["offset"]).T[steps.toss]
    p = steps.corners((values["theta"] * signs).T)[:, :, 0]
    ground = level[:, :1] + p[..., 0] * level[:, 1:2] + p[..., 1] * level[:, 2:]
    low = p[..., 2] - ground < values["radius"] - SUNK_DEPTH * page.SURFACE
    return low & ~steps.resting[:, None]


def _covariance(problem, solution, deadline) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance (k, k) of the parameters and the name of each (k,).

    Its diagonal is infinite where the deadline leaves no time for it.
    """
    spans = {name: problem.variables[name].span for name in WITH_SIGMA}
    chosen = np.concatenate([np.arange(s.start, s.stop) for s in spans.values()])
    names = np.repeat([*spans], [s.stop - s.start for s in spans.values()])
    solved = solution.iterations > 0
    iteration = solution.seconds["solve"] / solution.iterations if solved else np.inf
    if deadline.passed("standard deviations", COVARIANCE_TIME * iteration):
        return np.diag(np.full(len(chosen), np.inf)), names
    C = kkt_system_of(problem, solution).marginal(chosen)
    return (C + C.T) / 2, names


def _read_off(
    trajectories, scene, shape, starts: Starts, fitted: Fitted, deadline
) -> Body:
    """Return the body that was fitted, with the deviations of its numbers.

    deadline: of the covariance.
    """
    steps, _, signs, ruler = starts
    problem, window, solution, chosen = fitted
    left = len(chosen) - len(window.step), int(steps.resting.sum())
    words = f"{left[0]} of {len(chosen)} steps: in free flight, or at rest ({left[1]})"
    values = {k: v.squeeze() for k, v in solution.values.items()}
    C, names = _covariance(problem, solution, deadline)
    deviation = np.sqrt(np.where(np.diag(C) < 0, np.inf, np.diag(C)))
    sigma = {name: deviation[names == name].squeeze() for name in WITH_SIGMA}
    corners = (solution.values["theta"] * signs).T
    push = corner_shift(corners)
    vertices = corners + push * values["radius"]
    with_radius = _sharp_sigma(C, names, signs, push)
    spread = np.hypot(with_radius, vertices * ruler[1] / ruler[0])
    uniform = scene.mass * window.uniform
    if window.columns == 1:  # of the half widths that were found
        uniform = scene.mass * np.array(uniform_cuboid(values["theta"])).ravel()
    sigma |= {
        "vertices": spread, "half_widths": spread.reshape(-1, 3).max(axis=0),
        "gauge": ruler[1], "ground": sigma.pop("plane"),
        "inertia": sigma["inertia"] * uniform,
    }  # fmt: skip
    del sigma["theta"]
    fit = fitted.fit
    sigma = {name: fit.widening * value for name, value in sigma.items()}
    lost = np.flatnonzero((with_radius > UNOBSERVED_VERTEX * page.SIZE).any(axis=1))
    return Body(
        shape=shape, mass=scene.mass, vertices=vertices, radius=float(values["radius"]),
        friction=float(values["friction"]), inertia=values["inertia"] * uniform,
        ground=values["plane"], gauge=ruler[0], sigma=sigma,
        impulses=_impulses(trajectories, scene, problem, window, solution),
        costs=solution.costs, violations=solution.violations,
        objective=solution.objective, unobserved=tuple(lost.tolist()), skipped=(words,),
        fit=fit, tosses=window.tosses, success=solution.success, status=solution.status,
        iterations=solution.iterations, seconds=solution.seconds,
    )  # fmt: skip


def _sharp_sigma(C, names, signs, push) -> np.ndarray:
    """Return deviations (V, 3) [m] of the sharp vertices, from theta and the radius."""
    theta = np.flatnonzero(names == "theta").reshape(-1, 3)
    (radius,) = np.flatnonzero(names == "radius")
    out = np.zeros(push.shape)
    if not np.isfinite(C).all():
        return out + np.inf
    for v in range(len(push)):
        J = np.zeros((3, len(C)))
        J[:, theta[v if len(theta) > 1 else 0]] = np.diag(signs[:, v])
        J[:, radius] = push[v]
        out[v] = np.sqrt(np.maximum(np.diag(J @ C @ J.T), 0))
    return out


def _impulses(trajectories, scene, problem, window, solution) -> np.ndarray:
    """Return the impulses (T, V, 3) [N s] of the ground on every vertex."""
    x, data = solution.at(problem)
    impulses = problem.value(WORLD_IMPULSE, x, data) @ scene.ground.rotation
    out = np.zeros((len(trajectories.toss), window.vertices, 3))
    out[window.step.sample[window.touch.step], window.touch.vertex] = impulses
    return out
