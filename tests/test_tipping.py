"""A box that fingers tip falls over its edge, or back onto the face it stood on."""

import numpy as np
import pytest

from tactilenlp.tipping import FLAT, Tip
from tactilenlp.tumble import _ways

SIZES, STOOD = np.array([0.05, 0.04, 0.03]), np.array([0.1, -0.2, 0.4])
ANGLE = np.radians([0.0, 4.0, 9.0])


def test_a_box_that_falls_back_lies_as_it_stood():
    tip = Tip(1, 1.0, ANGLE, end=0.0)
    p, R = tip.poses(SIZES, STOOD)
    assert p[-1] == pytest.approx([*STOOD[:2], SIZES[2] / 2], abs=1e-12)
    assert R[-1] == pytest.approx(R[0], abs=1e-12)
    assert tip.renamed == pytest.approx(np.eye(3))


def test_a_box_that_falls_over_lies_on_the_side_behind_the_push():
    p, R = Tip(1, 1.0, ANGLE).poses(SIZES, STOOD)
    assert p[-1, 2] == pytest.approx(SIZES[1] / 2, abs=1e-12)
    assert np.abs(R[-1][2]) == pytest.approx([0, 1, 0], abs=1e-12)


@pytest.mark.parametrize(("last", "ends"), [(9.0, {0.0, FLAT}), (60.0, {FLAT})])
def test_a_box_tipped_less_than_halfway_may_fall_back(last, ends):
    tip = Tip(0, -1.0, np.radians([0.0, last]))
    assert {way.end for _, way in _ways(tip)} == ends
