"""Where `explore` aims next, and when an update is solved from scratch."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_explore import CENTRE, LEAST, fresh

from tactilenlp import (
    Ground,
    Scene,
    Workspace,
    choose_action,
    explore,
)
from tactilenlp.errors import OptionError, StartError
from tactilenlp.exploration.expected_information import (
    ExpectedInformation,
    push_constants,
)
from tactilenlp.exploration.log import check_same
from tactilenlp.exploration.policies import farthest_action, last_contact, why_lost
from tactilenlp.exploration.sweep import check_reach

SAME = LEAST | {"actions": 2, "centre": CENTRE, "seed": 1}


def test_what_was_touched_last_is_sought_again():
    data = SimpleNamespace(
        action=np.zeros(2, int),
        contact=np.array([[True, False], [True, False]]),
        valid=np.ones((2, 2), bool),
        normal=np.array([[[1.0, 0, 0], [0, 0, 0]]] * 2),
        finger_position=np.array([[[0.05, 0.01, 0.03], [9, 9, 9]]] * 2),
        finger_radius=np.array([0.01, 0.01]),
        fingers=2,
    )
    # 10 mm of finger and 15 mm of body behind it, at the height of the guess
    expected, at = [0.025, 0.01, 0.02], np.array([[9.0, 9.0, 0.02]])
    found = SimpleNamespace(measurements=data, position=at, scene=Scene())
    assert np.allclose(last_contact(found), expected)
    # the same on a ground that leans: the way is along it
    turn = Rotation.from_rotvec([0.0, np.radians(40), 0.0])
    leaning = Scene(ground=Ground(normal=tuple(turn.apply([0, 0, 1.0]))))
    turned = SimpleNamespace(
        **vars(data)
        | {
            "normal": turn.apply(data.normal.reshape(-1, 3)).reshape(2, 2, 3),
            "finger_position": turn.apply(data.finger_position.reshape(-1, 3)).reshape(
                2, 2, 3
            ),
        }
    )
    found = SimpleNamespace(measurements=turned, position=turn.apply(at), scene=leaning)
    assert np.allclose(last_contact(found), turn.apply(expected))


def test_a_wrong_boolean_far_from_the_object_is_not_aimed_at(estimate):
    data = estimate.measurements
    contact, normal = data.contact.copy(), data.normal.copy()
    places, last = data.finger_position[:, 0], data.action == data.action[-1]
    away = np.linalg.norm(places - estimate.position, axis=1)
    t = np.argmax(np.where(last, away, 0))
    assert away[t] > 0.06  # [m], farther than the object reaches
    contact[t, 0], normal[t, 0] = True, [1.0, 0.0, 0.0]
    wrong = replace(data, contact=contact, normal=normal)
    noisy = replace(estimate, measurements=wrong)
    assert why_lost(noisy) == why_lost(estimate) == ""
    assert last_contact(noisy) == pytest.approx(last_contact(estimate))
    alone = contact & ~data.contact
    wrong = replace(wrong, contact=alone, normal=normal * alone[..., None])
    missed = replace(estimate, measurements=wrong)
    assert why_lost(missed) == "no contact in the last action"


def judged(estimate, verdict):
    return replace(estimate, fit=replace(estimate.fit, verdict=verdict))


def test_an_estimate_with_a_bad_fit_is_not_aimed_at(estimate):
    assert why_lost(judged(estimate, "poor")) == ""
    assert "badly" in why_lost(judged(estimate, "bad"))


def test_an_exploration_goes_on_until_the_fit_is_good(estimate, monkeypatch):
    """The solver is replaced."""

    def always_poor(data, **_):
        return replace(judged(estimate, "poor"), measurements=data)

    monkeypatch.setattr("tactilenlp.exploration.loop.solve_estimate", always_poor)
    given = {"actions": 2, "policy": "random", "centre": CENTRE, "seed": 1}
    steps = explore(fresh(), until=1.0, **given)
    assert len(list(steps)) == 3  # sigma is below a metre, but no fit is good


def test_farthest_turns_away_from_what_was_tried():
    space, rng = Workspace(), np.random.default_rng(0)
    past = [space.action([0.8, 0.1, 0.8, 0.1])] * 2
    data = SimpleNamespace(measurements=None, position=np.zeros((1, 3)))
    plan = SimpleNamespace(past=past, workspace=space, rng=rng, estimate=data)
    angles = farthest_action(plan).angles
    assert (angles[[0, 2]] < 0.2).all() or (angles[[1, 3]] > 0.9).any()


def test_an_estimate_on_a_ground_that_leans_is_of_the_scene_that_was_told(estimate):
    told = estimate.scene
    ground = told.ground.turned((0.01, -0.02), (0.0, 0.0, 0.0))
    leaning = replace(estimate, scene=replace(told, ground=ground))
    assert leaning.scene != told
    asked = {"scene": told, "shape": "cuboid"}
    check_same(leaning, estimate.measurements, asked, "file")
    other = {"scene": replace(told, mass=2 * told.mass)}
    with pytest.raises(StartError, match="another scene"):
        check_same(leaning, estimate.measurements, other, "file")


def test_an_estimate_that_the_time_limit_ended_first_is_explored_on(estimate):
    """It has the name of the search's page, since its own was not solved."""
    asked = {"formulation": "violation_implicit"}
    ended = replace(estimate, formulation="quasi_static", success=False)
    check_same(ended, estimate.measurements, asked, "file")
    other = replace(estimate, formulation="quasi_static")
    with pytest.raises(StartError, match="another formulation"):
        check_same(other, estimate.measurements, asked, "file")


def test_farthest_compares_normals_in_the_frame_of_the_ground():
    up = Ground(0.0, (0.0, -np.sin(0.6), np.cos(0.6)))
    normal = np.array([[[1.0, 0.0, 0.0], [0.6, 0.0, 0.8]]])
    chosen = []
    for ground, felt in ((Ground(), normal), (up, normal @ up.rotation)):
        data = SimpleNamespace(normal=felt, contact=np.ones((1, 2), bool))
        plan = SimpleNamespace(
            past=[], workspace=Workspace(ground=ground),
            estimate=SimpleNamespace(measurements=data, position=np.zeros((1, 3))),
            rng=np.random.default_rng(0),
        )  # fmt: skip
        chosen.append(farthest_action(plan).angles)
    assert chosen[0] == pytest.approx(chosen[1])


@pytest.mark.parametrize("fingers", [2, 5, 12])
def test_a_finger_that_moves_alone_is_kept_off_by_no_other_one(fingers):
    space = Workspace(fingers=fingers)
    alone = tuple(f == 0 for f in range(fingers))
    target = np.array([0.01, 0.02, 0.03])
    action = space.random(np.random.default_rng(fingers), alone)
    end = action.trajectory(target).finger_position[-1, 0]
    assert end[0] - target[0] == pytest.approx(space.apart)  # on its own side
    assert np.linalg.norm(end - target) < 2 * space.apart


def test_lines_start_outside_a_body_that_is_larger_than_the_workspace(estimate):
    small = Workspace(radius=0.03)
    reach = np.linalg.norm(estimate.vertices, axis=1).max()
    action = choose_action(estimate, small, budget=4).action
    start = action.trajectory(estimate.position[-1]).finger_position[0]
    away = np.linalg.norm(start - estimate.position[-1], axis=1)
    assert away.min() > reach + small.finger_radius
    same = Workspace(radius=0.5)
    assert same.around(reach) == same


def test_a_radius_within_the_sectors_of_many_fingers_is_refused():
    Workspace(fingers=20)
    with pytest.raises(OptionError, match="radius"):
        Workspace(fingers=40)


def test_fingers_and_frictions_of_a_choice_are_those_of_the_estimate(estimate):
    radius = np.array([0.004, 0.009])
    data = replace(estimate.measurements, finger_radius=radius)
    expected = ExpectedInformation(replace(estimate, measurements=data))
    space = expected.workspace
    assert (space.fingers, space.finger_radius) == (2, 0.009)
    found = {"ground friction": np.array([[0.17]]), "finger friction": np.array([0.6])}
    free = replace(estimate.scene, friction_ground=None, friction_finger=None)
    loose = replace(estimate, scene=free, unknowns=estimate.unknowns | found)
    assert push_constants(loose, space)[:2] == pytest.approx([0.17, 0.6])
    told = replace(free, friction_ground=0.3)
    assert push_constants(replace(loose, scene=told), space)[0] == 0.3


def test_a_chosen_action_avoids_an_obstacle_and_none_is_refused(estimate):
    target, free = estimate.position[-1], choose_action(estimate, budget=20).action
    start = free.trajectory(target).finger_position[0, 0]
    post = Workspace(obstacles=[(*(start - 0.01), *(start + 0.01))])
    assert post.action(free.angles).blocked(target)
    other = choose_action(estimate, post, budget=20)
    assert not other.action.blocked(target)
    assert other.history.min() < 0  # what met the post counts as the worst
    walled = Workspace(obstacles=[(*(target - 1), *(target + 1))])
    with pytest.raises(OptionError, match="obstacles"):
        choose_action(estimate, walled, budget=4)


def test_a_sweep_and_a_check_leave_out_what_meets_an_obstacle(estimate):
    told, wall = [], Workspace(obstacles=[(0.02, -1, -1, 1, 1, 1)])
    world = SimpleNamespace(check=lambda t: told.append(t.finger_position[:, 0]))
    check_reach(world, wall, None, None)
    assert told
    assert max(way[:, 0].max() for way in told) <= 0.01
    told.clear()
    check_reach(world, wall, None, estimate)  # the first finger comes from +x
    assert not told
