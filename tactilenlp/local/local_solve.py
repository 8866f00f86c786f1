"""Local solves of a page: from a hypothesis, from an earlier solution, continued."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from formulations.rigid_body import PLANAR

from ..geometry.convex_hull import hull_vertices, volume
from ..geometry.simplification import more_vertices
from ..geometry.tipping import planar_to_free
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..problem.reductions import required_reductions
from ..problem.window import Window
from ..solvers.solution import Solution, after, evaluated, unfinished
from .levels import levels_of
from .solved import BuiltPage, Solved
from .transfer import transferred_values

RESTART_MU = 1e-5  # IPOPT's mu_init from a solution that lacks only what was dropped
COLLAPSED = "Collapsed_Body"  # status of a solve whose next level has no body
RESTARTED = ("theta", "x", "body")  # unknowns of a rebuilt page that it guesses itself


# Problems of a page, where they start


def built_page(job: Job, hypothesis=None) -> BuiltPage:
    """Return the problem of a job's page, built.

    hypothesis: where it is solved from; reach and contacts of polytopes depend on it.
    """
    began = time.process_time()
    window = page_window(job, hypothesis)
    problem = job.build(window)
    return BuiltPage(problem, window, hypothesis, time.process_time() - began)


def page_window(job: Job, hypothesis=None) -> Window:
    """Return the window that a job's page reads, solved from a hypothesis."""
    made = required_reductions(job.page, job.reductions)
    guess = None if hypothesis is None else (hypothesis.theta, hypothesis.x)
    return replace(job, reductions=made).window(guess)


# Solves from a hypothesis


def in_motion_of(job: Job, h: Hypothesis) -> Hypothesis:
    """Return a hypothesis with free poses where a job has them: a body that lies."""
    if job.reductions.planar or len(h.x) != PLANAR.unknowns:
        return h
    return replace(h, x=planar_to_free(h.theta, h.x, job.shape))


def solved_from(
    job: Job, hypothesis: Hypothesis, built=None, levels=None, before=None
) -> Solved:
    """Solve the page from one hypothesis.

    built: the page, by default built here; levels: by default those of the page;
    before: the solution of earlier levels from this hypothesis, to start from.
    """
    hypothesis = in_motion_of(job, hypothesis)
    built = built or built_page(job, hypothesis)
    start = before or built.values_at(hypothesis)
    first, *later = level_groups(
        levels or job.page.LEVELS, lambda _, level: level.rebuild
    )
    solved = built.solve(job, first, start, hypothesis, before)
    return _rebuilt_for(job, solved, later)


def evaluated_at(job: Job, hypothesis: Hypothesis, before=None) -> Solved:
    """Return the page at a hypothesis, not solved: no time is left for that.

    before: a solve of an easier model that ended there, with its other unknowns; what
    is evaluated then has derivatives, for a sigma.
    """
    late = replace(job, deadline=job.deadline.until(0.0))
    window = page_window(late, hypothesis)
    problem = late.build(window, solved=before is not None)
    built = BuiltPage(problem, window, hypothesis)
    start, parameters = built.values_at(hypothesis), job.page.LEVELS[-1].parameters
    if before is None:
        solution = evaluated(problem, start, parameters)
    else:
        values, _, _ = transferred_values(before, window, problem)
        solution = evaluated(problem, values | start, parameters)
        solution = after(before.solution, solution)
    return Solved(hypothesis, built, solution, job)


# Warm starts: values and multipliers of an earlier solution


def transfer_solution(past: Solved, built: BuiltPage) -> Solution:
    """Return a solution as the start of another problem of the same data, or of more.

    Values and multipliers of what both problems have are kept; the page guesses the
    values of the rest, whose multipliers are zero.
    """
    values, bounds, multipliers = transferred_values(past, built.window, built.problem)
    return replace(
        past.solution, values=values, bound_multipliers=bounds, multipliers=multipliers,
        held={},
    )  # fmt: skip


def warm_started(
    job: Job, past: Solved, mu_init: float = RESTART_MU, hypothesis=None,
    start: Callable = transfer_solution,
) -> Solved:  # fmt: skip
    """Solve the page's last level from an earlier solution and its multipliers.

    past: solved with other reductions, or with less data; mu_init: of IPOPT;
    hypothesis: at which the problem is built, by default that of `past`;
    start(past, built): the Solution to start from.
    """
    built = built_page(job, hypothesis or past.hypothesis)
    last = replace(job.page.LEVELS[-1], warm_start={"mu_init": mu_init})
    solved = built.solve(job, (last,), start(past, built))
    return replace(solved, declined=past.declined)


def freed_to_tilt(job: Job, slid: Solved) -> Solved:
    """Solve the page in free motion from its solution `slid` in planar motion."""
    solution, at = slid.solution, slid.at
    x = planar_to_free(at.theta, solution.values["x"], job.shape)
    raised = replace(
        solution, values=solution.values | {"x": x},
        bound_multipliers=solution.bound_multipliers | {"x": np.zeros_like(x)},
    )  # fmt: skip
    at = replace(at, x=planar_to_free(at.theta, at.x, job.shape))
    lying = replace(slid, hypothesis=at, solution=raised)
    tilted = warm_started(job, lying)
    return replace(tilted, solution=after(solution, tilted.solution))


# Continuation: from an easier problem of the same page to the page itself


def solve_by_continuation(job: Job, solved: Solved) -> Solved | None:
    """Solve again by continuation from where a solve ended; None if the page has none.

    A page with levels for guessed poses (`ROUGH`) starts from the last two of them:
    the kinks between sliding and sticking, which can hold poses in a local optimum, are
    smooth there.  A page that is extended action by action (`EXTENDS`) goes through all
    its levels, where fingertips are rigid after soft ones.  None as well without time.
    """
    if job.deadline.passed("continuation"):
        return None
    if guess_levels := job.contract.rough[-2:]:
        return solved_from(job, solved.at, levels=guess_levels)
    if not job.contract.extends:
        return None
    if job.fixes("rigid"):
        return after_soft_fingertips(job, solved.at)
    return _rebuilt_for(job, solved, [[k] for k in job.page.LEVELS])


def after_soft_fingertips(job: Job, hypothesis: Hypothesis, levels=None) -> Solved:
    """Solve the page of rigid fingertips from where soft ones lead from a hypothesis.

    With soft fingertips, touches that hold a body in a local optimum cost less.  If no
    body is left, this step is omitted.  levels: of rigid ones, by default the page's.
    """
    soft = job.with_reductions(rigid=False)
    held = levels_of(soft)[:-1]  # the last one frees the compliance
    solved = solved_from(soft, hypothesis, levels=held)
    if collapsed(solved):
        return solved_from(job, hypothesis, levels=levels)
    return _rebuilt_for(job, solved, [[k] for k in levels or job.page.LEVELS])


def level_groups(levels, begins: Callable) -> list:
    """Return the levels in groups, a new one where begins(the one before, level)."""
    pairs = enumerate(pairwise(levels), 1)
    cuts = [i for i, pair in pairs if begins(*pair)]
    return [levels[i:k] for i, k in pairwise([0, *cuts, len(levels)])]


def _rebuilt_for(job: Job, solved: Solved, groups) -> Solved:
    """Go on from a solve through groups of levels, the page rebuilt before each."""
    with job.deadline.ending("all levels of the page"):
        for levels in groups:
            if job.deadline.passed("all levels of the page"):
                break
            if collapsed(solved):
                failed = replace(solved.solution, success=False, status=COLLAPSED)
                return replace(solved, solution=failed)
            solved = _rebuilt(job, solved, levels)
        else:
            return solved
    if solved.job.reductions != job.reductions:  # of an easier model: not reported
        return evaluated_at(job, with_vertices_on_hull(job.shape, solved.at), solved)
    return replace(solved, solution=unfinished(solved.solution))


def collapsed(solved: Solved) -> bool:
    """Tell whether the vertices where a solve ended lie in a plane: no body is left."""
    at, shape = solved.at, solved.job.shape
    return shape.of_vertices and not volume(at.theta.reshape(-1, 3))


def with_vertices_on_hull(shape, h: Hypothesis) -> Hypothesis:
    """Return a hypothesis whose vertices inside the hull are moved onto its surface.

    No contact sees a vertex inside.  Other shapes have none.
    """
    if not shape.of_vertices:
        return h
    vertices = h.theta.reshape(-1, 3)
    onto = more_vertices(hull_vertices(vertices), len(vertices))
    return replace(h, theta=onto.ravel())


def _rebuilt(job: Job, solved: Solved, levels) -> Solved:
    """Go on from a solve through levels of the page, rebuilt where it ended."""
    h = with_vertices_on_hull(job.shape, solved.at)
    built = built_page(job, h)
    values, _, _ = transferred_values(solved, built.window, built.problem)
    unchanged = {name: v for name, v in values.items() if name not in RESTARTED}
    start = unchanged | built.values_at(h)
    return built.solve(job, levels, start, before=solved.solution)
