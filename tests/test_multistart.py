"""Multistart: what comes together is solved once, what is far behind not at all."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations import quasi_static
from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import Options
from tactilenlp.interface.request import make_job
from tactilenlp.local.comparison import distinct, same_body
from tactilenlp.local.levels import freed_levels
from tactilenlp.local.local_solve import solve_by_continuation, solved_from
from tactilenlp.local.solved import Solved, Solves, best_first
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.search import multistart as starts
from tactilenlp.search.multistart import multistart

LEVELS = freed_levels(page.LEVELS)


@pytest.fixture(scope="module")
def case(estimate):
    """Three actions of the shipped recording, and their optimum."""
    given = estimate.measurements, estimate.scene, CUBOID, Options()
    return make_job(*given, time.monotonic(), page), estimate.hypotheses[0]


def pushed(h, way):
    """Return the hypothesis with all poses moved by way [m]."""
    return replace(h, x=h.x + np.array([[way], [0.0], [0.0]]))


def test_hypotheses_that_come_together_are_solved_to_the_end_once(case):
    job, h = case
    solved = multistart(job, [h, pushed(h, 1e-4), pushed(h, -1e-4)], LEVELS)
    assert len(solved) == 1
    assert solved[0].solution.success
    assert len(solved[0].solution.iterations_by_level) == len(LEVELS)
    alone = multistart(job, [h], LEVELS)
    assert solved[0].solution.objective == pytest.approx(
        alone[0].solution.objective, abs=0.3
    )


def test_what_is_known_or_hopeless_is_not_solved_to_the_end(case):
    job, h = case
    known = multistart(job, [h], LEVELS)
    assert multistart(job, [pushed(h, 1e-4)], LEVELS, earlier=known) == []
    # A known one that costs 100 nats less than anything: nothing comes near it.
    cheap = replace(known[0].solution, objective=h.objective - 100)
    lucky = replace(known[0], solution=cheap, before_last_level=None)
    far = pushed(h, 30e-3)
    assert multistart(job, [far], LEVELS, earlier=[lucky]) == []


def test_only_the_best_start_is_solved_beyond_the_iterations_of_each(case, monkeypatch):
    job, h = case
    levels = [level.with_ipopt(max_iter=1500) for level in LEVELS]
    whole = multistart(job, [h], levels)[0]
    monkeypatch.setattr(starts, "RANKED_ITERATIONS", 3)
    asked = []

    def counted(*given, **named):
        asked.append(given[3][-1].ipopt["max_iter"])
        return solved_from(*given, **named)

    monkeypatch.setattr(starts, "solved_from", counted)
    found = multistart(job, [h, pushed(h, 1e-3)], levels)
    assert asked.count(1500) == 1
    assert found[0].solution.success
    assert found[0].cost == pytest.approx(whole.cost, abs=0.3)
    assert len({id(one.problem) for one in found}) == 1  # it is not built again
    asked.clear()
    known = multistart(job, [pushed(h, 1e-3)], levels, earlier=[whole])
    assert 1500 not in asked  # it is not ahead of what is known
    assert not any(s.solution.success for s in known)


def test_levels_that_hold_poses_are_solved_one_by_one(case):
    job, h = case
    kept = Solves()
    solved = multistart(job, [h, h], page.LEVELS, solves=kept)
    assert len(solved) == len(kept.ended) == 2


def test_the_price_of_a_latency_counts_where_solves_are_ranked():
    """A job of late sensors pays the prior of its latency [nats]."""

    def solved(objective, price):
        solution = SimpleNamespace(success=True, objective=objective)
        job = SimpleNamespace(prior_cost=price, shape=CUBOID)
        return Solved(SimpleNamespace(closed=False), None, solution, job)

    late, prompt = solved(1.0, 0.5), solved(1.2, 0.0)
    assert late.cost == 1.5
    assert best_first([late, prompt]) == [prompt, late]


def test_provisional_solves_count_as_long_as_there_is_no_other():
    flat, rough, free, other = (
        SimpleNamespace(rank=(False, cost)) for cost in (2.0, 1.0, 4.0, 3.0)
    )
    solves = Solves()
    part, beside = solves.part(), solves.part()
    slid = part.provisional()
    slid.provisional().add(rough)
    assert solves.best_first() == [rough]
    slid.add(flat)
    assert solves.best_first() == [flat]
    part.provisional().add(rough)  # instead of what was provisional before
    assert solves.best_first() == [rough]
    assert part.add(free) is free
    beside.add(other)
    beside.provisional().add(flat)
    assert solves.best_first() == [other, free]
    assert part.best_first() == [free]
    assert solves.part([flat]).best_first() == [flat]


def test_continuation_ends_in_an_optimum_of_the_page(case):
    job, h = case
    solved = multistart(job, [h], LEVELS)
    again = solve_by_continuation(job, solved[0])
    assert again.solution.success
    assert again.solution.parameters == solved[0].solution.parameters
    assert again.solution.objective < solved[0].solution.objective + 0.5


def test_a_page_without_easier_levels_has_no_continuation(case):
    assert solve_by_continuation(replace(case[0], page=quasi_static), None) is None


def test_two_pasts_that_end_alike_are_one_where_only_the_end_counts(case):
    _, h = case
    x = h.x.copy()
    x[0, :-1] += 5e-3
    other = replace(h, x=x, objective=h.objective + 1)
    assert not same_body(CUBOID, h, other)
    assert same_body(CUBOID, h, other, samples=(-1,))
    assert len(distinct(CUBOID, [h, other], 4, np.inf)) == 2
    assert distinct(CUBOID, [other, h], 4, np.inf, samples=(-1,)) == [h]


def test_free_bodies_are_the_same_where_their_corners_agree_whatever_the_axes():
    quarter = np.array([0.0, 0.0, 0.02, 0.0, 0.0, np.pi / 2])  # [m, rad] about z
    box = Hypothesis(np.r_[0.03, 0.05, 0.04], np.zeros((6, 2)), 0.0, ())
    box.x[2] = 0.02
    relabelled = replace(
        box, theta=np.r_[0.05, 0.03, 0.04], x=np.repeat(quarter[:, None], 2, axis=1)
    )
    assert same_body(CUBOID, box, relabelled)
    assert not same_body(CUBOID, box, replace(relabelled, theta=box.theta))
