"""The search for an action: every way of searching, and every trap of nlopt."""

import nlopt
import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import CrossEntropy, Workspace, choose_action
from tactilenlp.errors import OptionError
from tactilenlp.exploration import expected_information as expected
from tactilenlp.exploration import push_model as predict
from tactilenlp.exploration.action_search import best_action, facing
from tactilenlp.exploration.optimisers import SEARCHES

SPACE = Workspace()
PEAK = np.array([0.7, 0.3, -0.4, 0.9])  # [rad] of the bump below


def bump(angles):
    return 10 - 4 * np.linalg.norm(angles - PEAK)


@pytest.mark.parametrize("search", SEARCHES)
def test_every_search_spends_its_budget_stays_inside_and_comes_near(search):
    choice = best_action(bump, SPACE, search=search, budget=180, seed=3)
    assert choice.evaluations == len(choice.history) == len(choice.tried) == 180
    assert (choice.tried >= SPACE.lower).all()
    assert (choice.tried <= SPACE.upper).all()
    assert choice.gain == pytest.approx(bump(choice.action.angles))
    # a draw of 180 is within 0.6 rad of a peak in nine of ten draws
    assert choice.gain > 7.0
    if search not in ("cem",):  # which draws one of the last best
        assert choice.gain == choice.history.max()


@pytest.mark.parametrize("search", SEARCHES)
def test_equal_seeds_give_equal_choices_whatever_ran_before(search):
    first = best_action(bump, SPACE, search=search, budget=60, seed=5)
    best_action(bump, SPACE, search="crs2", budget=37, seed=1)
    again = best_action(bump, SPACE, search=search, budget=60, seed=5)
    assert np.array_equal(first.tried, again.tried)


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_gain_that_is_no_number_is_worst_and_stops_nothing(search, bad):
    def holed(angles):
        return bad if angles[0] > 0.9 else bump(angles)

    choice = best_action(holed, SPACE, search=search, budget=60, seed=0)
    assert choice.evaluations == 60
    assert np.isfinite(choice.history).all()
    assert choice.action.angles[0] <= 0.9


@pytest.mark.parametrize("search", SEARCHES)
def test_what_was_tried_is_copied_out_of_the_buffer_of_nlopt(search):
    seen = []
    choice = best_action(
        lambda a: seen.append(a) or bump(a), SPACE, search=search, budget=40, seed=0
    )
    assert len(np.unique(np.round(seen, 12), axis=0)) > 20
    assert np.array_equal(seen, choice.tried)


@pytest.mark.parametrize("search", SEARCHES)
def test_a_plateau_ends_in_some_action(search):
    choice = best_action(lambda a: 1, SPACE, search=search, budget=50, seed=0)
    assert choice.gain == 1.0
    assert isinstance(choice.gain, float)
    assert choice.evaluations == (48 if search == "cem" else 50)  # 3 x 16


@pytest.mark.parametrize("search", ["direct", "bobyqa", "mlsl"])
def test_a_best_action_on_the_bounds_is_found_though_rounding_leaves_them(search):
    choice = best_action(lambda a: a.sum(), SPACE, search=search, budget=180, seed=0)
    assert choice.gain > SPACE.upper.sum() - 0.3
    assert (choice.action.angles <= SPACE.upper).all()


@pytest.mark.parametrize("search", SEARCHES)
def test_an_error_in_the_gain_is_not_swallowed(search):
    def broken(angles):
        raise ZeroDivisionError("a bug")

    with pytest.raises(ZeroDivisionError, match="a bug"):
        best_action(broken, SPACE, search=search, budget=20)


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("fingers", [1, 3])
def test_the_least_budgets_are_spent_whatever_the_dimension(search, fingers):
    space = Workspace(fingers=fingers)
    for budget in (2, 3, 5):
        given = {"search": search, "budget": budget}
        choice = best_action(lambda a: -np.abs(a).sum(), space, **given)
        # cross-entropy takes as many samples in each of its iterations
        left = budget - choice.evaluations
        assert left in ((0, 1) if search == "cem" else (0,))


@pytest.mark.parametrize("search", [s for s in SEARCHES if s not in ("cem", "random")])
def test_what_was_tried_counts_though_rounding_stops_a_search(search, monkeypatch):
    class Limited(nlopt.opt):
        def optimize(self, start):
            super().optimize(start)
            raise nlopt.RoundoffLimited

    monkeypatch.setattr(nlopt, "opt", Limited)
    choice = best_action(bump, SPACE, search=search, budget=60, seed=0)
    assert choice.evaluations == 60
    assert choice.gain == choice.history.max() == bump(choice.action.angles)


@pytest.mark.parametrize("search", ["facing", "direct", "direct_l"])
def test_a_start_beyond_the_bounds_by_rounding_is_moved_inside(search):
    corner = np.array([SPACE.upper[:2], SPACE.upper[2:]]) + 1e-7
    near = [angles[None] for angles in corner]
    given = {"search": search, "budget": 40, "facing": near}
    choice = best_action(lambda a: a.sum(), SPACE, **given)
    assert choice.gain == pytest.approx(SPACE.upper.sum())
    assert (choice.tried <= SPACE.upper).all()


def test_cross_entropy_takes_the_options_of_the_paper():
    search = CrossEntropy(samples=20, best=4, iterations=2)
    ranks = set()
    for seed in range(8):
        choice = best_action(bump, SPACE, search=search, seed=seed)
        assert choice.evaluations == 40
        ranks.add(int((choice.history[20:] > choice.gain).sum()))
    assert len(ranks) > 1  # one of the best four is drawn, not the best
    assert ranks <= {0, 1, 2, 3}
    with pytest.raises(OptionError, match="best <= samples"):
        CrossEntropy(samples=3, best=5)
    for name in ("samples", "best", "iterations"):
        with pytest.raises(OptionError, match="out of range"):
            CrossEntropy(**{name: 10**5000})


def test_a_search_that_is_none_names_those_there_are():
    with pytest.raises(OptionError, match="direct_l"):
        best_action(bump, SPACE, search="adam")
    with pytest.raises(OptionError, match="budget"):
        best_action(bump, SPACE, budget=0)


def test_a_finger_can_face_every_corner_edge_and_face_on_its_side(estimate):
    right, left = facing(estimate, SPACE)
    for angles in (right, left):
        assert (angles >= SPACE.lower[:2]).all()
        assert (angles <= SPACE.upper[:2]).all()
    # of a box that lies: on each side at least one face and corner, above one another
    assert len(right) >= 4
    arms = estimate.vertices @ estimate.rotation().T
    heights = np.arcsin(arms[:, 2] / np.linalg.norm(arms, axis=1))
    assert np.isclose(right[:, 1, None], heights[heights > 0]).any()
    assert np.isclose(right[:, 1], 0).any()
    one = facing(estimate, Workspace(fingers=1))[0]
    assert len(one) > len(right)


def test_facing_the_body_finds_what_the_search_of_the_paper_does_not(estimate):
    chosen = choose_action(estimate, budget=60)
    assert chosen.search == "facing"
    assert chosen.gain > choose_action(estimate, search="cem", budget=180).gain


def test_actions_that_face_the_body_come_first_and_the_best_are_polished(estimate):
    near = facing(estimate, SPACE)
    choice = best_action(bump, SPACE, budget=100, facing=near)
    pairs = {(*a, *b) for a in near[0] for b in near[1]}
    faced = [tuple(angles) in pairs for angles in choice.tried]
    first = min(40, len(pairs))  # four tenths, or all that there are
    assert all(faced[:first])
    # the first local search begins where facing scored most
    begun = choice.tried[first : first + 2]
    assert choice.tried[choice.history[:first].argmax()] == pytest.approx(begun[0])
    assert choice.gain > choice.history[:first].max() + 0.5


def test_a_choice_takes_so_many_operations_at_most(estimate, monkeypatch):
    """Of 0.6 s at 2 ns an operation; 1.3e8 with three hypotheses, .15 to .5 s."""
    steps, real = [], expected.push_function
    monkeypatch.setattr(
        expected, "push_function", lambda *a: steps.append(a[3]) or real(*a)
    )
    choice = choose_action(estimate)
    assert choice.evaluations == 180
    assert choice.gain == choice.history.max() > 1
    assert len(steps) <= 3 * 180
    monkeypatch.setattr(predict, "compiled", lambda functions: functions)
    step = predict.step_function.__wrapped__(CUBOID, False, 2, False)
    assert sum(steps) * step.n_instructions() < 3e8
