"""Optima compete with the same reductions: what is restored for one is for all."""

from dataclasses import replace

import pytest

from tactilenlp.estimation.interrupted import Incumbents
from tactilenlp.estimation.optima import certify_best, optima_of
from tactilenlp.interface.request import read_request
from tactilenlp.local.comparison import same_body
from tactilenlp.local.local_solve import warm_started


@pytest.fixture(scope="module")
def case(two_actions):
    """The request of two actions, which leave several bodies open, and its optima."""
    data, scene, _ = two_actions
    request, _ = read_request(data, scene, "cuboid")
    return request, optima_of(request, Incumbents([]))


def with_a_cut(solved):
    """Return a solve with one more pose within a rest, as a certificate asks for."""
    still = solved.window.pose
    (sample, *_) = (still[1:] == still[:-1]).nonzero()[0] + 1
    return warm_started(replace(solved.job, cuts=(int(sample),)), solved)


def test_what_is_restored_for_the_best_optimum_is_restored_for_all(case):
    request, optima = case
    best, *others = certify_best(request, optima, with_a_cut).modes
    assert best.job.cuts
    assert others
    assert all(s.job.cuts == best.job.cuts for s in others)
    assert not any(same_body(best.job.shape, s.at, best.at) for s in others)


def test_where_a_certified_optimum_costs_more_the_next_one_is_certified(case):
    request, optima = case
    cheapest, asked = optima.best, []

    def dearer(solved):
        asked.append(solved)
        if not same_body(solved.job.shape, solved.at, cheapest.at):
            return solved
        cost = replace(solved.solution, objective=solved.solution.objective + 10.0)
        return replace(solved, solution=cost)

    found = certify_best(request, optima, dearer)
    assert len(asked) > 1
    assert not same_body(found.best.job.shape, found.best.at, cheapest.at)
    assert found.best.solution.objective < cheapest.solution.objective + 10.0
    assert any(same_body(cheapest.job.shape, s.at, cheapest.at) for s in found.solved)
