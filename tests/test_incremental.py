"""Updates of boxes: solved from few starts where these explain the new action."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactilenlp import Options, Session, solve_estimate
from tactilenlp.common.deadline import OutOfTime
from tactilenlp.interface.request import read_request
from tactilenlp.local.local_solve import built_page
from tactilenlp.local.solved import Solves
from tactilenlp.problem.reductions import Reductions
from tactilenlp.refinement.incremental import (
    of_more_samples,
    of_whole_actions,
    past_solution,
    update_by_few_starts,
    update_limit,
)
from tactilenlp.search.multi_hypothesis import TrackingSearch


@pytest.fixture(scope="module")
def asked(recorded, estimate):
    """The request of four actions that starts from the estimate of three."""
    data, scene, _ = recorded
    given = "cuboid", "violation_implicit", Options(), estimate, None, Session()
    return read_request(data.select(range(4)), scene, *given)


def test_an_update_ends_where_few_starts_explain_the_new_action(
    recorded, estimate, caplog
):
    """The touched sides are right, and what was left out is checked as ever."""
    data, scene, truth = recorded
    caplog.set_level("INFO", "tactilenlp")
    found = solve_estimate(data.select(range(4)), scene, start=estimate)
    assert "no others are needed" in caplog.text
    assert found.objective < estimate.objective + 0.5
    touched = found.side_lengths[:2] - truth["side_lengths"][:2]
    assert np.abs(touched).max() < 0.2e-3
    assert found.fit.verdict == "good"
    assert {s.name for s in found.skipped} == {s.name for s in estimate.skipped}


@pytest.mark.slow
def test_noise_leaves_more_optima_open_than_few_starts_find(recorded, touched, caplog):
    data, scene, _ = recorded
    noisy = replace(scene, sigma_position=1e-3, sigma_normal=0.1)
    first = solve_estimate(data.select(range(2)), noisy)
    caplog.set_level("INFO", "tactilenlp")
    solve_estimate(data.select(range(3)), noisy, start=first)
    assert "starts of an update" not in caplog.text


def test_an_estimate_is_read_with_the_cuts_that_it_was_solved_with(asked, estimate):
    job = asked[0].job
    pose = past_solution(job, estimate).window.pose
    within = int(np.flatnonzero(np.diff(pose) == 0)[0]) + 1  # a still span
    cut = past_solution(job, replace(estimate, cuts=(within,))).window
    assert (np.diff(cut.pose) - np.diff(pose)).nonzero()[0].tolist() == [within - 1]


def test_an_update_that_costs_more_asks_for_another_start(asked, estimate):
    request, kept = asked
    (best, *_) = TrackingSearch(request.job, kept, 2).least_motion_optima()
    off = replace(best, theta=best.theta + np.array([5e-3, 0, 0]))
    most = update_limit(estimate, 1) - estimate.objective

    def after(risen, second):
        """Update an estimate that the new action lets rise so far [nats]."""
        start = replace(estimate, objective=ends.solution.objective - risen)
        solves = Solves()
        enough = update_by_few_starts(request.job, start, [best], second, solves)
        return len(solves.ended), enough

    solves = Solves()
    assert update_by_few_starts(request.job, estimate, [best], None, solves)
    (ends,) = solves.ended  # another start was not asked for
    assert after(1.0, lambda: best) == (2, True)  # another start confirms it
    assert after(1.0, lambda: off)[0] == 2
    assert after(2 * most, None) == (1, False)  # no new action costs so much


def test_the_solution_of_the_past_starts_a_problem_of_more_samples(asked, estimate):
    """What was known keeps its values and multipliers; those of the rest are zero."""
    request, kept = asked
    past = past_solution(request.job, estimate)
    (best, *_) = TrackingSearch(request.job, kept, 2).least_motion_optima()
    built = built_page(request.job, best)
    begun = of_more_samples(past, built)
    new = built.window.push.sample >= estimate.measurements.samples
    assert new.any()
    fingers = begun.values["finger"]
    np.testing.assert_array_equal(fingers[:, ~new], past.solution.values["finger"])
    rows = {k: m for k, m in begun.multipliers.items() if k.startswith("finger")}
    assert rows
    for name, multipliers in rows.items():
        assert not multipliers[new].any(), name
        known = past.solution.multipliers[name]
        np.testing.assert_array_equal(multipliers[~new], known)


def test_what_a_search_began_with_is_not_computed_again(asked):
    """First few tracks, then all of them: the same starts as of all at once."""
    request, kept = asked
    job = replace(request.job, reductions=Reductions())
    search = TrackingSearch(job, kept, 4)
    first, solved = search.least_motion_optima(), dict(search.optima)
    starts = search.starts()
    assert all(search.optima[track] is h for track, h in solved.items())
    assert any(first[0] is h for h in starts)
    for mine, once in zip(starts, TrackingSearch(job, kept, 4).starts(), strict=True):
        np.testing.assert_array_equal(mine.x, once.x)
        assert mine.objective == once.objective


def test_only_whole_actions_of_a_good_fit_are_continued(asked, estimate):
    job = asked[0].job
    assert of_whole_actions(estimate, job)
    whole = replace(job, data=estimate.measurements)
    assert not of_whole_actions(estimate, whole)  # nothing is new
    poor = replace(estimate, fit=replace(estimate.fit, verdict="poor"))
    assert not of_whole_actions(poor, job)
    assert not of_whole_actions(replace(estimate, fit=None), job)
    freed = asdict(job.reductions) | {"rigid": False}
    assert not of_whole_actions(replace(estimate, reductions=freed), job)
    part = SimpleNamespace(samples=estimate.measurements.samples - 5)
    assert not of_whole_actions(replace(estimate, measurements=part), job)


def test_an_update_that_time_ends_keeps_what_it_has_solved(asked, estimate):
    """The first start is solved; before the second one, time is over."""
    request, kept = asked
    (best, *_) = TrackingSearch(request.job, kept, 2).least_motion_optima()
    solves, job = Solves(), request.job
    start = replace(estimate, objective=estimate.objective - 1.0)

    def second():
        raise OutOfTime

    with pytest.raises(OutOfTime):
        update_by_few_starts(job, start, [best], second, solves)
    assert len(solves.ended) == 1
    assert solves.ended[0].solution.success


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0.05, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3])
def test_an_update_within_any_time_ends_as_an_estimate(recorded, estimate, limit):
    data, scene, _ = recorded
    found = solve_estimate(
        data.select(range(4)), scene, start=estimate, throw=False,
        options=Options(time_limit=limit),
    )  # fmt: skip
    assert found.position.shape == (124, 3)
    assert np.isfinite(found.objective)


@pytest.mark.parametrize("coefficient", ["friction_ground", "friction_finger"])
def test_an_update_may_be_of_contacts_without_friction(recorded, estimate, coefficient):
    """An impulse has one component then, not three: all actions are solved again."""
    data, scene, _ = recorded
    slippery = replace(scene, **{coefficient: 0.0})
    given = {"start": estimate, "throw": False}
    found = solve_estimate(data.select(range(4)), slippery, **given)
    assert found.measurements.actions == 4
    assert np.isfinite(found.objective)


def test_the_reported_optimum_is_the_first_that_an_update_continues(estimate):
    """By evidence it is the best, though others may have lower objectives."""
    assert np.allclose(estimate.hypotheses[0].theta, estimate.theta, atol=1e-6)
