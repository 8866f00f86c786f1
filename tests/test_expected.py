"""What an action is expected to tell: never negative, in any units, whatever labels."""

from dataclasses import replace

import numpy as np
import pytest
from believed import BOX, SPACE, VAGUELY, actions, believed, known, measured

from formulations.shape import CUBOID
from tactilenlp import (
    ExpectedInformation,
    Ground,
    Scene,
    Workspace,
    World,
    choose_action,
    expected_information_gain,
    explore,
    information_gain,
    solve_estimate,
)
from tactilenlp.errors import OptionError, SceneError, TactileError


@pytest.mark.parametrize("slopes", ["motion", "identity"])
def test_no_action_is_expected_to_lose_information(slopes):
    expected = ExpectedInformation(BOX, SPACE, slopes=slopes)
    for action in actions(40):
        F = expected.prospect(action).information
        assert np.linalg.eigvalsh(F).min() >= -1e-9 * np.abs(F).max()
        assert expected.gain(action) >= 0


def test_what_two_actions_tell_is_what_one_tells_and_then_the_other():
    expected, known = ExpectedInformation(BOX, SPACE), BOX.information.matrix
    a, b = (expected.prospect(action).information for action in actions(2))
    both = information_gain(known, a + b)
    assert both == pytest.approx(
        information_gain(known, a) + information_gain(known + a, b), abs=1e-9
    )


def test_information_does_not_depend_on_units():
    F = ExpectedInformation(BOX, SPACE).prospect(actions(1)[0]).information
    known = BOX.information.matrix
    D = np.diag([1e-3, 1e-3, 1e-3, 1e-2, 1e3, 180 / np.pi])
    assert information_gain(D @ known @ D, D @ F @ D) == pytest.approx(
        information_gain(known, F), abs=1e-9
    )


def test_a_gain_is_half_the_logarithm_of_what_variances_shrink_by():
    known, told = np.diag([4.0, 1.0]), np.diag([12.0, 0.0])
    assert information_gain(known, told) == pytest.approx(np.log(2))
    with pytest.raises(TactileError, match="positive"):
        information_gain(-np.eye(2), np.eye(2) * 3)


def test_relabelled_axes_of_the_same_body_gain_the_same():
    swap = [1, 0, 2, 3, 4, 5]
    sides, x = np.array([0.05, 0.04, 0.03]), np.array([0.01, -0.02, 0.3])
    turned = believed(
        sides[swap[:3]], x + np.r_[0, 0, np.pi / 2], np.array(VAGUELY)[swap]
    )
    half = believed(sides, x + np.r_[0, 0, np.pi], VAGUELY)
    for action in actions(10):
        gain = ExpectedInformation(BOX, SPACE).gain(action)
        for same in (turned, half):
            other = ExpectedInformation(same, SPACE).gain(action)
            assert other == pytest.approx(gain, rel=1e-5)


def test_where_the_object_lies_does_not_matter():
    moved = believed([0.05, 0.04, 0.03], [0.31, 0.18, 0.3], VAGUELY)
    for action in actions(5):
        assert expected_information_gain(moved, action) == pytest.approx(
            expected_information_gain(BOX, action), rel=1e-6
        )


def test_an_action_that_meets_nothing_tells_next_to_nothing():
    robot = Workspace(radius=0.1, gap=0.09)  # fingers stay 55 mm off the centre plane
    far = expected_information_gain(BOX, robot.action([0.1, 0.1, 0.1, 0.1]))
    near = expected_information_gain(BOX, SPACE.action([0.1, 0.1, 0.1, 0.1]))
    assert 0 <= far < 0.01 < 1 < near


@pytest.mark.slow
def test_the_prediction_agrees_with_a_simulation_of_the_same_body():
    """Contacts sample by sample; the way of the body to a few millimetres."""
    rng, off, wrong, felt = np.random.default_rng(5), [], 0, 0
    for _ in range(5):
        yaw, sides = rng.uniform(-np.pi, np.pi), rng.uniform(0.03, 0.06, 3)
        turn = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        world = World(sides, position=rng.uniform(-0.02, 0.02, 2), quaternion=turn)
        body = believed(sides, [*world.pose[:2], yaw], VAGUELY)
        action = SPACE.random(rng)
        expected = ExpectedInformation(body, SPACE)
        prospect = expected.prospect(action)
        world.execute(action.trajectory(expected.target))
        way = world.truth.object_position[-1] - world.truth.object_position[0]
        off.append(np.linalg.norm(prospect.motion[-1, :2] - way[:2]))
        contact = world.truth.contact[1:]
        wrong += ((prospect.contact > 0.5) != contact).sum()
        felt += contact.sum()
    assert np.median(off) < 3e-3  # 1.6 mm measured, over a way of 15 mm
    assert wrong < 0.1 * felt  # 0.8 of 23 samples an action measured


@pytest.fixture(scope="module")
def left_and_top():
    """A box that was touched on the left, on top, in front and behind."""
    sides = np.array([0.05, 0.04, 0.04])
    world, data = World(sides), None
    lines = [
        ([0, 0, 0.0, 0.1], (False, True)),  # the finger of -X: the left face
        ([1.25, 0.1, 1.25, 0.1], (True, True)),  # front and back
        ([0.2, 1.25, 0, 0], (True, False)),  # the top
    ]
    for angles, active in lines:
        action = SPACE.action(angles, active)
        new = world.execute(action.trajectory(world.pose[:3]))
        data = new if data is None else data.append(new)
    return solve_estimate(data, Scene()), world.pose


@pytest.mark.slow
def test_with_left_and_top_touched_the_unseen_right_side_gains_most(left_and_top):
    estimate, pose = left_and_top
    yaw, alone = 2 * np.arctan2(pose[6], pose[3]), Workspace(fingers=1)

    def gain(angle, declination=0.1):
        angle = (angle + np.pi) % (2 * np.pi) - np.pi
        return expected_information_gain(estimate, alone.action([angle, declination]))

    names = ("right", "back", "left", "front")
    side = {n: gain(yaw + k * np.pi / 2) for k, n in enumerate(names)}
    side["top"] = gain(yaw, 1.25)
    assert max(side, key=side.get) == "right", side
    assert side["right"] > 1.5 * max(v for k, v in side.items() if k != "right")
    best = choose_action(estimate, alone, budget=100).action.directions[0, :2]
    # From the right: within 60 degrees seen from above.
    assert best @ [np.cos(yaw), np.sin(yaw)] > 0.5 * np.linalg.norm(best)


def test_ice_is_pushed_as_far_as_the_finger_goes_and_a_floating_body_is_refused():
    ice = known(**vars(BOX) | {"scene": Scene(friction_ground=0.0)})
    gains = [ExpectedInformation(ice, SPACE).gain(action) for action in actions(5)]
    assert np.isfinite(gains).all()
    floating = Scene(ground=None, gravity=0.0)
    with pytest.raises(SceneError, match=r"ground.*random"):
        ExpectedInformation(known(**vars(BOX) | {"scene": floating}), SPACE)


def test_options_that_are_none_are_refused():
    with pytest.raises(OptionError, match="identity"):
        ExpectedInformation(BOX, slopes="none")
    with pytest.raises(OptionError, match="hypotheses"):
        ExpectedInformation(BOX, hypotheses=0)


def test_a_shape_without_inertia_is_refused_in_words():
    massless = replace(CUBOID, inertia=None)
    with pytest.raises(OptionError, match="actions are not predicted for this shape"):
        ExpectedInformation(BOX, shape=massless)
    with pytest.raises(OptionError, match=r"shape.*cuboid.*got bowl"):
        ExpectedInformation(BOX, shape=replace(CUBOID, name="bowl"))


def test_an_action_is_sampled_as_often_as_the_record():
    """Three times the samples of one push tell nearly three times as much."""
    fast = known(**vars(BOX) | {"measurements": measured(1 / 90)})
    action = SPACE.action([0.1, 0.1, 0.1, 0.1])
    slow, fast = (ExpectedInformation(e, SPACE).prospect(action) for e in (BOX, fast))
    assert (len(slow.motion), len(fast.motion)) == (30, 90)
    assert fast.motion[-1, :2] == pytest.approx(slow.motion[-1, :2], abs=1e-3)
    assert fast.contact.sum() == pytest.approx(3 * slow.contact.sum(), rel=0.15)


@pytest.mark.parametrize("wrong", [np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_what_is_no_information_is_refused(wrong):
    with pytest.raises(TactileError, match="not positive definite"):
        information_gain(wrong, np.eye(3))
    with pytest.raises(TactileError, match="not positive definite"):
        information_gain(np.eye(3), np.full((3, 3), np.inf))


def test_a_workspace_on_another_ground_or_of_smaller_fingertips_is_refused():
    """Fingers would meet the ground: lines end at its height, and by their radius."""
    with pytest.raises(OptionError, match="another ground"):
        ExpectedInformation(BOX, Workspace(ground=Ground(height=0.3)))
    with pytest.raises(OptionError, match="smaller fingertips"):
        choose_action(BOX, Workspace(finger_radius=0.005))
    world = World([0.05, 0.04, 0.03], ground=0.3, finger_radius=(0.02, 0.02))
    scene = Scene(ground=Ground(height=0.3))
    for space, what in (
        (Workspace(finger_radius=0.02), "another ground"),
        (Workspace(ground=scene.ground), "smaller fingertips"),
    ):
        with pytest.raises(OptionError, match=what):
            next(explore(world, scene, workspace=space, centre=(0, 0)))
    assert world.measurements is None  # before the first command


def test_the_ground_that_was_told_is_that_of_a_scene_whose_ground_was_estimated():
    leans = Ground().turned([0.02, 0.0], np.zeros(3))
    body = known(**vars(BOX) | {"scene": Scene(ground=leans)})
    for ground in (leans, Ground()):
        ExpectedInformation(body, Workspace(ground=ground))


def test_that_capsules_are_predicted_as_spheres_is_said(caplog):
    ExpectedInformation(
        known(**vars(BOX) | {"scene": Scene(finger_length=0.04)}), SPACE
    )
    assert "spherical fingertips" in caplog.text
