"""Incremental update of a polytope's estimate by one action, the past as a Gaussian.

Planes give the poses of the new action; a page of that action alone gives what it adds
to the vertices (polytope_extension.py); then the joint problem of all actions is solved
from the unknowns and multipliers of the estimate.
"""

from __future__ import annotations

import logging
from dataclasses import asdict, replace

import numpy as np
from scipy.optimize import nnls

from formulations import polytope_extension as extension
from formulations.names import BALL, GROUND, TOUCH_TERM
from formulations.rigid_body import ARM

from ..certificates.outliers import MIN_OF_TOUCH
from ..geometry.convex_hull import centroid
from ..geometry.transforms import planar_matrix
from ..information.goodness_of_fit import LOST
from ..information.measurement_noise import touches
from ..information.trajectory import moved_farther
from ..local.local_solve import solve_by_continuation, warm_started
from ..local.solved import (
    ACCEPTABLE,
    BuiltPage,
    Solved,
    best_first,
    search_settings,
)
from ..local.transfer import matching_contacts
from ..problem.fingertips import unexplained
from ..problem.job import Job
from ..problem.polytope_window import PolytopeWindow
from ..problem.reductions import Reductions
from ..problem.window import Corners
from ..search.plane_slam import poses_of_new_action
from ..search.polytope_init import (
    has_likely_count,
    planes_on_body,
    with_credible_touches,
)
from ..search.predicted_motion import with_pushes
from ..search.soft_fingertips import as_of_rigid_fingertips
from ..solvers.solution import Solution, after
from .certification import restore_reductions
from .incremental import (
    UPDATE_MU,
    can_update,
    of_more_samples,
    past_solution,
    update_limit,
)

log = logging.getLogger("tactilenlp")
MIN_INFORMATION = 1.0  # [1 / m^2] about any direction


def update_by_one_action(job: Job, start) -> tuple[Solved | None, bool]:
    """Return the page of all actions, solved from an estimate of all but the last one.

    The second result tells whether it is accepted: every touch is explained, nothing
    jumps, the objective rises by no more than an action usually adds, no certificate
    is broken that held before, and evidence asks for as many vertices as before.
    Otherwise all actions are to be solved again, and the better result kept.  It is
    None where `start` is no such estimate.
    """
    if not is_one_action_more(start, job):
        return None, False
    job = replace(job, cuts=start.cuts)
    past = past_solution(job, start)
    solved = joint(job, past, new_action_alone(job, past, past_information(start)))
    most = update_limit(start, more=1)

    def good(solved) -> bool:
        cheap = solved.solution.objective < most
        return cheap and solved.solution.success and not implausible(solved)

    if not good(solved):
        solved = _better_by_continuation(solved)
    if good(solved):
        solved = restore_reductions(solved)
        before = {s.name for s in start.skipped if not s.holds}
        holds = {*solved.certificates.broken} <= before
        if holds and has_likely_count(job, solved.at):
            return solved, True
        if holds:
            log.info("other numbers of vertices are likelier: solving all actions")
            return solved, False
    more = solved.solution.objective - start.objective
    words = "incremental update rejected (%+.0f nats): solving all actions again"
    log.info(words, more)
    return solved, False


def continuation_if_implausible(solves, update=None) -> list[Solved]:
    """Return solves, best first; the best is solved again where it is implausible.

    update: the result of a rejected update, which competes, if there is one.
    """
    best, *others = solves
    if best.job.contract.extends and implausible(best):
        log.info("touches are not explained, or the body jumps: continuation")
        best = _better_by_continuation(best)
    solves = [best, *others]
    return solves if update is None else best_first([*solves, update])


def _better_by_continuation(solved: Solved) -> Solved:
    """Return a solve, or the one that its continuation leads to, if that is better."""
    again = solve_by_continuation(solved.job, solved)
    return solved if again is None else min(solved, again, key=lambda s: s.rank)


def is_one_action_more(start, job: Job) -> bool:
    """Tell whether a job is that of an estimate of this page and one action more."""
    if not (can_update(start, job) and job.contract.extends and job.reductions.planar):
        return False  # in free motion all actions are solved again
    whole = start.measurements.samples == np.count_nonzero(
        job.data.action != job.data.action[-1]
    )
    vertices = job.shape.counts or [job.shape.theta // 3]
    alike = start.shape == job.shape.name and start.theta.size // 3 in vertices
    alike = alike and {**start.reductions} == asdict(job.reductions)
    finite = start.information is not None and np.isfinite(start.information.matrix)
    return whole and alike and bool(np.all(finite))


def past_information(start) -> np.ndarray:
    """Return the information (3 V, 3 V) [1/m^2] about vertices, ground frame."""
    turn = np.kron(np.eye(start.theta.size // 3), start.scene.ground.rotation.T)
    values, vectors = np.linalg.eigh(turn.T @ start.information.matrix @ turn)
    return (vectors * np.maximum(values, MIN_INFORMATION)) @ vectors.T


def implausible(solved: Solved) -> bool:
    """Tell whether a touch is not explained, or the body was lost between actions."""
    moved = moved_farther(solved.solution.values["x"], solved.window, LOST)
    return moved or unexplained_touches(solved) > 0


def unexplained_touches(solved: Solved) -> int:
    """Return how many touches, of a finger in an action each, are not explained."""
    problem, window = solved.problem, solved.window
    if TOUCH_TERM not in problem.terms:
        return 0
    costly = unexplained(problem, window, *solved.solution.at(problem))
    rows_of = touches(window, solved.job.data).values()
    return sum(costly[rows].sum() >= MIN_OF_TOUCH for rows in rows_of)


def new_action_alone(job: Job, past: Solved, about) -> Solved:
    """Return the new action solved alone: vertices, its poses and impulses.

    about: information (3 V, 3 V) about the vertices of the past.
    """
    lean = with_credible_touches(replace(job, reductions=Reductions()))
    lean = as_of_rigid_fingertips(lean, past.at.compliance)
    h = replace(past.at, x=poses_of_new_action(lean, planes_on_body(lean, past.at)))
    settings, solution = search_settings(job, **ACCEPTABLE), past.solution
    for build, levels in (
        (extension.build, extension.LEVELS),
        (extension.build_pushed, extension.PUSHED),
    ):
        window = job.window((h.theta, h.x)).of_action(past.at, about)
        centre = centroid(h.theta.reshape(-1, 3))[:2]
        window = with_pushes(job, window, h.x, centre)
        problem = job.build(window, fill=build)
        start = {
            k: v for k, v in past.solution.values.items()
            if v.size == 1 and k in problem.variables
        }  # fmt: skip
        built = BuiltPage(problem, window, h)
        start |= built.values_at(h)
        solved = built.solve(job, levels, start, h, solution, settings)
        solution, h = solved.solution, solved.at
    return replace(solved, hypothesis=h)


def joint(job: Job, past: Solved, new: Solved) -> Solved:
    """Return the page of all actions, solved from the past and the new action."""
    h, turn = new.hypothesis.with_axes_of_ground()

    def start(past, built) -> Solution:
        window = built.window
        past, last = on_legs(past, window), on_legs(new, window)
        solution = of_more_samples(past, built)
        values = solution.values
        values[BALL][:3] = turn @ values[BALL][:3]
        values["theta"], values["x"] = h.theta.reshape(-1, 3).T, h.x[:, window.last]
        values["body"] = window.body[:, None]
        for name, row in matching_contacts(last.window, window).items():
            values[name][:, row >= 0] = last.solution.values[name][:, row[row >= 0]]
        return solution

    solved = warm_started(job, past, UPDATE_MU, h, start)
    return replace(solved, solution=after(new.solution, solved.solution))


def on_legs(solved: Solved, window: PolytopeWindow) -> Solved:
    """Return a solution as if the body had stood on the legs of another window.

    The force and the moment of the ground on the body stay the same.
    """
    old, legs, V = solved.window.legs, window.legs, window.start
    if np.array_equal(old, legs):
        return solved
    solution, yaw = solved.solution, solved.at.x[2, solved.window.step.sample]
    ground = solution.values[GROUND]
    impulses_at_legs = redistributed(
        V[old], V[legs], yaw, ground.reshape(len(ground), -1, len(old))
    )
    impulses_at_legs = impulses_at_legs.reshape(len(ground), -1)
    corner = Corners(
        np.repeat(np.arange(len(yaw)), len(legs)),
        np.zeros((impulses_at_legs.shape[1], 3)),
    )
    terms = solved.problem.constraints.values()
    of_ground = {term.name for term in terms if term.per == GROUND}
    others = {k: m for k, m in solution.multipliers.items() if k not in of_ground}
    solution = replace(
        solution, values=solution.values | {GROUND: impulses_at_legs},
        multipliers=others,
        bound_multipliers=solution.bound_multipliers | {GROUND: 0 * impulses_at_legs},
    )  # fmt: skip
    at = replace(solved.window, corner=corner, legs=legs)
    return replace(solved, solution=solution).with_window(at)


def redistributed(old, legs, yaw, impulses) -> np.ndarray:
    """Return impulses at other legs with the same force and moment.

    old (m, 3), legs (n, 3): body frame; yaw (steps,) of the body; impulses (rows,
    steps, m): normal and, unless there is no friction, along x and y of the world.
    """
    out = np.zeros((*impulses.shape[:2], len(legs)))
    for k, angle in enumerate(yaw):
        p, q = (v[:, :2] @ planar_matrix(-angle)[:2, :2] for v in (old, legs))
        up, same = impulses[0, k], np.vstack([np.ones(len(q)), q.T / ARM])
        out[0, k] = nnls(same, np.r_[up.sum(), up @ p / ARM])[0]
        if len(impulses) > 1:
            along = impulses[1:, k]
            turn = (p[:, 0] * along[1] - p[:, 1] * along[0]).sum()
            one, none = np.ones(len(q)), np.zeros(len(q))
            rows = [np.r_[one, none], np.r_[none, one], np.r_[-q[:, 1], q[:, 0]] / ARM]
            wrench = np.r_[along.sum(axis=1), turn / ARM]
            out[1:, k] = np.linalg.lstsq(rows, wrench, rcond=None)[0].reshape(2, -1)
    return out
