"""Motors into joints and back."""

import numpy as np
import pytest

from hardware.errors import RigError
from hardware.motor_joints import JointMap


def test_motors_and_joints_are_mapped_there_and_back():
    joints = JointMap(zero=(0.1, -0.2, 0.3))
    angles = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    assert np.allclose(joints.angles(joints.revolutions(angles)), angles, atol=1e-15)
    assert np.allclose(joints.velocities(joints.krpm(angles)), angles, atol=1e-15)
    assert np.allclose(joints.torques(joints.currents(angles)), angles, atol=1e-15)


def test_the_first_joint_is_on_the_second_board():
    revolutions = JointMap().revolutions([2 * np.pi / 9, 0.0, 0.0])
    assert np.allclose(revolutions, [[0, 0], [1, 0]])
    plain = JointMap(motors=((0, 0), (0, 1), (1, 0)))
    assert np.allclose(plain.revolutions([2 * np.pi / 9, 0, 0]), [[1, 0], [0, 0]])


def test_one_turn_per_second_of_a_motor_is_a_ninth_at_the_joint():
    krpm = np.array([[0.0, 0.0], [0.06, 0.0]])  # 60 turns a minute, in thousands
    assert JointMap().velocities(krpm) == pytest.approx([2 * np.pi / 9, 0, 0])


def test_two_amperes_are_the_torque_limit_of_the_urdf():
    assert JointMap().torques(np.full((2, 2), 2.0)) == pytest.approx([0.36] * 3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"motors": ((0, 0), (0, 0), (1, 0))},
        {"motors": ((0, 0), (0, 1))},
        {"motors": ((0, 0), (0, 1), (2, 0))},
        {"zero": (0.0, 0.0)},
        {"zero": (0.0, np.nan, 0.0)},
    ],
)
def test_a_map_that_cannot_be_is_refused(wrong):
    with pytest.raises(RigError):
        JointMap(**wrong)
