"""Torques that hold a finger up, and pull it towards its target."""

import numpy as np
import pytest

from hardware.errors import (
    LimitError,
)
from hardware.impedance import Gains, holding


def test_the_holding_torque_is_that_of_mujoco_on_the_authors_urdf():
    import mujoco
    from test_hardware_kinematics import configurations, urdf_model

    model = urdf_model()
    model.opt.gravity[:] = 0, 0, -9.81
    data = mujoco.MjData(model)
    names = ("base_to_upper", "upper_to_middle", "middle_to_lower")
    for angles in configurations(50):
        joints = [data.joint(f"finger_{name}_joint_0") for name in names]
        for joint, angle in zip(joints, angles, strict=True):
            joint.qpos = angle
        mujoco.mj_forward(model, data)
        weight = [float(joint.qfrc_bias[0]) for joint in joints]
        assert holding(angles) == pytest.approx(weight, abs=2e-3)


def test_torques_pull_towards_the_target_within_the_bound():
    gains = Gains(weight=0.0)
    rest = np.zeros(3)
    pull = gains.torques(np.array([0.01, -0.01, 0.0]), rest, rest, rest)
    assert pull == pytest.approx([0.07, -0.07, 0.0])
    hard = gains.torques(np.array([1.0, -1.0, 1.0]), rest, rest, rest)
    assert hard.tolist() == [0.36, -0.36, 0.36]
    for wrong in ({"stiffness": (1.0, 1.0)}, {"torque": -1.0}, {"weight": np.nan}):
        with pytest.raises(LimitError, match="no gains"):
            Gains(**wrong)
