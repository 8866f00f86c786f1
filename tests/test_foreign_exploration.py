"""Explorations in other worlds: the world is what it says, and refusals count."""

import numpy as np
import pytest
from conftest import benchmark

from tactilenlp.errors import TactileError

benchmarks = benchmark("foreign_exploration", "judging")


@pytest.fixture
def refused(benchmarks, monkeypatch):
    """Return a function: the rows of an exploration that is refused, and its world."""
    study, worlds = benchmarks[0], []

    def explore(world, *_, **given):
        worlds.append(world)
        raise TactileError("refused", where="world", next="-")
        yield

    monkeypatch.setattr(study, "explore", explore)
    monkeypatch.setattr(study, "warm", lambda: None)
    return lambda *cell: (study.explored(*cell, 3, "random"), worlds[-1])


@pytest.mark.parametrize(("strength", "radius"), [("4 mm", 4e-3), ("20 mm", 20e-3)])
def test_the_estimator_is_told_the_radius_of_fingertips(refused, strength, radius):
    _, world = refused("fingertip", strength, 0)
    assert world.finger_radius.tolist() == [radius] * 2
    geoms = world.simulation.model.geom_size
    assert geoms[-2:, 0].tolist() == [radius] * 2
    assert world.box.radius == radius


def test_a_box_of_another_size_is_simulated_and_judged(refused):
    (_, small), (_, large) = (refused("size", s, 0) for s in ("x0.5", "x2.5"))
    assert large.box.sides == pytest.approx(5 * small.box.sides)
    for world in (small, large):
        simulated = world.simulation.model.geom("box").size
        assert simulated == pytest.approx(world.box.sides / 2)


def test_all_actions_after_a_refusal_are_refused(refused):
    rows, _ = refused("none", "", 0)
    assert [row["action"] for row in rows] == [0, 1, 2, 3]
    assert all("refused" in row["refused"] for row in rows)


def test_what_was_refused_is_infinitely_far_and_outside(benchmarks):
    from foreign_report import NUMBERS

    study, _ = benchmarks
    numbers = {f"{n}_{what}": 0.1 for n in NUMBERS for what in ("error", "sigma")}
    kept = numbers | {"refused": "", "surface_mm": 1.0, "verdict": "good"}
    found = study.summed([kept, kept, {"refused": "SceneError"}])
    assert found["surface_mm"] == 1.0
    assert found["worst_mm"] == np.inf
    assert found["within_3"] == pytest.approx(2 / 3)
    assert found["nees"] == pytest.approx(1.0)


def test_how_fingers_push_is_no_choice_where_the_policy_pushes(benchmarks):
    study, _ = benchmarks
    kept = {name for name, kinds in study.DEPARTURES.items() if study._of_world(kinds)}
    assert {"contact", "fingertip", "size", "latency", "wall", "mass"} <= kept
    assert not kept & {"pushed high", "from above", "begins in contact"}
    assert not kept & {"carried", "speed", "path", "duration", "bumped"}


def test_quantiles_are_infinite_only_where_a_failure_weighs_in(benchmarks):
    _, judging = benchmarks
    values = [1.0, 2.0, np.nan, np.inf]
    assert judging.quantile(values) == 2.0
    assert judging.quantile(values, 0.6) == np.inf
    assert judging.quantile(values, 0.25) == 1.5
    assert np.isnan(judging.quantile([np.nan]))
