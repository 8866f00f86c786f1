"""Bodies from tosses: boxes of any shape, soft ground, the fit, the time limit."""

import time

import numpy as np
import pytest
from conftest import TOSSES, benchmark

from formulations import known_trajectory as page
from tactilenlp import Scene, Trajectories, identify_body
from tactilenlp.errors import (
    NotConverged,
    OptionError,
)
from tactilenlp.identification.body import body_fit_of
from tactilenlp.identification.impacts import phases_of, with_soft_ground
from tactilenlp.identification.starts import starts_of, support_of

MASS = 0.37  # [kg] of the real cube, as measured by who recorded it
SCENE = Scene(mass=MASS)


boxes = benchmark("tossed_boxes")  # in MuJoCo, whose ground is soft

NO_HEIGHTS = {"on the surface": 0.0, "not below": 0.0}


def test_heights_of_the_origin_tell_the_half_widths_it_rested_on(boxes):
    half, _, _ = boxes.drawn_box(7)
    steps, _, _, ruler = starts_of(boxes.tossed(7, 4), SCENE, "cuboid", None, None)
    assert ruler[0] == pytest.approx(1.0, abs=1e-6)
    found = support_of(steps, SCENE.gravity, 1 / boxes.RATE)
    assert (found.least < found.largest + 1e-6).all()
    # At rest the ground yields by 0.02 mm, and 0.2 mm are tolerated.  The first axis
    # was never vertical: only a bracket.
    assert found.like_cube[1:] == pytest.approx(half[1:], abs=0.5e-3)
    assert found.least[0] - 0.5e-3 < half[0] < found.largest[0] + 0.5e-3


@pytest.mark.slow
def test_a_cube_on_a_soft_ground_is_identified(boxes):
    row = boxes.run(0, 4)
    assert not row["failure"]
    assert row["off_mm"] < 1.0
    assert row["sigmas"] < 3
    assert row["gauge"] == pytest.approx(1.0, abs=1e-6)
    assert row["verdict"] == "good"


def test_a_fit_far_beyond_its_spread_is_bad_and_widens():
    costs = {"balance, 1 touching": 100.0, "on the surface": 40.0, "not below": 900.0}
    fit = body_fit_of(costs, steps=100)
    assert fit.verdict == "bad"
    assert fit.widening == pytest.approx(np.sqrt(940 / (50 + 7.1)), rel=1e-3)
    assert "not to be trusted" in fit.text
    mild = body_fit_of(costs | {"not below": 20.0}, steps=100)
    assert mild.verdict == "good"


def test_a_fit_is_not_good_where_any_term_is_beyond_its_own_limit():
    """Also where another term is further off in its spreads, within its limit."""
    steps = 100
    balance, heights = body_fit_of({"balance": 0.0} | NO_HEIGHTS, steps).terms.values()
    within = balance.expected + 0.99 * balance.limit
    beyond = heights.expected + 1.01 * heights.limit
    costs = {"balance": within, "on the surface": beyond, "not below": 0.0}
    fit = body_fit_of(costs, steps)
    assert fit.verdict == "poor"
    assert fit.widening > 1
    assert "the height of the corners costs" in fit.text
    assert body_fit_of(costs | NO_HEIGHTS, steps).verdict == "good"


def test_corners_may_sink_into_a_soft_ground_in_impacts_only(tosses):
    steps, starts, signs, _ = starts_of(tosses, SCENE, "cuboid", None, None)
    soft = with_soft_ground(steps, 1.1 * starts[0] * signs, SCENE.gravity, tosses.dt)
    _, hit, _ = phases_of(steps, SCENE.gravity, tosses.dt)
    assert (soft.depth[~hit] == page.SURFACE).all()
    assert len(set(soft.depth[hit])) == 1
    assert 2 * page.SURFACE < soft.depth[hit][0] <= 20e-3


def test_a_time_limit_keeps_the_start_and_says_what_was_left_out(tosses):
    late = identify_body(tosses, SCENE, time_limit=1e-3, throw=False)
    assert not late.success
    assert "time limit reached: without a solve" in late.status
    assert "standard deviations" in late.status
    assert np.isinf(late.sigma["vertices"]).all()
    assert np.isfinite(late.vertices).all()
    assert "mm" in late.summary()
    with pytest.raises(NotConverged, match="raise time_limit"):
        identify_body(tosses, SCENE, time_limit=1e-3)
    for wrong in (0.0, -1.0, np.nan, None, "2"):
        with pytest.raises(OptionError, match="time_limit"):
            identify_body(tosses, SCENE, time_limit=wrong)


@pytest.mark.slow
@pytest.mark.parametrize("limit", [2.0, 5.0])
def test_a_time_limit_holds_for_8000_samples(tosses, limit):
    """In CPU time, which other programs do not lengthen."""
    every = Trajectories.load(TOSSES)
    began = time.process_time()
    late = identify_body(every, SCENE, time_limit=limit, throw=False)
    took = time.process_time() - began
    assert not late.success
    assert took < limit + 1.0, f"{took:.2f} s"
