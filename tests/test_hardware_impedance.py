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


PRO_MODEL = """<mujoco><compiler angle="radian"/><worldbody><body>
<joint name="q0" axis="0 1 0"/><inertial pos="0 .06 0" mass=".26" diaginertia="1 1 1"/>
<body pos=".01685 .0505 0"><joint name="q1" axis="1 0 0"/>
<inertial pos=".028 0 -.08" mass=".25" diaginertia="1 1 1"/>
<body pos=".04922 0 -.16"><joint name="q2" axis="1 0 0"/>
<inertial pos="0 0 -.06" mass=".021" diaginertia="1 1 1"/>
<body pos=".0185 0 -.1626"><inertial pos="0 0 0" mass=".031" diaginertia="1 1 1"/>
</body></body></body></body></worldbody></mujoco>"""


def test_the_holding_torque_of_a_pro_is_that_of_mujoco_on_the_published_links():
    """Its links hang on the other side of the first axis than those of an Edu."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(PRO_MODEL)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for angles in rng.uniform((-0.33, 0.0, -2.7), (1.0, 1.57, 0.0), (50, 3)):
        data.qpos[:] = angles
        mujoco.mj_forward(model, data)
        assert holding(angles, "pro") == pytest.approx(data.qfrc_bias, abs=1e-4)
    first = [holding(np.zeros(3), robot)[0] for robot in ("pro", "edu")]
    assert first[0] < -0.1 < 0 < 0.05 < first[1]


def test_torques_pull_towards_the_target_within_the_bound():
    gains = Gains(weight=0.0)
    rest = np.zeros(3)
    pull = gains.torques(np.array([0.01, -0.01, 0.0]), rest, rest, rest)
    assert pull == pytest.approx([0.07, -0.07, 0.0])
    hard = gains.torques(np.array([1.0, -1.0, 1.0]), rest, rest, rest)
    assert hard.tolist() == [0.36, -0.36, 0.36]
    for wrong in ({"stiffness": (1.0, 1.0)}, {"torque": -1.0}, {"weight": np.nan}):
        with pytest.raises(LimitError, match=r"^Gains"):
            Gains(**wrong)
