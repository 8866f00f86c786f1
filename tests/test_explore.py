"""The loop: touch, estimate, choose, touch again; stop, resume, and get lost."""

import json
from dataclasses import replace

import numpy as np
import pytest
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp import (
    Action,
    Exploration,
    Measurements,
    Options,
    Workspace,
    World,
    explore,
    solve_estimate,
    surface_distance,
)
from tactilenlp.errors import OptionError, StartError
from tactilenlp.exploration.policies import why_lost

CENTRE = (0.01, -0.01)  # [m] of the box below
SIDES = (0.05, 0.035, 0.04)
QUICK = {"options": Options(hypotheses=2, starts=3), "budget": 40}
LEAST = QUICK | {"formulation": "quasi_static"}  # what is solved does not matter here
SAME = LEAST | {"actions": 2, "centre": CENTRE, "seed": 2}


def fresh(**changes):
    given = {"position": CENTRE, "quaternion": [np.cos(0.2), 0, 0, np.sin(0.2)]}
    return World(SIDES, **given | changes)


def off(world, estimate):
    """Return the mean surface distance [m] when the last action ended."""
    true, sides = world.truth, box(world.side_lengths)
    place = translation_matrix(true.object_position[-1])
    sides.apply_transform(place @ quaternion_matrix(true.object_quaternion[-1]))
    return surface_distance(estimate.mesh(), sides, samples=300).mean


class Recorder:
    """A world that counts, and can be switched off."""

    def __init__(self, world, left=np.inf):
        self.world, self.left, self.trajectories = world, left, []
        self.finger_radius = world.finger_radius

    def execute(self, trajectory):
        if self.left <= 0:
            raise ConnectionError("the robot went away")
        self.left -= 1
        self.trajectories.append(trajectory)
        return self.world.execute(trajectory)


@pytest.fixture(scope="module")
def whole():
    """Three steps of an uninterrupted exploration, and its world."""
    world = Recorder(fresh())
    return list(explore(world, **SAME)), world


def test_a_few_chosen_actions_find_the_box(whole):
    steps, _ = whole
    assert [s.number for s in steps] == [0, 1, 2]
    assert [s.policy for s in steps] == ["first touch", "eig", "eig"]
    assert [s.estimate.measurements.actions for s in steps] == [1, 2, 3]
    assert not steps[0].measurements.valid[:, 1].any()  # one finger touches first
    assert steps[2].choice.gain > 1
    assert {"choose", "act", "estimate"} == steps[2].seconds.keys()
    assert steps[2].errors == {}  # a Recorder tells no truth


@pytest.mark.slow
def test_an_exploration_of_a_world_with_a_truth_has_errors(whole):
    steps, _ = whole
    world = fresh()
    again = list(explore(world, **SAME))
    # the truth judges, and decides nothing
    assert np.array_equal(again[2].action.angles, steps[2].action.angles)
    assert again[2].errors["surface"] == pytest.approx(
        off(world, again[2].estimate), rel=0.05
    )
    assert again[0].errors["surface"] > again[2].errors["surface"]


@pytest.mark.slow
def test_an_exploration_that_was_interrupted_goes_on_without_losing_an_action(
    whole, tmp_path
):
    steps, _ = whole
    world, file = Recorder(fresh(), left=2), tmp_path / "exploration.npz"
    with pytest.raises(ConnectionError):
        for _ in explore(world, file=file, **SAME):
            pass
    left = Exploration.load(file)
    lost = replace(left.at(1), estimate=None)  # stopped while it was solved
    left.with_step(lost).save(file)
    world.left = 1
    again = list(explore(world, file=file, **SAME))
    assert len(world.trajectories) == 3
    assert again[-1].estimate.measurements == steps[-1].estimate.measurements
    assert np.array_equal(again[-1].estimate.theta, steps[-1].estimate.theta)
    assert np.array_equal(again[1].action.angles, steps[1].action.angles)
    from_disk = list(explore(None, file=file, workspace=Workspace(), **SAME))
    assert from_disk[-1].estimate.objective == steps[-1].estimate.objective


def first(data, count):
    """Return the first samples of an action, as they come in while it runs."""
    names = "time", "finger_position", "contact", "normal", "action", "valid"
    given = {name: getattr(data, name)[:count] for name in names}
    return Measurements(**given, finger_radius=data.finger_radius)


@pytest.mark.slow
def test_samples_can_be_appended_while_an_action_still_runs(whole):
    steps, _ = whole
    given = {"options": QUICK["options"], "formulation": "quasi_static"}
    before, action = steps[1].estimate, steps[2].measurements
    so_far = before.measurements.append(first(action, action.samples // 2))
    now = solve_estimate(so_far, start=before, **given)
    assert len(now.position) == so_far.samples
    data = before.measurements.append(action)
    ended = solve_estimate(data, start=before, **given)
    # what was looked at meanwhile has changed nothing
    assert np.array_equal(ended.theta, steps[2].estimate.theta)
    # a look in the middle is a start as well: that action is fitted anew
    on = solve_estimate(data, start=now, **given)
    assert on.measurements == ended.measurements
    assert on.success
    assert on.objective == pytest.approx(ended.objective, abs=0.5)
    assert on.side_lengths == pytest.approx(ended.side_lengths, abs=1e-3)
    # the second action hardly touches one of the upright sides
    order = np.argsort(on.side_lengths[:2])
    off = on.side_lengths[[*order, 2]] - (*sorted(SIDES[:2]), SIDES[2])
    sigma = on.information.sigma("side_lengths")[[*order, 2]]
    assert (np.abs(off) < np.maximum(5e-3, 2 * sigma)).all()


def test_samples_can_be_appended_while_the_first_touch_still_runs(whole):
    steps, _ = whole
    given = {"options": QUICK["options"], "formulation": "quasi_static"}
    touch = steps[0].measurements
    start = np.flatnonzero(touch.contact.any(axis=1))[0]
    so_far = first(touch, start + (touch.samples - start) // 2)
    now = solve_estimate(so_far, **given)
    ended = solve_estimate(touch, start=now, **given)
    assert ended.objective == pytest.approx(steps[0].estimate.objective, abs=0.05)


def test_a_file_of_another_exploration_is_refused(whole, tmp_path):
    steps, _ = whole
    mixed = replace(steps[0], estimate=steps[1].estimate)
    Exploration((mixed,)).save(tmp_path / "mixed.npz")
    with pytest.raises(StartError, match="other data"):
        next(explore(None, file=tmp_path / "mixed.npz", workspace=Workspace()))


def test_an_exploration_is_one_file_that_is_read_without_us(whole, tmp_path):
    """As README.md says: numpy, json, and the names of the fields."""
    steps, _ = whole
    Exploration(tuple(steps)).save(tmp_path / "exploration.npz")
    with np.load(tmp_path / "exploration.npz") as file:
        header = json.loads(str(file["header"]))
        assert header["format"] == "exploration"
        kept = [s["fields"] for s in header["content"]["fields"]["steps"]["list"]]
        assert [k["policy"] for k in kept] == [s.policy for s in steps]
        felt = kept[1]["measurements"]["fields"]["contact"]["array"]
        assert np.array_equal(file[felt], steps[1].measurements.contact)
        angles = kept[1]["action"]["fields"]["angles"]["array"]
        assert np.array_equal(file[angles], steps[1].action.angles)
    again = Exploration.load(tmp_path / "exploration.npz")
    assert again.estimate.objective == steps[-1].estimate.objective
    assert again.steps[2].choice.gain == steps[2].choice.gain
    assert again.steps[2].seconds == steps[2].seconds
    assert again.steps[2].errors == steps[2].errors
    told = again.steps[1].told[0].finger_position
    assert np.array_equal(told, steps[1].told[0].finger_position)


def test_exploration_ends_when_enough_is_known(whole, tmp_path):
    steps, _ = whole
    Exploration(tuple(steps)).save(tmp_path / "exploration.npz")
    kept = {"file": tmp_path / "exploration.npz", "workspace": Workspace()}
    for last in (0, 1):
        few = explore(None, until=lambda s, last=last: s.number == last, **kept, **SAME)
        assert len(list(few)) == last + 1
    loose = list(explore(fresh(), until=0.1, **SAME))
    assert len(loose) == 1
    assert np.array_equal(loose[0].estimate.theta, steps[0].estimate.theta)


def test_exploration_goes_on_until_the_last_size_is_as_sure_as_wanted(whole, tmp_path):
    steps, _ = whole
    Exploration(tuple(steps)).save(tmp_path / "exploration.npz")
    kept = {"file": tmp_path / "exploration.npz", "workspace": Workspace()}
    sure = [s.estimate.information.sigma("side_lengths").max() for s in steps]
    assert min(sure[1:]) < sure[0]
    for wanted in sorted({1.01 * s for s in sure} | {1e-6}):
        took = len(list(explore(None, until=wanted, **kept, **SAME)))
        enough = [k + 1 for k, s in enumerate(sure) if s <= wanted]
        assert took == min(enough, default=3)


@pytest.mark.slow
def test_a_guess_wholly_outside_the_object_recovers(whole):
    """The estimate is 7 cm off: what was touched says where to go."""
    steps, _ = whole
    wrong, shift = steps[0].estimate, np.array([0.0, 0.07, 0.0])
    astray = replace(
        wrong, position=wrong.position + shift,
        unknowns=wrong.unknowns
        | {"x": wrong.unknowns["x"] + shift[:, None]},
        hypotheses=tuple(
            replace(h, x=h.x + shift[:, None]) for h in wrong.hypotheses
        ),
    )  # fmt: skip
    world = fresh()
    first = Action(steps[0].action.angles, Workspace(), steps[0].action.active)
    world.execute(first.trajectory(np.r_[CENTRE, 0.02]))
    found = list(explore(world, actions=2, start=astray, seed=0, **QUICK))
    assert [s.policy for s in found] == ["last contact", "eig"]
    assert found[0].measurements.contact.any()
    # 45 mm wide where nothing was felt: found is what is a few millimetres off
    assert off(world, found[-1].estimate) < 4e-3


def test_an_action_without_contact_is_data_and_what_was_touched_is_sought_again(whole):
    steps, world = whole
    later, wide = Recorder(fresh()), Workspace(gap=0.09)  # fingers stay apart
    later.execute(world.trajectories[0])

    def timid(plan):
        return wide.action([0.0, 0.2, 0.0, 0.2])

    given = {"start": steps[0].estimate, "policy": timid}
    missed, found = explore(later, actions=2, **given, **LEAST)
    assert not missed.measurements.contact.any()
    assert missed.policy == "timid"
    assert missed.estimate.measurements.actions == 2
    assert found.policy == "last contact"
    assert found.measurements.contact.any()


def test_an_estimate_apart_from_what_was_touched_is_not_aimed_at(whole):
    estimate = whole[0][1].estimate
    assert why_lost(estimate) == ""
    far = replace(estimate, position=estimate.position + np.r_[0.08, 0, 0])
    assert "not where the last contact was" in why_lost(far)


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["random", "fisher", "farthest"])
def test_the_other_policies_act_too(whole, policy):
    steps, world = whole
    later = Recorder(fresh())
    later.execute(world.trajectories[0])
    given = {"start": steps[0].estimate, "policy": policy}
    (step,) = explore(later, actions=1, **given, **LEAST)
    assert step.policy == policy
    assert (step.choice is not None) == (policy == "fisher")
    assert step.estimate.measurements.actions == 2


def test_a_policy_of_ones_own_is_given_a_plan(whole):
    steps, world = whole
    later, seen = Recorder(fresh()), []
    later.execute(world.trajectories[0])

    def squeeze(plan):
        seen.append(plan)
        return plan.workspace.action([0.0, 0.2, 0.0, 0.2])

    given = {"start": steps[0].estimate, "policy": squeeze}
    (step,) = explore(later, actions=1, **given, **LEAST)
    assert step.policy == "squeeze"
    assert seen[0].estimate is steps[0].estimate
    with pytest.raises(OptionError, match="farthest"):
        next(explore(later, policy="best"))


@pytest.mark.slow
def test_every_estimate_is_of_the_likeliest_class_of_a_list(tmp_path):
    file = tmp_path / "classes.npz"
    given = LEAST | {"actions": 1, "centre": CENTRE, "seed": 1}
    given |= {"shape": ["cuboid", "cylinder"], "policy": "random"}
    steps = list(explore(fresh(), file=file, **given))
    for step in steps:
        assert {c.shape for c in step.estimate.classes} == {"cuboid", "cylinder"}
    again = list(explore(fresh(), file=file, **given))
    assert [s.estimate.shape for s in again] == [s.estimate.shape for s in steps]
    with pytest.raises(StartError, match="another shape"):
        list(explore(fresh(), file=file, **given | {"shape": "ellipsoid"}))
