"""A truth that cannot be drawn is refused by a typed error that names the array."""

import numpy as np
import pytest

from tactilenlp.errors import OptionError
from tactilenlp.plotting.animation import animate
from tactilenlp.plotting.drawing import true_corners
from tactilenlp.plotting.scene import plot_scene, plot_top

CUBE = np.indices((2, 2, 2)).reshape(3, -1).T * 0.04
WRONG = {  # what is wrong, and what the error says of it
    "two numbers": ({"position": [0, 0]}, r"truth\.position.*3.*got \[0, 0\]"),
    "no numbers": ({"position": "here"}, r"truth\.position"),
    "not known": ({"position": [np.nan, 0, 0]}, r"truth\.position.*finite"),
    "no rotation": ({"quaternion": [0, 0, 0, 0]}, r"truth\.quaternion.*length 1"),
    "not divided": ({"quaternion": [2, 0, 0, 0]}, r"truth\.quaternion.*length 1"),
    "three angles": ({"quaternion": [0, 0, 1]}, r"truth\.quaternion.*4"),
    "three of many": (
        {"position": np.zeros((3, 3)), "quaternion": np.eye(4)[[0, 0, 0]]},
        r"truth\.position: wrong number of samples.*\(62, 3\).*got shape \(3, 3\)",
    ),
    "fewer rotations": ({"quaternion": np.eye(4)[[0, 0]]}, r"truth\.quaternion: wrong"),
    "no side": ({"side_lengths": [0.04, 0.04, 0]}, r"truth\.side_lengths.*positive"),
    "two sides": ({"side_lengths": [0.04, 0.04]}, r"truth\.side_lengths"),
    "one point": ({"vertices": [0, 0, 0]}, r"truth\.vertices"),
    "a plane": ({"vertices": CUBE * [1, 1, 0]}, r"truth\.vertices.*no volume"),
    "nothing": ({"vertices": np.zeros((0, 3))}, r"truth\.vertices.*no volume"),
}


def one(**change):
    """Return the truth of a cube in one pose, with a change."""
    pose = {"position": [0, 0, 0.02], "quaternion": [1, 0, 0, 0]}
    return {"side_lengths": [0.04] * 3} | pose | change


@pytest.mark.parametrize("wrong", [*WRONG])
def test_a_truth_that_cannot_be_drawn_is_refused(wrong, touched, tmp_path):
    change, words = WRONG[wrong]
    assert touched.measurements.samples == 62
    for draw in (plot_top, plot_scene):
        with pytest.raises(OptionError, match=words):
            draw(touched, truth=one(**change))
    with pytest.raises(OptionError, match=words):
        animate(touched, tmp_path / "film.gif", truth=one(**change))
    assert not any(tmp_path.iterdir())


def test_one_true_pose_is_that_of_all_samples_and_many_are_each_of_their_own():
    still = true_corners(one(), 5, 62)
    rows = one(position=[[0, 0, 0.02]], quaternion=[[1, 0, 0, 0]])
    np.testing.assert_array_equal(true_corners(rows, 5, 62), still)
    way = np.linspace(0, 1, 62)[:, None] * [1, 0, 0]
    moving = one(position=way, quaternion=[1, 0, 0, 0])
    for sample in (0, 5, -1):
        centre = true_corners(moving, sample, 62).mean(axis=0)
        np.testing.assert_allclose(centre, 1e3 * way[sample], atol=1e-9)  # [mm]
        first = true_corners(moving, sample, 40).mean(axis=0)  # of the first samples
        np.testing.assert_allclose(first, 1e3 * way[:40][sample], atol=1e-9)
    corners = true_corners(one(vertices=CUBE - 0.02), 0, 62)
    np.testing.assert_allclose(np.sort(corners, axis=0), np.sort(still, axis=0))
