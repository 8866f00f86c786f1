"""Ways of a finger to the start of an action, and back out of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from hardware.errors import LimitError
from hardware.impedance import Limits
from hardware.kinematics import FAR, finger
from hardware.paths import row_of, way_back, way_there
from tactilenlp.common.validation import checked_trajectory

FINGER = finger("edu_dair", 180)
LOW = 0.0185  # [m], a centimetre above the ground less than the tip's radius
LEFT, RIGHT = FINGER.inverse([[0.08, -0.07, LOW], [0.08, 0.07, LOW]])
STEP = 0.02  # [s]


def test_a_finger_swung_low_from_side_to_side_stays_above_the_ground():
    s = np.linspace(0, 1, 101)[:, None]
    with pytest.raises(LimitError, match="ground"):
        Limits().check_path("straight", FINGER, LEFT + s * (RIGHT - LEFT), STEP)
    path = way_there(FINGER, LEFT, RIGHT, 101)
    Limits().check_path("raised", FINGER, path, STEP)
    assert FINGER.forward(path)[:, 2].min() == pytest.approx(LOW, abs=1e-12)
    assert np.array_equal(path[[0, -1]], [LEFT, RIGHT])
    # without a jump: joints go no faster than 1.3 times what the straight way asks
    assert np.abs(np.diff(path, axis=0)).max() < 1.3 * 1.875 / 100 * np.abs(
        RIGHT - LEFT
    ).max()  # fmt: skip


def test_a_way_is_nowhere_lower_than_the_line_between_its_ends():
    rng = np.random.default_rng(0)
    for ends in rng.uniform([0.03, -0.08, 0.02], [0.12, 0.08, 0.12], (50, 2, 3)):
        path = way_there(FINGER, *FINGER.inverse(ends), 21)
        height = FINGER.forward(path)[:, 2]
        s = np.linspace(0, 1, 21)
        line = ends[0, 2] + s**3 * (10 - 15 * s + 6 * s**2) * (ends[1, 2] - ends[0, 2])
        assert (height > line - 1e-9).all()


def test_a_finger_that_has_sagged_may_leave_but_no_lower():
    sagged = FINGER.inverse([0.08, -0.07, FINGER.tip_radius + 2e-4])
    path = way_there(FINGER, sagged, RIGHT, 101)
    with pytest.raises(LimitError, match="ground"):
        Limits().check_path("sagged", FINGER, path, STEP)
    Limits().check_path("sagged", FINGER, path, STEP, begun=2e-4)
    with pytest.raises(LimitError, match="ground"):
        Limits().check_path("sagged", FINGER, path, STEP, begun=3e-4)


def test_a_finger_goes_back_as_it_came_from_where_it_was_kept():
    path = way_there(FINGER, LEFT, RIGHT, 11)
    kept = path[-1] + [0.1, -0.2, 0.05]
    back = way_back(path, kept)
    assert np.array_equal(back[[0, -1]], [kept, path[0]])
    off = back - path[::-1]
    assert (np.diff(np.linalg.norm(off, axis=1)) < 0).all()


def test_rows_between_two_rows_are_their_mean():
    path = np.arange(9.0).reshape(3, 3) ** 2
    assert np.array_equal(row_of(path, 0.5), (path[0] + path[1]) / 2)
    assert np.array_equal(row_of(path, 2.0), path[2])


@pytest.mark.parametrize("time", [None, ["a", "b"], [[0.0], [1.0, 2.0]]])
def test_a_time_that_is_no_numbers_is_told_as_empty(time):
    trajectory = SimpleNamespace(time=time, finger_position=np.zeros((2, 1, 3)))
    with pytest.raises(LimitError, match=r"got time \(0,\), finger_position \(2, 1, 3"):
        checked_trajectory(trajectory, 1, 10.0, FAR, LimitError)
