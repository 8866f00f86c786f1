"""The heading of a body, in words, also of one that was tumbled."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactilenlp.geometry.transforms import quaternion_of
from tactilenlp.output.orientation import orientation_of, yaw_of


def turned(estimate, yaw, tilt):
    """Return an estimate that ends tipped over its y axis and then turned [deg]."""
    end = Rotation.from_euler("ZY", [yaw, tilt], degrees=True)
    poses = estimate.quaternion.copy()
    poses[-1] = quaternion_of(end)
    return replace(estimate, quaternion=poses)


@pytest.mark.parametrize("upright", [-90.0, 90.0])
def test_a_box_that_tips_until_its_x_axis_is_on_end_keeps_its_heading(
    estimate, upright
):
    for tilt in upright * np.array([0.0, 0.4, 0.6, 0.999, 1.0, 1.001, 1.4]):
        yaw = np.degrees(yaw_of(turned(estimate, 30.0, tilt)))
        assert yaw == pytest.approx(30.0, abs=1e-6)
    assert orientation_of(turned(estimate, 30.0, upright)).endswith("x axis on end")


@pytest.mark.parametrize("yaw", [-170.0, 0.0, 30.0, 100.0])
def test_the_heading_of_a_flat_box_is_that_of_its_x_axis(estimate, yaw):
    flat = turned(estimate, yaw, 0.0)
    assert np.degrees(yaw_of(flat)) == pytest.approx(yaw)
    assert f"turned by {yaw:.2f} " in orientation_of(flat)
    assert orientation_of(flat).endswith("deg about the vertical")
