"""Joints that count from wrong angles put fingers elsewhere, and turn them."""

from dataclasses import replace

import numpy as np
import pytest
from programmes import programme
from scipy.linalg import block_diag

from formulations import quasi_static, violation_implicit
from hardware.kinematics import INITIAL, finger, joints_about
from tactilenlp import Estimate, JointZeros, Options, Scene, solve_estimate
from tactilenlp.data.scene import Ground
from tactilenlp.errors import SceneError
from tactilenlp.exploration.action_space import Workspace
from tactilenlp.exploration.expected_information import ExpectedInformation

DEGREE = np.deg2rad(1.0)
FINGERS = [finger("edu_dair", 180), finger("edu_dair", 0)]
PLACES = [[0.05, 0.0, 0.04], [-0.05, 0.0, 0.04]]  # [m], either side of the body
WRONG = np.deg2rad([[1.1, -0.6, 0.5], [-0.9, 0.4, 1.2]])  # of each joint
LEAN = Options(hypotheses=2, starts=4, profile_likelihood=False)

pytestmark = pytest.mark.usefixtures("not_compiled")  # compiling takes longer


@pytest.fixture(scope="module")
def joints():
    return JointZeros(DEGREE, **joints_about(FINGERS, PLACES))


def said(data, joints, e):
    """Return what fingers tell that are off by e (F, 3) [m] at their places."""
    off = joints.displacement(data.finger_position, e)
    turn = np.einsum("fij,fj->fi", joints.turn, e)
    normal = data.normal - np.cross(turn, data.normal)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    return replace(data, finger_position=data.finger_position - off, normal=normal)


@pytest.fixture(scope="module")
def told(recorded, joints):
    """The estimate of two actions, the scene, and by how much fingers are off."""
    data, scene, _ = recorded
    e = np.array([J[:3] @ d for J, d in zip(np.array(joints.jacobian), WRONG,
                                            strict=True)])  # fmt: skip
    scene = replace(scene, sigma_offset=joints, sigma_tilt=0.0)  # level: known
    data = said(data.select(range(2)), joints, e)
    return solve_estimate(data, scene, options=LEAN, throw=False), scene, e


def test_wrong_angles_put_a_finger_where_its_kinematics_say(joints):
    for f, one in enumerate(FINGERS):
        place = np.array(joints.place[f])
        for way in ([0, 0, 0], [0.02, -0.02, 0.02], [-0.01, 0.03, 0.0]):
            angles = one.inverse(place + way)
            true, turned = one.forward(angles + WRONG[f]), one.rotation(angles)
            e = one.forward(one.inverse(place) + WRONG[f]) - place
            both = np.stack([e, e])
            off = joints.displacement(np.stack([place + way] * 2), both)[f]
            # second order: 4 mm times the square of a third of a link's share
            assert np.abs(off - (true - place - way)).max() < 0.25e-3
            turn = one.rotation(angles + WRONG[f]) @ turned.T
            w = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
            assert np.abs(joints.turn[f] @ e - w).max() < 0.15 * np.abs(w).max()


def test_axes_turn_the_tip_as_differences_say():
    step = 1e-6
    for joint in range(3):
        by = step * np.eye(3)[joint]
        R = FINGERS[0].rotation(INITIAL + by) @ FINGERS[0].rotation(INITIAL).T
        w = np.array([R[2, 1], R[0, 2], R[1, 0]]) / step
        assert FINGERS[0].turning(INITIAL)[:, joint] == pytest.approx(w, abs=1e-5)


@pytest.mark.parametrize("page", [quasi_static, violation_implicit])
def test_derivatives_are_those_of_finite_differences(recorded, joints, page):
    data, scene, _ = recorded
    scene = replace(scene, sigma_offset=joints)
    problem, _ = programme(page, data.select([1]), scene)
    rng = np.random.default_rng(0)
    start = {
        name: v.guess + 0.3 * v.scale[:, None] * rng.normal(size=v.guess.shape)
        for name, v in problem.variables.items()
    }
    report = problem.check(start)
    worst = max(max(errors) for errors in report.derivatives.values())
    assert max(worst, report.assembled) < 1e-4, str(report)


@pytest.mark.parametrize(
    "page", [quasi_static, pytest.param(violation_implicit, marks=pytest.mark.slow)]
)
def test_an_offset_is_the_same_as_fingers_elsewhere_and_turned(recorded, joints, page):
    data, scene, _ = recorded
    data, e = data.select([0, 1]), 1e-3 * np.array([[1.5, -1.0, 0.5], [-2.0, 1.0, 0.4]])
    known, _ = programme(page, data, scene)
    turned = said(data, joints, e)
    open_, _ = programme(page, turned, replace(scene, sigma_offset=joints))
    size = {name: v.guess + 0 * v.scale[:, None] for name, v in known.variables.items()}
    for name in ("touch", "free"):
        there = known.value(name, known.pack(size), known.data())
        x = open_.pack(size | {"finger offset": e.T})
        here = open_.value(name, x, open_.data())
        # off(p) is taken where fingers say they are; turns are of first order
        assert here == pytest.approx(there, rel=2e-2, abs=2e-2), name


def test_what_all_fingers_have_in_common_shows_in_how_sides_lean(told, joints):
    estimate, _, e = told
    C = estimate.information.covariance("finger_offset")
    off = (estimate.finger_offset - e).ravel()
    assert off @ np.linalg.solve(C, off) / 6 < 2.1  # 95 % of chi^2 of six
    both = np.tile(np.eye(3), 2) / 2
    common = np.sqrt(np.diag(both @ C @ both.T))
    prior = np.sqrt(np.diag(joints.covariance.sum(axis=0)) / 4)
    assert common[0] < 0.6 * prior[0]  # along the line on which the fingers face
    seen = estimate.seen_positions - estimate.measurements.finger_position
    apart = joints.displacement(
        estimate.measurements.finger_position, estimate.finger_offset
    )
    assert np.allclose(seen, apart)


def test_it_survives_a_file_and_the_next_action_is_chosen_with_it(told, tmp_path):
    estimate, scene, _ = told
    estimate.save(tmp_path / "estimate.npz")
    again = Estimate.load(tmp_path / "estimate.npz")
    assert again.scene == scene
    assert "finger 1 by (" in again.summary()
    space = Workspace(finger_radius=float(estimate.measurements.finger_radius[0]))
    expected = ExpectedInformation(again, space, hypotheses=1)
    assert expected.gain(space.action([0.2, 0.1, -0.2, 0.1])) > 0


def test_a_tilted_ground_changes_nothing_but_the_frame(joints):
    ground = Ground(height=0.01, normal=(0.1, -0.2, np.sqrt(0.95)))
    there, R = joints.in_frame_of(ground), ground.rotation
    e = 1e-3 * np.array([[1.0, 2.0, 3.0], [-3.0, 2.0, 1.0]])
    p = np.array([[0.04, 0.01, 0.03], [-0.05, 0.02, 0.06]])
    assert there.displacement(ground.to_ground(p), e @ R.T) == pytest.approx(
        joints.displacement(p, e) @ R.T
    )
    turn = [np.einsum("fij,fj->fi", j.turn, x) for j, x in
            ((there, e @ R.T), (joints, e))]  # fmt: skip
    assert turn[0] == pytest.approx(turn[1] @ R.T)


def test_joint_zeros_of_wrong_shapes_are_refused(joints, recorded):
    known = joints_about(FINGERS, PLACES)
    for sigma in (0, -1, 1.0, "a degree", None, [0.1]):  # 1.0: one degree in degrees
        with pytest.raises(SceneError, match="one degree"):
            JointZeros(sigma, **known)
    for name in known:
        for wrong in (None, "here", known[name][0], known[name][:1, :2]):
            with pytest.raises(SceneError, match="not an array of this shape"):
                JointZeros(DEGREE, **known | {name: wrong})
    with pytest.raises(SceneError, match="independent"):
        JointZeros(DEGREE, **known | {"jacobian": np.zeros((2, 6, 3))})
    with pytest.raises(SceneError, match="ground"):
        Scene(ground=None, sigma_offset=joints)
    alone = JointZeros(DEGREE, **joints_about(FINGERS[:1], PLACES[:1]))
    with pytest.raises(SceneError, match="another number of fingers"):
        solve_estimate(recorded[0], Scene(sigma_offset=alone))


def test_the_prior_of_offsets_is_told_in_the_world_whatever_the_ground(
    recorded, joints
):
    """Where the time limit comes first, they have the covariance of their joints."""
    data, scene, _ = recorded
    tilted = Ground(0.0, (0.0, -np.sin(0.3), np.cos(0.3)))
    R = tilted.rotation.T  # the same motion, on a ground that leans
    scene = replace(scene, ground=tilted, sigma_offset=joints)
    data = data.select([0]).transformed(R, np.zeros(3))
    at_once = Options(time_limit=1e-3, check_mistakes=False)
    late = solve_estimate(data, scene, options=at_once, throw=False)
    prior = [np.linalg.inv(part) for part in joints.information.reshape(-1, 3, 3)]
    assert late.information.offsets == pytest.approx(block_diag(*prior))
