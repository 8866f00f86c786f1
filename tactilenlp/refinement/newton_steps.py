"""Newton steps on what a solve takes as given: tilt of the ground, latency of sensors.

The ground is level or as the scene or an earlier estimate says, contacts and normals
are as late as these say, normals no later than contacts.  Where a Newton step on one of
them, which needs no solve
(information/consider_parameters.py), promises to lower the objective,
the data are turned, or fingers and normals put where they were earlier, and the page is
solved again from the solution, a step at a time.  A tilt must gain as many nats as any
larger model (nested_models.py); a lag more than its Laplace evidence loses, the
logarithm of its prior over its posterior deviation, and the spread of the likelihood.
Normals that are late bias sizes where fingers slide over edges, as on a robot.  A steep
tilt is found as turns of all sensors that are alike (formulations/finger_turn.py), from
starts of the search.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from formulations.finger_turn import NAME as TURN
from formulations.finger_turn import TURN as PRIOR_TURN

from ..data.sensor_noise import AVERAGED, LATENCY
from ..information.consider_parameters import (
    ConsiderParameter,
    ground_tilt,
    late_normals,
    late_touches,
)
from ..information.linearisation import Linearisation
from ..information.mixture import occam_of
from ..local.local_solve import continuation, warm_started
from ..local.margins import BETTER_OPTIMUM, DECISIVE, UNCHANGED
from ..local.solved import Solved, best_first
from .nested_models import misfit_of, needed_gain

log = logging.getLogger("tactilenlp")
MAX_TILTS = 4  # Newton steps on the tilt of the ground
MAX_FAILED = 3  # steps on a lag in a row that gain nothing
LONGEST_LAG = 2 * LATENCY  # [s] a Newton step has no end where curvature is low


def with_ground_tilt(solves) -> list[Solved]:
    """Return solves, best first, on the ground that the touches tell of.

    Solves that are not close to the best are left out where the ground is turned.
    """
    level = best = solves[0]
    if not (ground_may_tilt(level.job) and best.solution.success):
        return solves
    touches = misfit_of(best)
    needed = needed_gain(touches.spread)
    if touches.excess < needed:
        return solves
    best = _tilt_by_steps(best, needed)
    needed = needed if level.job.scene.ground.told is None else UNCHANGED
    if best.cost > level.cost - needed:
        return solves
    ground = best.job.scene.ground
    log.info("the ground leans by %s rad", ground.tilt.round(4))
    others = [_solved_on_ground(ground, s) for s in _close_to_best(solves)]
    return best_first([best, *others])


def with_ground_for_turns(solves) -> list[Solved]:
    """Return solves on a ground that leans, if that explains turned sensors.

    It turns the normals of all fingers alike, by fewer unknowns: it replaces their own
    turns (formulations/finger_turn.py) where its evidence is larger.
    """
    best, job = solves[0], solves[0].job
    if TURN not in best.solution.values or not best.solution.success:
        return solves
    if not ground_may_tilt(job):
        return solves
    ground = job.scene.ground.turned(_common_turn(best), _below_first_touches(best))
    aligned = job.with_reductions(aligned=True)
    leans = continuation(on_ground(aligned, ground), best)
    if leans is None or not leans.solution.success:
        return solves
    leans = replace(leans, declined=best.declined)
    leans = _tilt_by_steps(leans, UNCHANGED)
    occam = occam_of(best.kkt, TURN)
    if leans.cost > best.cost + occam:
        return solves
    log.info("not the sensors are turned, the ground leans by %s rad",
             leans.job.scene.ground.tilt.round(4))  # fmt: skip
    return [leans]


def _common_turn(solved: Solved) -> np.ndarray:
    """Return the rotation (2,) [rad] about x and y that all turns have in common.

    Weighted by what touches tell of each: a finger's turn about the normals that it
    felt is told by its prior alone.
    """
    w = solved.solution.values[TURN].T.ravel()
    information = (
        np.linalg.inv(solved.kkt.marginal(TURN)) - np.eye(len(w)) / PRIOR_TURN**2
    )
    alike = np.tile(np.eye(3)[:, :2], (len(w) // 3, 1))
    weight = alike.T @ (information + information.T) / 2
    return np.linalg.lstsq(weight @ alike, weight @ w)[0]


def _tilt_by_steps(best: Solved, needed) -> Solved:
    """Return a solve on the ground that Newton steps on its tilt lead to.

    needed [nats]: what the first step from the ground that was told must gain.
    """
    for _ in range(MAX_TILTS):
        job, ground = best.job, best.job.scene.ground
        about = _below_first_touches(best)
        tilt = ground_tilt(_linearised(best), about)
        if tilt.gain < (needed if ground.told is None else UNCHANGED):
            break
        if job.deadline.passed("a tilt of the ground"):
            break
        again = _solved_on_ground(ground.turned(tilt.mean, about), best)
        if not again.solution.success or again.cost > best.cost - UNCHANGED:
            break
        best = again
    return best


def ground_may_tilt(job) -> bool:
    """Tell whether the ground may lean, and a page be solved on another one."""
    scene = job.scene
    fixed = scene.ground is None or scene.sigma_tilt == 0
    return not fixed and "level" in job.contract.freed


def _below_first_touches(solved: Solved):
    """Return the point (3,) [m] of the ground below the touches of the first action."""
    touch, action = solved.window.touch, solved.job.data.action
    early = action[touch.sample] == action[touch.sample[0]]
    return touch.p_wf[early, :3].mean(axis=0) * (1, 1, 0)


def _solved_on_ground(ground, solved: Solved) -> Solved:
    """Solve a page again on another ground, from its solution."""
    return warm_started(on_ground(solved.job, ground), solved)


def on_ground(job, ground):
    """Return a job whose data are in the frame of another ground."""
    old = job.scene.ground
    if ground is old:
        return job
    R = ground.rotation @ old.rotation.T
    t = ground.rotation @ old.origin + ground.translation
    scene = replace(job.scene, ground=ground)
    job = job.of_data(lambda data: data.transformed(R, t))
    return replace(job, scene=scene)


class Lag(NamedTuple):
    """How late sensors are: a field of Precision, its prior deviation [s].

    at(linearisation): what a solve tells of it besides.
    """

    field: str
    deviation: float
    at: Callable

    def of(self, solved: Solved) -> float:
        """Return the lag that a solve was made with [s]."""
        return getattr(solved.job.precision, self.field)


LAGS = {  # in the order in which they are estimated
    "sensors": Lag("latency", LATENCY, late_touches),
    "normals": Lag("normal_lag", AVERAGED, late_normals),
}


def with_lags(solves) -> list[Solved]:
    """Return solves, best first, with the lags of sensors that the touches tell of.

    Solves that are not close to the best are left out where they are others.
    """
    for name, lag in LAGS.items():
        if may_be_late(solves[0].job) and solves[0].solution.success:
            solves = _with_lag(name, lag, solves)
    return solves


def _with_lag(name: str, lag: Lag, solves) -> list[Solved]:
    """Return solves with one lag, if the touches tell of it."""
    prompt, known = solves[0], lag.at(_linearised(solves[0]))
    needed = _needed_for_lag(lag, prompt, known)
    if max(misfit_of(prompt).excess, known.gain) < needed:
        return solves
    late, known = _lag_by_steps(lag, prompt, known)
    if late.cost > prompt.cost - _needed_for_lag(lag, prompt, known):
        return solves
    log.info("%s are late by %.1f ms: the objective falls by %.1f nats",
             name, 1e3 * lag.of(late), prompt.cost - late.cost)  # fmt: skip
    precision = late.job.precision
    if lag.field == "latency":
        error = float(np.sqrt(known.squared[0, 0]))
        precision = replace(precision, latency_error=error)
    best = replace(late, job=replace(late.job, precision=precision))
    others = [
        warm_started(s.job.as_late_as(precision), s) for s in _close_to_best(solves)
    ]
    return best_first([best, *others])


def as_found(job, other):
    """Return a job on the ground, and with the latencies, of another one."""
    return on_ground(job, other.scene.ground).as_late_as(other.precision)


def lost_by_latency(job, best: Solved) -> bool:
    """Tell whether a search of the job may have lost the body for want of a latency.

    It was found by the solve, which does not fit well with it either.  A job with a
    hypothesis is not searched.
    """
    new = best.job.precision.latency > job.precision.latency == 0
    fits = best.fit is not None and best.fit.verdict == "good"
    return new and not fits and job.search.hypothesis is None


def may_be_late(job) -> bool:
    """Tell whether the latency is not told, and a page be solved with another one."""
    return job.scene.latency is None and "prompt" in job.contract.freed


def _needed_for_lag(lag: Lag, prompt: Solved, known: ConsiderParameter) -> float:
    """Return by how many nats a lag must lower the objective to be believed.

    known: what is known of it; where an earlier solve found one, a change of it is due.
    """
    if lag.of(prompt) > 0:
        return UNCHANGED
    occam = np.log(lag.deviation * np.sqrt(known.information[0, 0]))
    return needed_gain(misfit_of(prompt).spread, occam)


def _lag_by_steps(
    lag: Lag, best: Solved, known: ConsiderParameter
) -> tuple[Solved, ConsiderParameter]:
    """Return a solve with the lag that Newton steps lead to, and what it tells of it.

    known: at the given solve.  A step that gained more than expected is doubled next,
    one that gained nothing is halved: contacts that begin or end make the curvature too
    large, or too small.
    """
    factor, failed = 1.0, 0
    while failed < MAX_FAILED:
        if factor <= 1 and factor * known.gain < UNCHANGED:
            break
        if best.job.deadline.passed("a latency"):
            break
        mean = np.clip(known.mean[0], -LONGEST_LAG, LONGEST_LAG)
        step = np.clip(factor * mean, -LONGEST_LAG, LONGEST_LAG)
        then = max(0.0, float(lag.of(best) + step))
        precision = replace(best.job.precision, **{lag.field: then})
        late = best.job.as_late_as(precision)
        again = warm_started(late, best)
        gained = best.cost - again.cost
        if not again.solution.success or gained < BETTER_OPTIMUM:
            factor, failed = factor / 2, failed + 1
            continue
        more = gained > known.gain
        best, known, failed = again, lag.at(_linearised(again)), 0
        ahead = 2 * step / known.mean[0] if known.mean[0] else 0.0
        factor = max(1.0, ahead) if more else 1.0
    return best, known


def _linearised(solved: Solved) -> Linearisation:
    """Return a solve to first order."""
    return Linearisation(solved.kkt, solved.job, solved.window)


def _close_to_best(solves) -> list[Solved]:
    """Return the solves that converged close to the first one, the best, without it."""
    limit = solves[0].cost + DECISIVE
    return [s for s in solves[1:] if s.solution.success and s.cost < limit]
