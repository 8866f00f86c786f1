"""Another search, action by action, where the fit is not good."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations import violation_implicit
from formulations.names import BETWEEN_ACTIONS
from formulations.shape import CUBOID
from tactilenlp import CYLINDER, Options, polytope, solve_estimate
from tactilenlp.data.sensor_noise import Precision
from tactilenlp.estimation import optima
from tactilenlp.estimation.second_searches import from_more_hypotheses
from tactilenlp.information.goodness_of_fit import PHYSICS_ROW, Misfit
from tactilenlp.interface.request import Request, make_job
from tactilenlp.local.margins import (
    DECISIVE,
    DOUBTFUL,
    PHYSICS_SHARE,
    STEPS_OF_ACTION,
)
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.pages import shape_of
from tactilenlp.problem.reductions import Reductions
from tactilenlp.refinement import refinement
from tactilenlp.search.multi_hypothesis import proposed_tracks
from tactilenlp.search.plane_slam import DOUBTFUL_PATHS
from tactilenlp.tracking.initial_states import DOUBTFUL_DRAWN, DRAWN, initial_states
from tactilenlp.tracking.process_noise import PROCESS_NOISE_FACTOR
from tactilenlp.tracking.tracking import predicted_tracks, tracks_after
from tactilenlp.tracking.tracks import filter_of

STEPS = 3 * STEPS_OF_ACTION  # of the body in one long action


@pytest.fixture(scope="module")
def request_of_one_action(recorded):
    data, scene, _ = recorded
    data = data.select([0])
    given = data, scene, shape_of("cuboid"), Options(), time.monotonic()
    job = make_job(*given, violation_implicit)
    return Request(data, job)


def predicted(job):
    """Return covariances (6, 6, S) before and after the first sample of a push."""
    ekf, rng = filter_of(job, job.data), np.random.default_rng(0)
    tracks, _ = proposed_tracks(job, ekf, (), rng)
    t = int(np.flatnonzero(ekf.felt.any(axis=1))[0])
    after, _, moved = predicted_tracks(ekf, tracks, t - 1, t, rng)
    assert moved
    return tracks.P, after.P


def test_the_first_touch_is_no_evidence_for_bodies_drawn_to_explain_it(
    request_of_one_action,
):
    """Faces and edges explain it alike; of a guess, which does not, it is some."""
    job = request_of_one_action.job
    ekf, rng = filter_of(job, job.data), np.random.default_rng(0)
    t = np.flatnonzero(ekf.felt.any(axis=1))[:1]
    drawn, _ = proposed_tracks(job, ekf, (), rng)
    evidence = tracks_after(ekf, drawn, t, rng, (drawn, None))[0].evidence
    assert np.abs(evidence).max() < 1e-9
    guess = Hypothesis(drawn.z[:3, 0], drawn.z[3:, :1], 0.0, ("guess",))
    guessed, _ = proposed_tracks(job.with_search(guess=guess), ekf, (), rng)
    evidence = tracks_after(ekf, guessed, t, rng, (guessed, None))[0].evidence
    assert evidence.max() < -1.0


def test_rough_motion_widens_what_a_push_leaves_open(request_of_one_action):
    job = request_of_one_action.job
    rough = request_of_one_action.less_sure_of_pushes().job
    before, once = predicted(job)
    same, more = predicted(rough)
    assert (before == same).all()
    still = predicted(job.with_search(process_noise=0.0))[1]
    for i in (-3, -2, -1):
        ratio = (more - still)[i, i] / (once - still)[i, i]
        assert np.median(ratio) == pytest.approx(PROCESS_NOISE_FACTOR**2, rel=1e-3)


def test_a_guess_is_kept_and_an_estimate_is_not(request_of_one_action, touched):
    guess = object()
    kept = replace(request_of_one_action, start=guess).from_scratch()
    assert kept.start is guess
    anew = replace(request_of_one_action, start=touched).from_scratch()
    assert anew.start is None


def test_actions_are_added_one_by_one_from_the_first_touch_on(
    recorded, request_of_one_action
):
    data, _, _ = recorded
    untouched = data.action == 0
    late = replace(
        data, contact=data.contact & ~untouched[:, None],
        normal=np.where(untouched[:, None, None], 0.0, data.normal),
    )  # fmt: skip

    def counts(data, shape):
        job = replace(request_of_one_action.job, data=data, shape=shape)
        request = replace(request_of_one_action, job=job, start=None)
        return [job.data.actions for job in request.jobs_by_action()]

    assert counts(data, CUBOID) == [1, 2, 3, 4, 5, 6]
    assert counts(late, CUBOID) == [2, 3, 4, 5, 6]
    assert counts(late, polytope(20)) == [2, 3, 4, 5, 6]


def test_an_update_of_a_polytope_is_searched_with_all_actions(recorded, touched):
    """The estimate that it starts from came about action by action."""
    data, _, _ = recorded
    job = SimpleNamespace(data=data, shape=polytope(20))
    assert Request.jobs_by_action(SimpleNamespace(job=job, start=touched)) == [job]


def test_what_fits_badly_is_searched_again_where_that_can_find_more(
    request_of_one_action, touched
):
    asked, verdict, moved, balance = request_of_one_action, "poor", 0.0, 0.0
    problem = SimpleNamespace(
        costs={BETWEEN_ACTIONS: None}, value=lambda *_: np.array([0.1, moved]),
        pack=lambda _: None, data=lambda _: None,
    )  # fmt: skip

    def searched(request, success=True, soft=False, least=DECISIVE, **job):
        job = replace(request.job, **job)
        solution = SimpleNamespace(success=success, at=lambda problem: (None, None))
        # The fit judges no physics of soft fingertips.
        physics = {} if soft else {PHYSICS_ROW: Misfit(balance, 2.0, 1.0)}
        best = SimpleNamespace(
            job=job, solution=solution, problem=problem,
            window=SimpleNamespace(gap=[1, 2], step=range(STEPS)),
            fit=SimpleNamespace(verdict=verdict, terms=physics),
        )  # fmt: skip
        return refinement.fits_badly(request, best, least)

    assert searched(asked)
    assert not searched(asked, success=False)
    assert searched(asked, reductions=Reductions(planar=False))  # tilt did not help
    free = replace(asked.job, reductions=Reductions(planar=False))
    assert not searched(replace(asked, job=free))
    assert searched(asked, shape=polytope(20))
    assert not searched(asked, shape=CYLINDER)  # it may be no cylinder
    assert searched(replace(asked, start=touched), shape=CYLINDER)
    verdict = "good"
    assert not searched(asked)
    moved = 1.01 * DECISIVE  # nats of a motion between two actions
    assert searched(asked)
    assert searched(asked, shape=polytope(20))
    noisy = Precision(1e-3, 0.1)
    assert searched(asked, precision=noisy)
    assert not searched(asked, shape=polytope(20), precision=noisy)
    moved, balance = 0.0, 0.99 * (DECISIVE + 3 * PHYSICS_SHARE)
    assert not searched(asked)
    assert searched(asked, least=DOUBTFUL)
    balance = 1.01 * (DECISIVE + 3 * PHYSICS_SHARE)
    assert searched(asked)
    assert not searched(asked, soft=True)  # soft contacts creep
    assert not searched(asked, precision=noisy)


@pytest.mark.slow
def test_the_better_of_two_searches_is_the_estimate(recorded, monkeypatch):
    data, scene, _ = recorded
    data = data.select([0, 1])
    seen, more_noise = [], Request.less_sure_of_pushes

    def asked(request):
        seen.append(request)
        return more_noise(request)

    once = solve_estimate(data, scene)
    assert once.fit.verdict == "good"
    monkeypatch.setattr(Request, "less_sure_of_pushes", asked)
    same = solve_estimate(data, scene)
    assert not seen
    assert same.objective == once.objective
    monkeypatch.setattr(optima, "fits_badly", lambda *_: True)
    twice = solve_estimate(data, scene)
    assert len(seen) == 1  # it found no more after the first action
    assert seen[0].job.data.actions == 1
    assert twice.objective <= once.objective + 1e-3


def test_a_doubtful_trajectory_is_first_searched_from_more_hypotheses(
    request_of_one_action,
):
    job = request_of_one_action.job
    wide = from_more_hypotheses(replace(request_of_one_action, start=None), job)
    assert wide.job.search.drawn == DOUBTFUL_DRAWN > job.search.drawn
    states = [
        initial_states(job.data, CUBOID, np.random.default_rng(0), 0.01, n)[0]
        for n in (DRAWN, DRAWN * DOUBTFUL_DRAWN)
    ]
    assert states[1].shape[1] == DOUBTFUL_DRAWN * states[0].shape[1]
    of_vertices = replace(job, shape=polytope(20))
    request = replace(request_of_one_action, job=of_vertices, start=None)
    assert from_more_hypotheses(request, of_vertices).job.search.drawn == DOUBTFUL_PATHS


def test_one_action_of_a_polytope_is_not_searched_twice(request_of_one_action):
    job = replace(request_of_one_action.job, shape=polytope(20))
    again = replace(request_of_one_action, job=job)
    assert optima._search_by_action(again, job) is None


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["cuboid", "polytope"])
def test_the_next_action_continues_what_the_page_found(recorded, monkeypatch, shape):
    """Not what the filter kept: the optima of the page after each action."""
    data, scene, _ = recorded
    whole, searches = optima.initial_hypotheses, []

    def searched(request, incumbents, begun):
        searches.append((request.job.data, list(incumbents.kept)))
        return whole(request, incumbents, begun)

    monkeypatch.setattr(optima, "initial_hypotheses", searched)
    bad = [True, True]  # at first, and after the second search; then no longer
    monkeypatch.setattr(optima, "fits_badly", lambda *_: bad and bad.pop())
    found = solve_estimate(data.select([0, 1, 2]), scene, shape=shape)
    (_, first), *parts = searches
    assert not first
    drawn, kept = parts.pop(0 if shape == "cuboid" else -1)
    assert drawn.actions == 3
    assert not kept
    assert [d.actions for d, _ in parts] == [1, 2, 3]
    assert not parts[0][1]
    for before, kept in parts[1:]:
        assert kept
        done = np.count_nonzero(before.action < before.action[-1])
        assert all(h.x.shape[1] == done for h in kept)
    assert found.success


def test_a_better_path_to_the_same_end_is_no_repetition(estimate):
    """Paths can be far apart on the way though they end at the same body."""
    job = SimpleNamespace(shape=CUBOID)
    h = estimate.hypotheses[0]

    def solved(objective, at=h):
        rank = (False, objective)
        return SimpleNamespace(job=job, at=at, rank=rank)

    known = [solved(5.0), solved(8.0)]
    assert optima._differs(solved(4.0), known)
    assert not optima._differs(solved(5.0), known)
    assert not optima._differs(solved(6.0), known)
    away = replace(h, x=h.x + np.array([[0.02], [0.0], [0.0]]))
    assert optima._differs(solved(6.0, away), known)
