"""Hypotheses race: what ends alike is solved once, a past is followed backward."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations import quasi_static
from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import Noise, Options
from tactilenlp.data.noise_model import add_noise
from tactilenlp.data.sensor_noise import precision_of
from tactilenlp.estimation.request import make_job
from tactilenlp.search import alternatives as rivals
from tactilenlp.search.alternatives import (
    MIN_JUMP,
    _needs_alternatives,
    first_half,
    jumps,
    smoothed_backward,
    with_alternatives,
    without_longest_jump,
)
from tactilenlp.search.hypothesis import Hypothesis, distinct, same
from tactilenlp.search.local_solve import continued, freed_levels
from tactilenlp.search.margins import EXPLAINED
from tactilenlp.search.multistart import multistart

LEVELS = freed_levels(page.LEVELS, final=True)


@pytest.fixture(scope="module")
def case(recorded):
    """Two actions of the shipped recording, and the true motion as a hypothesis."""
    from tactilenlp import solve_estimate

    data, scene, _ = recorded
    data = data.select(range(2))
    estimate = solve_estimate(data, scene, options=Options(rivals=False))
    job = make_job(data, scene, CUBOID, Options(), time.monotonic(), page)
    return job, estimate.hypotheses[0]


def pushed(h, way):
    """Return the hypothesis with all poses moved by way [m]."""
    return replace(h, x=h.x + np.array([[way], [0.0], [0.0]]))


def test_hypotheses_that_come_together_are_solved_to_the_end_once(case):
    job, h = case
    solved = multistart(
        job, page, [h, pushed(h, 1e-3), pushed(h, -1e-3)], Options(), LEVELS
    )
    assert len(solved) == 1
    assert solved[0].solution.success
    assert len(solved[0].solution.iterations_by_level) == len(LEVELS)
    alone = multistart(job, page, [h], Options(), LEVELS)
    assert solved[0].solution.objective == pytest.approx(
        alone[0].solution.objective, abs=0.3
    )


def test_what_is_known_or_hopeless_is_not_solved_to_the_end(case):
    job, h = case
    known = multistart(job, page, [h], Options(), LEVELS)
    assert (
        multistart(job, page, [pushed(h, 5e-4)], Options(), LEVELS, known=known) == []
    )
    # A known one that costs 100 nats less than anything: nothing comes near it.
    cheap = replace(known[0].solution, objective=h.objective - 100)
    lucky = replace(known[0], solution=cheap, rough=None)
    far = pushed(h, 30e-3)
    assert multistart(job, page, [far], Options(), LEVELS, known=[lucky]) == []


def test_levels_that_hold_poses_are_solved_one_by_one(case):
    job, h = case
    kept = []
    solved = multistart(job, page, [h, h], Options(), page.LEVELS, solved=kept)
    assert len(solved) == len(kept) == 2


@pytest.mark.slow
def test_a_past_that_jumps_is_followed_backward_without_the_jump(recorded):
    from tactilenlp import solve_estimate

    data, scene, _ = recorded
    data = data.select(range(4))
    job = make_job(data, scene, CUBOID, Options(), time.monotonic(), page)
    h = solve_estimate(data, scene, options=Options(rivals=False)).hypotheses[0]
    start = int(np.argmax(data.action == np.unique(data.action)[first_half(4)]))
    jumped = h.x.copy()
    jumped[:2, :start] += 8e-3  # the object was 11 mm off before the third action

    class Solved:
        at = replace(h, x=jumped)

    assert without_longest_jump(job, [Solved])
    for path in without_longest_jump(job, [Solved]):
        assert jumps(data, path.x)[first_half(4) - 1] < MIN_JUMP
    pasts = smoothed_backward(job, [Solved])
    for past in pasts:
        np.testing.assert_array_equal(past.x[:, start:], h.x[:, start:])
        link = np.linalg.norm(past.x[:2, start] - past.x[:2, start - 1])
        assert link < 1e-3
        off = np.linalg.norm((past.x - h.x)[:2, :start], axis=0)
        assert np.median(off) < 4e-3  # least motion alone is some millimetres off
    turned = [np.abs(np.diff(past.x[2, :start])).sum() for past in pasts]
    assert turned == sorted(turned, reverse=True)  # the less readily, the less


@pytest.mark.parametrize("way", [(1.5e-3, 0.0), (0.0, 5.0)], ids=["mm", "degrees"])
def test_a_small_jump_is_worth_a_rival_where_fingers_are_precise(case, way):
    job, h = case
    start = int(np.argmax(job.data.action == 1))
    jumped = h.x.copy()
    jumped[:, start:] += np.array([[way[0]], [0.0], [np.radians(way[1])]])

    class Solved:
        at = replace(h, x=jumped)

    assert without_longest_jump(job, [Solved])
    noisy = replace(job, precision=replace(job.precision, position=1e-3))
    assert without_longest_jump(noisy, [Solved]) == []


def test_continuation_ends_in_an_optimum_of_the_page(case):
    job, h = case
    solved = multistart(job, page, [h], Options(), LEVELS)
    again = continued(job, page, solved[0], Options())
    assert again.solution.success
    assert again.solution.parameters == solved[0].solution.parameters
    assert again.solution.objective < solved[0].solution.objective + 0.5


def test_a_page_without_easier_levels_has_no_continuation(case):
    assert continued(case[0], quasi_static, None, Options()) is None


def test_a_path_without_jumps_is_left_alone(case):
    job, h = case

    class Solved:
        at = h

    assert without_longest_jump(job, [Solved]) == []


def test_two_pasts_that_end_alike_are_one_where_only_the_end_counts(case):
    _, h = case
    x = h.x.copy()
    x[0, :-1] += 5e-3
    other = replace(h, x=x, objective=h.objective + 1)
    assert not same(CUBOID, h, other)
    assert same(CUBOID, h, other, samples=(-1,))
    assert len(distinct(CUBOID, [h, other], 4)) == 2
    assert distinct(CUBOID, [other, h], 4, samples=(-1,)) == [h]


def test_what_explains_all_that_precise_fingers_felt_has_no_other_past(
    case, monkeypatch
):
    job, h = case
    at = multistart(job, page, [h], Options(), LEVELS)[0]
    asked = []
    monkeypatch.setattr(rivals, "smoothed_backward", lambda *_: asked.append(1) or [])
    monkeypatch.setattr(rivals, "alternative_sizes", lambda *_: [])
    monkeypatch.setattr(rivals, "continued", lambda *_: None)
    for objective in (1.0, 2.0):
        solution = replace(at.solution, objective=objective)
        with_alternatives(job, page, [replace(at, solution=solution)], Options())
        assert len(asked) == (objective > EXPLAINED * job.data.actions)
    noisy = replace(job, precision=replace(job.precision, position=1e-3))
    with_alternatives(noisy, page, [replace(at, solution=solution)], Options())
    assert len(asked) == 2


def test_an_update_asks_for_another_past_where_its_objective_rises(recorded):
    data = recorded[0]
    noisy = add_noise(data, Noise(position=1e-3, seed=0))
    start = SimpleNamespace(objective=1.0, measurements=data.select(range(3)))

    def asks(data, actions, objective):
        part = data.select(range(actions))
        job = SimpleNamespace(data=part, precision=precision_of(part))
        solution = SimpleNamespace(objective=objective, success=True)
        return _needs_alternatives(job, SimpleNamespace(solution=solution), start)

    assert asks(data, 4, 2.0)
    assert not asks(data, 4, 1.2)
    assert not asks(noisy, 4, 30.0)  # noise lifts it, and three have the same middle
    assert asks(noisy, 5, 30.0)


def test_free_bodies_are_the_same_where_their_corners_agree_whatever_the_axes():
    quarter = np.array([0.0, 0.0, 0.02, 0.0, 0.0, np.pi / 2])  # [m, rad] about z
    box = Hypothesis(np.r_[0.03, 0.05, 0.04], np.zeros((6, 2)), 0.0, ())
    box.x[2] = 0.02
    relabelled = replace(
        box, theta=np.r_[0.05, 0.03, 0.04], x=np.repeat(quarter[:, None], 2, axis=1)
    )
    assert same(CUBOID, box, relabelled)
    assert not same(CUBOID, box, replace(relabelled, theta=box.theta))
