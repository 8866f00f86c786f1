"""The tilt of the ground, by Newton steps where touches cost more than expected.

The ground is taken as given, or as an earlier estimate had found it.  Where a Newton
step on its tilt (information/sensitivity.py) promises as many nats as any larger
model must gain (nested_models.py), the ground is turned and the page solved
again from the solution, a step at a time.  A steep tilt is found as turns of all
sensors that are alike (formulations/finger_turn.py), from starts of the search.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from formulations.finger_turn import NAME as TURN
from formulations.finger_turn import TURN as PRIOR_TURN

from ..information.mixture import occam_of
from ..information.sensitivity import ground_tilt
from ..nlp.kkt import kkt_system_of
from ..search.local_solve import (
    Solved,
    best_first,
    continued,
    warm_started,
)
from ..search.margins import DECISIVE, UNCHANGED
from .nested_models import misfit_of, needed_gain

log = logging.getLogger("tactilenlp")
MAX_TILTS = 4  # Newton steps on the tilt of the ground


def with_ground_tilt(job, solved) -> tuple:
    """Return job and solves, best first, on the ground that the touches tell of.

    Solves that are not close to the best are left out where the ground is turned.
    """
    level = best = solved[0]
    if not (ground_may_tilt(job) and best.solution.success):
        return job, solved
    touches = misfit_of(job, best)
    needed = needed_gain(touches.spread)
    if touches.excess < needed:
        return job, solved
    best = _turned_by_steps(best, needed)
    needed = needed if job.scene.ground.told is None else UNCHANGED
    if best.cost > level.cost - needed:
        return job, solved
    ground = best.job.scene.ground
    log.info("the ground leans by %s rad", ground.tilt.round(4))
    close = level.solution.objective + DECISIVE
    others = [
        _on_ground(ground, s) for s in solved[1:]
        if s.solution.success and s.solution.objective < close
    ]  # fmt: skip
    return best.job, best_first([best, *others])


def with_ground_for_turns(job, solved) -> tuple:
    """Return job and solves on a ground that leans, if that explains turned sensors.

    It turns the normals of all fingers alike, by fewer unknowns: it replaces their own
    turns (formulations/finger_turn.py) where its evidence is larger.
    """
    best = solved[0]
    turned = TURN in best.solution.values and best.solution.success
    if not (turned and ground_may_tilt(job)):
        return job, solved
    ground = job.scene.ground.turned(_common_turn(best), _first_touched(best))
    aligned = job.with_reductions(aligned=True)
    leans = continued(on_ground(aligned, ground), best)
    if leans is None or not leans.solution.success:
        return job, solved
    leans = replace(leans, declined=best.declined)
    leans = _turned_by_steps(leans, UNCHANGED)
    occam = occam_of(best.problem, best.solution, TURN)
    if leans.cost > best.cost + occam:
        return job, solved
    log.info("not the sensors are turned, the ground leans by %s rad",
             leans.job.scene.ground.tilt.round(4))  # fmt: skip
    return leans.job, [leans]


def _common_turn(solved: Solved) -> np.ndarray:
    """Return the rotation (2,) [rad] about x and y that all turns have in common.

    Weighted by what touches tell of each: a finger's turn about the normals that it
    felt is told by its prior alone.
    """
    problem, solution = solved.problem, solved.solution
    w = solution.values[TURN].T.ravel()
    rows = np.arange(problem.size)[problem.variables[TURN].span]
    covariance = kkt_system_of(problem, solution).sensitivity(rows)[0][rows]
    information = np.linalg.inv(covariance) - np.eye(len(w)) / PRIOR_TURN**2
    alike = np.tile(np.eye(3)[:, :2], (len(w) // 3, 1))
    weight = alike.T @ (information + information.T) / 2
    return np.linalg.lstsq(weight @ alike, weight @ w)[0]


def _turned_by_steps(best: Solved, needed) -> Solved:
    """Return a solve on the ground that Newton steps on its tilt lead to.

    needed [nats]: what the first step from the ground that was told must gain.
    """
    for _ in range(MAX_TILTS):
        tilt, ground = _tilt_at(best), best.job.scene.ground
        if tilt.gain < (needed if ground.told is None else UNCHANGED):
            break
        if best.job.deadline.passed("a tilt of the ground"):
            break
        turned = ground.turned(tilt.mean, tilt.about)
        again = _on_ground(turned, best)
        if not again.solution.success or again.cost > best.cost - UNCHANGED:
            break
        best = again
    return best


def ground_may_tilt(job) -> bool:
    """Tell whether the ground may lean, and a page be solved on another one."""
    scene = job.scene
    known = scene.ground is None or scene.sigma_tilt == 0
    return not known and "level" in job.contract.freed


def _tilt_at(solved: Solved):
    """Return the GroundTilt at a solve, about where the body was touched first."""
    job, kkt = solved.job, kkt_system_of(solved.problem, solved.solution)
    given = solved.window, job.data, job.scene, _first_touched(solved)
    return ground_tilt(kkt, job.build, *given)


def _first_touched(solved: Solved):
    """Return the point (3,) [m] of the ground below the touches of the first action."""
    touch, action = solved.window.touch, solved.job.data.action
    early = action[touch.sample] == action[touch.sample[0]]
    return touch.p_wf[early, :3].mean(axis=0) * (1, 1, 0)


def _on_ground(ground, solved: Solved) -> Solved:
    """Solve a page again on another ground, from its solution."""
    again = warm_started(on_ground(solved.job, ground), solved)
    return replace(again, declined=solved.declined)


def on_ground(job, ground):
    """Return a job whose data are in the frame of another ground."""
    known = job.scene.ground
    if ground is known:
        return job
    R = ground.rotation @ known.rotation.T
    t = ground.rotation @ known.origin + ground.translation
    scene = replace(job.scene, ground=ground)
    job = job.of_data(lambda data: data.transformed(R, t))
    return replace(job, scene=scene)
