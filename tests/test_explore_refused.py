"""What cannot be explored is said before a finger moves, or a file is taken up."""

from dataclasses import replace

import pytest

from formulations.shape import CUBOID
from tactilenlp import (
    Action,
    Exploration,
    ExploreOptions,
    Guess,
    Scene,
    Step,
    Workspace,
    explore,
)
from tactilenlp.errors import OptionError, SceneError, StartError

AFLOAT = Scene(ground=None)
LONG = Scene(finger_length=0.01)
MASSLESS = replace(CUBOID, name="ghost", inertia=None)


class Moved(Exception):
    """A finger moved."""


class Robot:
    """Whatever it is told, it says that it moved."""

    def execute(self, trajectory):
        raise Moved


@pytest.mark.parametrize(
    ("wrong", "error", "word"),
    [
        ({"formulation": "quasistatic"}, OptionError, "formulation"),
        ({"shape": "ball"}, OptionError, "shape"),
        ({"options": {"starts": 3}}, OptionError, "options"),
        ({"search": "adam"}, OptionError, "search"),
        ({"budget": 1}, OptionError, "budget"),
        ({"executor": 2}, OptionError, "executor"),
        ({"policy": "best"}, OptionError, "policy"),
        ({"scene": AFLOAT, "formulation": "shooting"}, SceneError, "planar"),
        ({"scene": AFLOAT}, SceneError, "actions are not predicted"),
        (
            {"scene": AFLOAT, "policy": "fisher"},
            SceneError,
            "actions are not predicted",
        ),
        ({"shape": MASSLESS}, OptionError, "actions are not predicted"),
        ({"shape": ["cuboid", MASSLESS]}, OptionError, "actions are not predicted"),
        ({"scene": LONG, "shape": "polytope", "actions": 0}, SceneError, "round"),
    ],
)
def test_what_cannot_be_explored_is_refused_before_anything_moves(wrong, error, word):
    with pytest.raises(error, match=word):
        next(explore(Robot(), **wrong))


class Short(Robot):
    """It reaches 5 cm around the origin, and says so."""

    def check(self, trajectory):
        if abs(trajectory.finger_position[:, 0]).max() > 0.05:
            raise ReachedNot


class ReachedNot(Exception):
    """A motion is out of reach."""


@pytest.mark.parametrize("centre", [None, (0.0, 0.0)])
def test_what_a_world_cannot_reach_is_refused_before_anything_moves(centre, touched):
    with pytest.raises(ReachedNot):
        next(explore(Short(), centre=centre))
    with pytest.raises(ReachedNot):
        next(explore(Short(), start=touched))
    near = Workspace(radius=0.02)
    with pytest.raises(Moved):
        next(explore(Short(), centre=(0.0, 0.0), workspace=near))


def test_a_start_that_does_not_fit_is_refused_before_anything_moves(touched):
    other = replace(touched, shape="polytope")
    given = {"scene": touched.scene, "policy": "random"}
    with pytest.raises(StartError, match="another shape"):
        next(explore(Robot(), start=other, **given))
    guess = Guess((50.0, 40.0, 40.0), (0.0, 0.0))  # mm
    with pytest.raises(StartError, match="millimetres"):
        next(explore(Robot(), start=guess, **given))


@pytest.fixture
def kept(touched, tmp_path):
    """A file of a first touch, and what it was made with."""
    step = Step(0, None, touched.measurements, touched, None, "by hand", {})
    Exploration((step,)).save(tmp_path / "kept.npz")
    return {"file": tmp_path / "kept.npz", "scene": touched.scene, "actions": 0}


def test_a_file_goes_on_with_what_it_was_made_with(kept, touched):
    (step,) = explore(None, **kept)
    assert step.estimate.objective == touched.objective


@pytest.mark.parametrize(
    ("other", "field"),
    [
        ({"scene": Scene(mass=0.7)}, "scene"),
        ({"shape": "polytope"}, "shape"),
        ({"formulation": "quasi_static"}, "formulation"),
    ],
)
def test_a_file_made_with_other_settings_is_not_taken_up(kept, other, field):
    with pytest.raises(StartError, match=f"of another {field}") as caught:
        next(explore(None, **kept | other))
    error = caught.value
    assert str(kept["file"]) == error.where
    assert "another file" in error.next
    assert repr(other[field]) in error.expected
    assert error.got not in (None, error.expected)


@pytest.mark.parametrize(
    "fine",
    [
        {"shape": "polytope", "actions": 0},
        {"shape": "polytope"},
        {"shape": MASSLESS, "policy": "random"},
        {"scene": AFLOAT, "policy": "farthest"},
        {"scene": AFLOAT, "policy": lambda plan: plan.workspace.random(plan.rng)},
    ],
)
def test_what_predicts_nothing_is_not_held_up(fine):
    with pytest.raises(Moved):
        next(explore(Robot(), centre=(0.0, 0.0, 0.02), **fine))


def test_settings_are_given_at_once_or_by_name_but_not_both():
    with pytest.raises(OptionError, match="given twice"):
        next(explore(None, settings=ExploreOptions(actions=1), seed=1))
    with pytest.raises(OptionError, match="given twice"):
        next(explore(None, None, 3, actions=2))
    with pytest.raises(OptionError, match="no such setting"):
        next(explore(None, action=3))
    with pytest.raises(OptionError, match="too many positional"):
        next(explore(None, None, 3, "eig", "cuboid", 0, None))


def test_settings_are_checked_where_they_are_made():
    with pytest.raises(OptionError, match="actions"):
        ExploreOptions(actions=-1)
    with pytest.raises(OptionError, match="policy"):
        ExploreOptions(policy="best")


def test_an_action_that_a_file_lacks_asks_for_a_world(kept):
    steps = explore(None, **kept | {"actions": 1, "policy": "random"})
    next(steps)
    with pytest.raises(OptionError, match="no world"):
        next(steps)


def test_a_policy_that_returns_no_action_is_refused(touched):
    def forgetful(plan):
        return None

    given = {"scene": touched.scene, "policy": forgetful, "actions": 1}
    with pytest.raises(OptionError, match="action that forgetful returns"):
        next(explore(Robot(), start=touched, **given))


def test_a_radius_of_all_fingers_leaves_their_number_open(touched):
    class Same(Robot):
        finger_radius = 0.012

        def execute(self, trajectory):
            assert trajectory.finger_position.shape[1] == Workspace().fingers
            raise Moved

    given = {"scene": touched.scene, "policy": "random"}
    with pytest.raises(Moved):
        next(explore(Same(), centre=(0.0, 0.0), **given))


def test_an_angle_beyond_its_limits_is_named_with_them():
    space = Workspace()
    angles = space.upper.copy()
    angles[2] += 0.1
    with pytest.raises(OptionError) as refused:
        Action(angles, space)
    assert "angles[2]" in str(refused.value)
    limits = f"within {space.lower[2]:.3g} to {space.upper[2]:.3g}"
    assert limits in str(refused.value)
    with pytest.raises(OptionError, match="two of each finger"):
        Action(angles[:3], space)
