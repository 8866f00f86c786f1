"""Estimate the tilt of the ground by Newton steps from level ground.

A solve takes the ground as level, or as the scene or an earlier estimate says.  Where a
Newton step on its tilt, which needs no solve (information/consider_parameters.py),
promises to lower the objective, the data are rotated and the page is solved again from
the solution, a step at a time.  A tilt must gain as many nats as any larger model
(nested_models.py).  A steep one is found as turns of all sensors that are alike
(formulations/finger_turn.py), from starts of the search.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from formulations.finger_turn import TURN_SIGMA
from formulations.names import FINGER_TURN

from ..geometry.transforms import is_planar, matrices, rotvecs, rotvecs_back
from ..information.linearisation import ground_tilt
from ..information.mixture import occam_of
from ..local.local_solve import solve_by_continuation, warm_started
from ..local.margins import UNCHANGED
from ..local.solved import Solved, best_first, close_to_best
from .nested_models import misfit_of, needed_gain

log = logging.getLogger("tactilenlp")
MAX_TILTS = 4  # Newton steps on the tilt of the ground


def estimate_ground_tilt(solves) -> list[Solved]:
    """Return solves, best first, on a tilted ground where evidence favours it.

    If the ground is turned, solves far from the best are dropped.
    """
    level = best = solves[0]
    if not (level.job.fixes("level") and best.solution.success):
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
    others = [_solved_on_ground(ground, s) for s in close_to_best(solves)]
    return best_first([best, *others])


def tilt_ground_for_turns(solves) -> list[Solved]:
    """Return solves on a ground that leans, if that explains turned sensors.

    It turns the normals of all fingers alike, by fewer unknowns: it replaces their own
    turns (formulations/finger_turn.py) where its evidence is larger.
    """
    best, job = solves[0], solves[0].job
    if FINGER_TURN not in best.solution.values or not best.solution.success:
        return solves
    if not job.fixes("level"):
        return solves
    ground = job.scene.ground.turned(_common_turn(best), _below_first_touches(best))
    moved = moved_to(ground, best)
    leans = solve_by_continuation(moved.job.with_reductions(aligned=True), moved)
    if leans is None or not leans.solution.success:
        return solves
    leans = replace(leans, declined=best.declined)
    leans = _tilt_by_steps(leans, UNCHANGED)
    occam = occam_of(best.kkt, FINGER_TURN)
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
    w = solved.solution.values[FINGER_TURN].T.ravel()
    information = (
        np.linalg.inv(solved.kkt.marginal(FINGER_TURN)) - np.eye(len(w)) / TURN_SIGMA**2
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
        tilt = ground_tilt(best.linearised, about)
        if tilt.gain < (needed if ground.told is None else UNCHANGED):
            break
        if job.deadline.passed("a tilt of the ground"):
            break
        again = _solved_on_ground(ground.turned(tilt.mean, about), best)
        if not again.solution.success or again.cost > best.cost - UNCHANGED:
            break
        best = again
    return best


def _below_first_touches(solved: Solved):
    """Return the point (3,) [m] of the ground below the touches of the first action."""
    touch, action = solved.window.touch, solved.job.data.action
    early = action[touch.sample] == action[touch.sample[0]]
    return touch.p_wf[early, :3].mean(axis=0) * (1, 1, 0)


def _solved_on_ground(ground, solved: Solved) -> Solved:
    """Solve a page again on another ground, from its solution."""
    moved = moved_to(ground, solved)
    return warm_started(moved.job, moved)


def moved_to(ground, solved: Solved) -> Solved:
    """Return a solve of a body that lies on another ground as it does on its own.

    The frame of the ground moves with it, the farther the world's origin is from the
    body: data and poses are in the new one.
    """
    job, old = solved.job, solved.job.scene.ground
    M = ground.rotation @ old.rotation.T
    yaw = np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1])
    spin = Rotation.from_rotvec([0, 0, yaw])
    turns = job.shape.of_vertices  # about the last pose, whose axes are the ground's

    def moved(x):
        height = np.zeros(x.shape[1]) if is_planar(x) else x[2]
        p = ground.to_ground(old.from_ground(np.stack([*x[:2], height], axis=1)))
        if is_planar(x):
            return np.vstack([p[:, :2].T, x[2] if turns else x[2] + yaw])
        R = spin * Rotation.from_matrix(matrices(x))
        R, vectors = (R * spin.inv(), rotvecs_back) if turns else (R, rotvecs)
        return np.vstack([p[:, :2].T, height, vectors(R.as_matrix()).T])

    solution, h = solved.solution, solved.hypothesis
    values = solution.values | {"x": moved(solution.values["x"])}
    h = replace(h, x=moved(h.x))
    if turns:
        values["theta"] = spin.as_matrix() @ values["theta"]
        h = replace(h, theta=spin.apply(h.theta.reshape(-1, 3)).ravel())
    return replace(
        solved, job=job.on_ground(ground), hypothesis=h,
        solution=replace(solution, values=values),
    )  # fmt: skip
