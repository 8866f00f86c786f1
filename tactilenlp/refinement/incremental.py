"""Incremental update: the solution of an estimate starts the page of more actions.

Values and multipliers of the actions that were solved are kept.  The new actions begin
as a search continues the posterior: of a shape with sizes, from few of its tracks; of a
polytope, as incremental_polytope.py says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace

import numpy as np

from ..certificates.certify import LEFT_OUT
from ..interface.result import Estimate, solution_of
from ..local.comparison import same_body
from ..local.local_solve import built_page, solved_from, transfer_solution
from ..local.margins import DECISIVE, UNCHANGED, UPDATE_SHARE
from ..local.solved import BuiltPage, Solved, Solves, best_first
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..problem.pages import name_of
from ..problem.reductions import Reductions
from ..solvers.solution import Solution

UPDATE_MU = 1e-3  # IPOPT's mu_init where all but one action is known


def can_update(start, job: Job) -> bool:
    """Tell whether a start is an estimate of a job's page, of the same contacts."""
    good = isinstance(start, Estimate) and start.success
    good = good and start.formulation == name_of(job.page)
    return good and _contacts(start.scene) == _contacts(job.scene)


def _contacts(scene) -> tuple[bool, ...]:
    """Return whether there is a ground, and which contacts have no friction."""
    return (
        scene.ground is None, scene.friction_ground == 0, scene.friction_finger == 0
    )  # fmt: skip


def new_actions(start, data) -> int:
    """Return how many actions an estimate did not have whole."""
    done = start.measurements.samples
    within = done < data.samples and data.action[done] == data.action[done - 1]
    return data.actions - start.measurements.actions + int(within)


def update_limit(start, more: int) -> float:
    """Return the largest objective [nats] with which more actions are explained."""
    usual = max(start.objective, 0.0) / start.measurements.actions
    return start.objective + DECISIVE + UPDATE_SHARE * usual * more


def of_whole_actions(start, job: Job) -> bool:
    """Tell whether an estimate of a job's page is of its first actions, each whole.

    With the same reductions but those that a certificate restores, and touches that
    cost what they should.
    """
    data, done = job.data, start.measurements.samples
    whole = done < data.samples and data.action[done] != data.action[done - 1]
    restored = dict.fromkeys(LEFT_OUT, True)
    alike = {**start.reductions, **restored} == {**asdict(job.reductions), **restored}
    good = start.fit is not None and start.fit.verdict == "good"
    return whole and alike and good


def past_solution(job: Job, start) -> Solved:
    """Return the estimate as a solved page, with its own reductions and cuts."""
    data, made = job.data, Reductions(**start.reductions)
    data = data.select(np.unique(start.measurements.action))
    job = replace(job, data=data, reductions=made, cuts=start.cuts)
    built = built_page(job, start.origin)
    seconds = {"build": built.seconds, "solve": 0.0}
    solution = solution_of(start, job.page)
    solution = replace(solution, iterations=0, evaluations=0, seconds=seconds)
    return Solved(start.origin, built, solution, job)


def of_more_samples(past: Solved, built: BuiltPage) -> Solution:
    """Return a solution as the start of a page of more samples.

    The page guesses what the new ones have, whose multipliers are zero.
    """
    missing = np.full(len(built.window.pose) - len(past.window.pose), -1)
    window = replace(past.window, pose=np.r_[past.window.pose, missing])
    return transfer_solution(past.with_window(window), built)


def update_by_few_starts(
    job: Job, start, first: Sequence[Hypothesis], second: Callable[[], Hypothesis],
    solves: Solves,
) -> bool:  # fmt: skip
    """Solve the page from few starts; tell whether these suffice.

    They do where the objective has hardly risen, since more data never cost less, and
    where a start of another source leads to the same optimum.  first: starts that
    continue the posterior; second(): another one, computed where it is asked for;
    solves: where they are added.  What certificates restored in the estimate stays
    restored.
    """
    made = Reductions(**start.reductions)
    job = replace(job, cuts=start.cuts, reductions=made)
    built = built_page(job, first[0])
    past = of_more_samples(past_solution(job, start), built)
    last = replace(job.page.LEVELS[-1], warm_start={"mu_init": UPDATE_MU})

    def solve(h: Hypothesis) -> Solved:
        values = past.values | built.values_at(h)
        guess = replace(past, values=values)
        return solves.add(solved_from(job, h, built, [last], guess))

    best = best_first([solve(h) for h in first])[0]
    if still_explained(best, start):
        return True
    new = job.data.actions - start.measurements.actions
    if best.solution.objective > update_limit(start, new):
        return False
    other = solve(second())
    alike = other.solution.success and best.solution.success
    alike = alike and abs(other.cost - best.cost) < UNCHANGED
    return alike and same_body(job.shape, other.at, best.at)


def still_explained(best, start) -> bool:
    """Tell whether the trajectory of an earlier estimate explains the new data as well.

    More data never cost less: where the objective has not risen nothing can be gained.
    """
    risen = best.solution.objective > start.objective + UNCHANGED
    return best.solution.success and not risen
