"""A box that tumbles: where it lies afterwards, and what its pushed side does."""

import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp.geometry.tipping import QUARTER_TURN, Tip, planar_to_free
from tactilenlp.geometry.transforms import matrices, rotvecs
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.poses import body_corners
from tactilenlp.search.proposals_tumble import Tumble, _less_deep

SIZES, STOOD = np.array([0.05, 0.04, 0.03]), np.array([0.1, -0.2, 0.4])
ANGLE = np.r_[np.linspace(0, QUARTER_TURN, 7), QUARTER_TURN]


def tumble(axis=0, side=1.0):
    """Return the tumble of a box that rests for three samples, then falls."""
    before = Hypothesis(SIZES, np.repeat(STOOD[:, None], 3, axis=1), 0.0, ("track",))
    tip = Tip(axis, side, ANGLE)
    p, R = tip.poses(SIZES, STOOD)
    falls = np.hstack([p, rotvecs(R)])[1:-1].T
    x = np.hstack([planar_to_free(SIZES, before.x), falls])
    return Tumble(SIZES, x, "tips", before, 2, tip)


def corners(theta, x):
    """Return the corners (T, 8, 3) [m] of a box, sorted at every sample."""
    q = body_corners(CUBOID, theta).T
    places = (matrices(x) @ q + x[:3].T[:, :, None]).swapaxes(1, 2)
    return np.array([sorted(map(tuple, each.round(9))) for each in places])


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_fallen_box_lies_where_its_tumble_ends(axis, side):
    falls = tumble(axis, side)
    h = falls.fallen(1)
    lies = corners(h.theta, planar_to_free(h.theta, h.x))[0]
    assert lies == pytest.approx(corners(falls.theta, falls.x)[-1], abs=1e-8)


def test_a_tumble_ends_where_the_fallen_box_goes_on_and_stays_above_the_ground():
    falls = tumble()
    later = falls.fallen(len(ANGLE) + 5)
    end = corners(later.theta, planar_to_free(later.theta, later.x))[-1]
    for motion in falls.whole_motions(later):
        path = corners(motion.theta, motion.x)
        assert path[-1] == pytest.approx(end, abs=1e-8)
        assert path[:, :, 2].min() > -1e-9


@pytest.mark.parametrize("axis", [0, 1])
def test_a_box_made_less_deep_keeps_its_pushed_side_in_place(axis):
    tip, h = Tip(axis, 1.0, ANGLE), Hypothesis(SIZES, STOOD[:, None], 0.0, ())
    thin = _less_deep(h, tip, 2 / 3)
    assert thin.theta[axis] == pytest.approx(2 / 3 * SIZES[axis])
    behind = tip.fall(STOOD)[:2] / 2
    pushed = [one.x[:2, 0] - behind * one.theta[axis] for one in (h, thin)]
    assert pushed[1] == pytest.approx(pushed[0])
