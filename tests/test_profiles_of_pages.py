"""Profiles of solved pages: where they are made, and what better optima lead to."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import Options, Session
from tactilenlp.estimation.initial_search import initial_hypotheses
from tactilenlp.estimation.interrupted import Incumbents
from tactilenlp.interface.request import read_request
from tactilenlp.local.local_solve import solved_from
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.refinement import certification
from tactilenlp.refinement.profile_likelihood import profile_deviations

AT = Hypothesis(np.full(3, 0.04), np.zeros((3, 2)), 0.0, ())


def test_profiles_go_on_where_a_better_optimum_is_not_better_with_nothing_held(
    monkeypatch,
):
    asked, met = [], SimpleNamespace(at=AT)

    def profiles(best, seeks=True):
        asked.append(seeks)
        return np.eye(6), met if seeks else None

    solution = SimpleNamespace(success=True)
    deadline = SimpleNamespace(passed=lambda _: False)
    job = SimpleNamespace(
        options=SimpleNamespace(profile_likelihood=True), deadline=deadline,
        page=SimpleNamespace(LEVELS=(None,)), shape=replace(CUBOID, of_vertices=True),
    )  # fmt: skip
    certificates = SimpleNamespace(broken=())
    best = Certified(solution, certificates, job, (False, 1.0))
    monkeypatch.setattr(certification, "profile_deviations", profiles)
    monkeypatch.setattr(certification, "restore_reductions", lambda solved: solved)
    for rank, same in (((False, 1.2), True), ((False, 0.6), False)):
        again = replace(best, rank=rank)

        def warm_started(job, known, mu_init, again=again):
            assert known is met  # with its impulses and multipliers
            return again

        monkeypatch.setattr(certification, "warm_started", warm_started)
        asked.clear()
        found = certification.solve_profiles(best)
        assert asked == [True, False]
        assert (found.rank == best.rank) == same
        assert (found.profile == np.eye(6)).all()


@dataclass(frozen=True)
class Certified:
    """What `solve_profiles` reads of a solve."""

    solution: object
    certificates: object
    job: object
    rank: tuple
    profile: object = None
    declined: tuple = ()


def test_a_body_without_sides_has_no_profile():
    planar = SimpleNamespace(planar=True)
    job = SimpleNamespace(shape=replace(CUBOID, of_vertices=True), reductions=planar)
    found, better = profile_deviations(SimpleNamespace(at=AT, job=job))
    assert better is None
    assert not found.any()


@pytest.mark.slow
def test_profiles_of_shooting_are_those_of_multiple_shooting(recorded):
    """One problem: poses that single shooting computes are held elsewhere as well."""
    data, scene, _ = recorded
    found = []
    for page in ("multiple_shooting", "shooting"):
        given = "cuboid", page, Options(), None, None, Session()
        request, _ = read_request(data.select([0, 1]), scene, *given)
        starts, _ = initial_hypotheses(request, Incumbents([]))
        solved = solved_from(request.job, starts[0])
        found.append(profile_deviations(solved, seeks=False)[0])
    where = np.flatnonzero(found[0].any(axis=1))
    assert where.max() >= CUBOID.theta  # one of them is of a position
    assert found[1] == pytest.approx(found[0], rel=1e-2, abs=1e-6)
