"""The fingers of the TriFinger robots: against MuJoCo, published rows, themselves."""

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from bench import capture

from hardware.errors import ReachError, RigError
from hardware.kinematics import INITIAL, ROBOTS, finger, joints_about

THREE, PAIR, I3 = (0, 120, 240), (0, 180), np.eye(3)
MUJOCO = (
    '<mujoco><compiler fusestatic="false" balanceinertia="true" boundmass="1e-6"'
    ' boundinertia="1e-9"/></mujoco>'
)


def configurations(n, seed=0):
    """Draw joint angles of the working branch: hand below the base, elbow as usual."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform((-1.2, -0.6, -2.7), (1.0, 1.5, -0.05), (2 * n, 3))
    below = np.cos(angles[:, 1]) + np.cos(angles[:, 1] + angles[:, 2]) > 0.05
    return angles[below][:n]


def test_places_of_joints_are_one_for_each_finger():
    for wrong in ("here", np.zeros((1, 3)), np.zeros((2, 2))):
        with pytest.raises(ReachError, match=r"places: .*\(2, 3\) numbers \[m\]"):
            joints_about([finger(), finger(degrees=180)], wrong)


def urdf_model():
    """Load the authors' URDF without meshes."""
    import mujoco

    root = ET.parse(capture("trifingeredu.urdf")).getroot()
    for parent in root.iter():
        for child in list(parent):
            if child.tag in ("visual", "collision", "transmission"):
                parent.remove(child)
    text = ET.tostring(root, encoding="unicode")
    text = re.sub(r"(<robot[^>]*>)", r"\1" + MUJOCO, text, count=1)
    return mujoco.MjModel.from_xml_string(text)


def test_the_tip_and_its_rotation_are_those_of_mujoco_on_the_authors_urdf():
    import mujoco

    model = urdf_model()
    data = mujoco.MjData(model)
    worst = 0.0
    for angles in np.random.default_rng(1).uniform(-1.5, 1.5, (200, 3)):
        for degrees in THREE:
            names = ("base_to_upper", "upper_to_middle", "middle_to_lower")
            for name, angle in zip(names, angles, strict=True):
                data.joint(f"finger_{name}_joint_{degrees}").qpos = angle
        mujoco.mj_kinematics(model, data)
        for degrees in THREE:
            tip, body = finger("edu_dair", degrees), f"finger_tip_link_{degrees}"
            off = tip.forward(angles) - data.body(body).xpos
            worst = max(worst, np.abs(off).max())
            R_wt = data.body(body).xmat.reshape(3, 3)
            assert np.allclose(tip.rotation(angles), R_wt, atol=1e-9)
    assert worst < 5e-9  # the URDF rounds the places of the bases


def test_a_chain_of_hinges_in_mujoco_agrees_for_every_robot():
    import mujoco

    chains = {
        "edu": ((-1, 0, 0), (0, 1, 0), (0, -0.014, 0), (0, -0.03745, -0.16)),
        "pro": ((0, 1, 0), (1, 0, 0), (0.01685, 0.0505, 0), (0.05015, 0, -0.16)),
    }
    tips = {"edu": (0, -0.008, -0.16), "pro": (0.019, 0, -0.16)}
    for name, (a0, a1, middle, lower) in chains.items():
        joint = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint axis="{}"/>'
        axes = [joint.format(" ".join(map(str, a))) for a in (a0, a1, a1)]
        place = [" ".join(map(str, p)) for p in (middle, lower, tips[name])]
        for degrees in THREE:
            robot = finger(name, degrees)
            base = " ".join(map(repr, robot.base_position.tolist()))
            turn = float(np.arctan2(*robot.base_rotation[1::-1, 0]))
            model = mujoco.MjModel.from_xml_string(
                f'<mujoco><compiler angle="radian"/><worldbody><body pos="{base}" '
                f'euler="0 0 {turn!r}">{axes[0]}<body pos="{place[0]}">{axes[1]}'
                f'<body pos="{place[1]}">{axes[2]}<site name="tip" pos="{place[2]}"/>'
                "</body></body></body></worldbody></mujoco>"
            )
            data = mujoco.MjData(model)
            for angles in configurations(20):
                data.qpos[:] = angles
                mujoco.mj_kinematics(model, data)
                off = robot.forward(angles) - data.site("tip").xpos
                assert np.abs(off).max() < 1e-12


def test_the_recorded_rows_of_the_pro_are_reproduced_to_the_last_digit():
    rows = json.loads(capture("trifingerpro_kinematics_data.json").read_text())
    angles = np.reshape(rows["joint_positions"], (-1, 3, 3))
    tips = np.reshape(rows["tip_positions"], (-1, 3, 3))
    assert len(angles) == 217
    for k, degrees in enumerate(THREE):
        off = finger("pro", degrees).forward(angles[:, k]) - tips[:, k]
        assert np.abs(off).max() < 1e-15


@pytest.mark.parametrize(
    ("robot", "degrees", "angles", "tip"),
    [
        ("edu_dair", 0, (0, 0, 0), (-0.05945, 0.0395, -0.038)),
        ("edu_dair", 120, (0, 0, 0), (0.063933, 0.031735, -0.038)),
        ("edu_dair", 240, (0, 0, 0), (-0.004483, -0.071235, -0.038)),
        ("edu_dair", 0, INITIAL, (-0.05945, 0.050055, 0.071069)),
        ("edu_dair", 120, INITIAL, (0.073074, 0.026458, 0.071069)),
        ("edu_dair", 240, INITIAL, (-0.013624, -0.076513, 0.071069)),
        ("edu_dair", 180, INITIAL, (0.05945, -0.050055, 0.071069)),
        ("edu_dair", 0, (0.3, 0.9, -1.7), (-0.119129, 0.050055, 0.098059)),
        ("edu_dair", 120, (0.3, 0.9, -1.7), (0.102914, 0.078141, 0.098059)),
        ("edu_dair", 0, (-0.4, 0.5, -1.2), (0.047577, 0.013133, 0.016805)),
        ("pro", 0, INITIAL, (0.086, 0.061055, 0.079069)),
        ("pro", 120, INITIAL, (0.009875, -0.105006, 0.079069)),
        ("pro", 240, INITIAL, (-0.095875, 0.043951, 0.079069)),
    ],
)
def test_the_published_tips_come_out(robot, degrees, angles, tip):
    # the published numbers are rounded to a micrometre
    off = finger(robot, degrees).forward(np.array(angles, float)) - tip
    assert np.abs(off).max() < 6e-7


def test_the_stock_robot_is_higher_and_wider_than_the_authors():
    stock, authors = finger("edu").base_position, finger("edu_dair").base_position
    assert np.allclose(stock - authors, [0, 0.006, 0.001], atol=1e-12)


def test_opposing_fingers_are_half_a_turn_apart():
    first, second = (finger("edu_dair", degrees) for degrees in PAIR)
    for angles in configurations(10):
        x, y, z = first.forward(angles)
        assert np.allclose(second.forward(angles), (-x, -y, z), atol=1e-15)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_inverse_undoes_the_forward_kinematics(robot):
    angles = configurations(2000)
    for degrees in (*THREE, *PAIR):
        tip = finger(robot, degrees)
        assert np.abs(tip.inverse(tip.forward(angles)) - angles).max() < 1e-7
        # where the elbow is bent well, angles come back to rounding
        bent = angles[:, 2] < -0.5
        back = tip.inverse(tip.forward(angles[bent]))
        assert np.abs(back - angles[bent]).max() < 1e-13


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_jacobian_is_the_derivative_of_the_tip(robot):
    tip, h = finger(robot, 120), 1e-6
    for angles in configurations(20):
        q = angles + h * np.stack([I3, -I3])
        plus, minus = tip.forward(q)
        slope = (plus - minus).T / (2 * h)
        assert np.allclose(tip.jacobian(angles), slope, atol=1e-9)


def test_the_jacobian_at_the_initial_pose_is_the_published_one():
    tip = finger("edu_dair")
    J_b = tip.base_rotation.T @ tip.jacobian(np.array(INITIAL))
    published = [
        [0, -0.21093, -0.11147],
        [-0.21093, 0, 0],
        [0.05945, 0.01056, -0.11478],
    ]
    assert np.abs(J_b - published).max() < 6e-6
    # one degree of homing error moves the tip by what the paper calls 3-5 mm
    assert 3e-3 < np.deg2rad(1) * np.linalg.norm(J_b[:, 0]) < 5e-3


def test_many_configurations_are_one_call():
    tip, angles = finger("pro", 240), configurations(12).reshape(3, 4, 3)
    single = [[tip.forward(q) for q in row] for row in angles]
    assert np.allclose(tip.forward(angles), single, atol=1e-15)
    assert tip.jacobian(angles).shape == (3, 4, 3, 3)
    assert tip.rotation(angles).shape == (3, 4, 3, 3)


def test_points_out_of_reach_are_refused_by_name():
    tip = finger("edu_dair")
    near = tip.base_position - [0.0, 0.0, 0.01]
    with pytest.raises(ReachError, match="too close to the first axis"):
        tip.inverse(near)
    with pytest.raises(ReachError, match=r"too far away.*at index \(1,\)"):
        tip.inverse(np.array([tip.forward(np.array(INITIAL)), [0.5, 0.0, 0.1]]))
    with pytest.raises(ReachError, match="close"):
        tip.inverse([np.nan, 0.0, 0.1])


def test_an_unknown_robot_is_refused_with_the_known_ones():
    with pytest.raises(RigError, match="edu_dair"):
        finger("edo")
