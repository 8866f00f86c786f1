"""Draws of bodies at the first touch: about the prior, within bounds of each size."""

from dataclasses import replace

import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp.tracking.geometry import geometry_of
from tactilenlp.tracking.initial_states import (
    _drawn,
    body_height,
    box_states,
    felt_extent,
    from_guess,
)


def test_boxes_are_drawn_about_the_prior_that_a_shape_has(recorded):
    """Twice the mean and deviation: the same draws, twice as large."""
    data = recorded[0]
    twice = replace(CUBOID, name="large", size_prior=(0.09, 0.04))
    usual, large = (
        box_states(data, shape, np.random.default_rng(0), 0.01)[0][:2]
        for shape in (CUBOID, twice)
    )
    assert large == pytest.approx(2 * usual)


def test_boxes_are_drawn_as_large_as_they_were_felt(recorded):
    data = recorded[0]
    usual = box_states(data, CUBOID, np.random.default_rng(0), 0.01)[0][:2]
    assert 0.02 < felt_extent(data) < 0.06
    high = data.finger_position + np.array([0.0, 0.0, 0.25])
    held = replace(data, finger_position=high)
    large = box_states(held, CUBOID, np.random.default_rng(0), 0.01)[0][:2]
    assert usual.max() < 0.2
    assert 0.4 < large.max() < 2 * felt_extent(held)
    nothing = replace(data, contact=np.zeros_like(data.contact), normal=0 * data.normal)
    assert felt_extent(nothing) == 0.0


def test_bounds_may_differ_by_size(recorded):
    each = replace(CUBOID, name="each", bounds=((4e-3,) * 3, (0.3, 0.3, 0.02)))
    one = replace(CUBOID, name="one", bounds=(4e-3, 0.02))
    heights = {body_height(recorded[0], s, 0.045, 0.01) for s in (each, one)}
    assert len(heights) == 1


def test_a_touch_of_the_top_as_an_action_ends_tells_the_height(recorded):
    data = recorded[0].select([0])
    contact, normal = np.zeros_like(data.contact), np.zeros_like(data.normal)
    contact[-1, 0], normal[-1, 0] = True, (0.0, 0.0, 1.0)
    top = data.finger_position[-1, 0, 2] - data.finger_radius[0]
    end = replace(data, contact=contact, normal=normal)
    assert body_height(end, CUBOID, 0.045, 0.01) == pytest.approx(top)
    shifted = [np.roll(a, -3, axis=0) for a in (contact, normal)]
    flipped = replace(data, contact=shifted[0], normal=shifted[1])
    assert body_height(flipped, CUBOID, 0.045, 0.01) == 0.045  # before it ends


def test_a_guess_is_the_first_of_its_draws():
    guess = np.r_[0.06, 0.04, 0.005, 0.1, 0.2, 0.3]
    z, _ = from_guess(guess, geometry_of(CUBOID), np.random.default_rng(0))
    assert np.array_equal(z[:, 0], guess)
    assert z[:3, 1:].min() >= 0.0075 - 1e-12


@pytest.mark.parametrize("mean", [-0.1, 0.0, 0.1])
def test_an_angle_is_drawn_about_its_mean_whatever_its_sign(mean):
    own = replace(
        CUBOID, name="own", theta=4, units=("m", "m", "m", "rad"), words=(),
        bounds=((4e-3,) * 3 + (-0.5,), (0.4,) * 3 + (0.5,)),
        size_prior=((0.045,) * 3 + (mean,), (0.02,) * 3 + (0.1,)),
    )  # fmt: skip
    drawn = _drawn(own, np.random.default_rng(0), 1000)[3]
    assert drawn.std() == pytest.approx(0.075, rel=0.1)
    assert drawn.mean() == pytest.approx(mean, abs=0.01)
