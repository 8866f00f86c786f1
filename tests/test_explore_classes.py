"""Explorations in which classes of shapes are compared; numbers of actions."""

import pytest

from tactilenlp import Exploration, Options, World, explore, extend, solve_estimate
from tactilenlp.errors import OptionError, PageError
from tactilenlp.information.mixture import ClassOdds
from tactilenlp.output.summary import classes_in_words

SIDES = (0.05, 0.035, 0.04)
QUICK = {"options": Options(hypotheses=2, starts=3), "formulation": "quasi_static"}
BOTH = ["cuboid", "polytope"]


@pytest.mark.slow
@pytest.mark.parametrize("shape", [BOTH, BOTH[::-1]], ids=["box first", "hull first"])
def test_each_class_is_solved_by_its_own_page(shape, tmp_path):
    given = QUICK | {"file": tmp_path / "both.npz", "shape": shape}
    world = World(SIDES)
    (step,) = explore(world, actions=0, **given)
    assert {one.shape for one in step.estimate.classes} == {*BOTH}
    assert not any(one.error for one in step.estimate.classes)
    first, second = explore(world, actions=1, **given)  # resumed
    assert first.estimate.theta.tolist() == step.estimate.theta.tolist()
    assert {one.shape for one in second.estimate.classes} == {*BOTH}
    assert len(Exploration.load(given["file"]).steps) == 2


@pytest.mark.slow
def test_actions_are_counted_as_steps_whatever_the_world_did_before():
    steps = [*explore(World(SIDES), actions=1, **QUICK)]
    for step in steps:
        assert {*step.measurements.action.tolist()} == {step.number}
    assert {*steps[-1].estimate.measurements.action.tolist()} == {0, 1}


def test_a_class_is_asked_for_once():
    with pytest.raises(OptionError, match="a class twice"):
        next(explore(World(SIDES), actions=0, shape=["cuboid", "cuboid"]))


def test_a_fault_of_a_page_is_no_verdict_on_a_class(recorded):
    page = extend("quasi_static", replace={"touch": lambda theta: theta[0]})
    data, scene, _ = recorded
    with pytest.raises(PageError, match="of other arguments"):
        solve_estimate(data.select([0]), scene, shape=BOTH, formulation=page)


def test_a_class_without_an_estimate_is_named_with_the_reason():
    odds = (
        ClassOdds("cuboid", 1.0, 1.0, 1.0, "good"),
        ClassOdds("cylinder", 90.0, -80.0, 1e-30, "bad"),
        ClassOdds("polytope", 0.0, 0.0, 0.0, "", "NotConverged: stopped"),
    )
    assert classes_in_words(odds) == (
        "Of the classes compared, cuboid has 100 %, cylinder has less than 0.1 % of "
        "the evidence. Polytope could not be estimated: NotConverged: stopped."
    )
