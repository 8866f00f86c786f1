"""Sensors that are turned: their turns are found, and only where data ask for them."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formulations.finger_turn import turned_back
from formulations.names import FINGER_TURN
from tactilenlp import Estimate, Ground, cuboid_errors, solve_estimate
from tactilenlp.geometry.faces import KNOWN_FACE, touched_faces

TURNS = np.radians([[1.0, -2.0, 1.5], [-3.0, 1.0, -1.0]])  # of two fingers


def askew(data, turns):
    """Return measurements of sensors that are turned (fingers, 3) [rad]."""
    normal = np.stack(
        [Rotation.from_rotvec(w).apply(np.array(data.normal[:, f]))
         for f, w in enumerate(turns)], axis=1,
    )  # fmt: skip
    return replace(data, normal=np.where(data.contact[..., None], normal, 0.0))


@pytest.mark.parametrize("angle", [0.02, 0.1])
def test_a_turned_normal_is_turned_back_to_second_order(angle):
    n, w = np.array([0.6, 0.0, 0.8]), angle * np.array([2.0, -1.0, 2.0]) / 3
    told = ca.DM(np.r_[Rotation.from_rotvec(w).apply(n), w])
    error = np.linalg.norm(np.asarray(turned_back(told)).ravel() - n)
    assert error < 1.01 * angle**3 / 6
    assert np.linalg.norm(np.asarray(told[:3]).ravel() - n) > 0.3 * angle


def test_sensors_stay_aligned_where_the_fit_is_good(estimate):
    assert estimate.finger_turn is None
    (aligned,) = [s for s in estimate.skipped if s.name == "aligned"]
    assert aligned.holds
    assert aligned.value < aligned.limit


@pytest.mark.slow
def test_turns_of_the_sensors_are_found_and_the_box_is_as_before(
    recorded, estimate, tmp_path
):
    data, scene, truth = recorded
    data = data.select(np.unique(estimate.measurements.action))
    found = solve_estimate(askew(data, TURNS), scene)
    assert found.fit.verdict == "good"
    assert (found.faces >= KNOWN_FACE).sum() == (estimate.faces >= KNOWN_FACE).sum()
    assert "normals are turned" in found.summary()
    # Turns of all sensors about the vertical turn the world: only the prior tells.
    off = found.finger_turn - TURNS
    off[:, 2] -= off[:, 2].mean()
    assert np.degrees(np.abs(off).max()) < 0.3
    last = data.samples - 1
    pose = truth["object_position"][last], truth["object_quaternion"][last]
    errors = [
        cuboid_errors(
            e.side_lengths, e.position[-1], e.quaternion[-1], truth["side_lengths"],
            *pose,
        )
        for e in (found, estimate)
    ]  # fmt: skip
    sigma = [e.information.sigma("side_lengths")[error.permutation]
             for e, error in zip((found, estimate), errors, strict=True)]  # fmt: skip
    assert (np.abs(errors[0].side_lengths) < 3 * sigma[0]).all()
    known = sigma[1] < 0.3e-3
    assert known.any()
    assert np.abs(errors[0].side_lengths)[known].max() < 0.3e-3
    found.save(tmp_path / "askew.npz")
    again = Estimate.load(tmp_path / "askew.npz")
    np.testing.assert_array_equal(again.finger_turn, found.finger_turn)


@pytest.mark.slow
def test_turns_that_all_sensors_have_in_common_are_a_tilt_of_the_ground(
    recorded, estimate
):
    data, scene, _ = recorded
    data = data.select(np.unique(estimate.measurements.action))
    turn = Rotation.from_rotvec([np.radians(4.0), 0, 0])
    # The point of the ground that stays is below the first touches.
    first = data.contact & (data.action == data.action[0])[:, None]
    about = data.finger_position[first].mean(axis=0) * (1, 1, 0)
    leaning = data.transformed(turn.as_matrix(), about - turn.apply(about))
    found = solve_estimate(leaning, scene)
    assert found.finger_turn is None
    assert found.fit.verdict == "good"
    off = found.scene.ground.tilt - turn.as_rotvec()
    assert np.degrees(np.abs(off).max()) < 0.2
    known = estimate.information.sigma("side_lengths") < 0.3e-3
    sides = np.sort(found.side_lengths) - np.sort(estimate.side_lengths)
    # The prior of a tilt, half a degree, takes some of the 4, and of the height.
    assert np.abs(sides[known[np.argsort(estimate.side_lengths)]]).max() < 0.201e-3


def test_touches_of_a_turned_sensor_are_of_the_faces_that_it_felt(estimate):
    """And are drawn there: turns that were found are taken back from what is felt."""
    turns = np.radians([[0.0, 0.0, 10.0], [12.0, 0.0, 0.0]])
    data = askew(estimate.measurements, turns)
    found = replace(
        estimate, measurements=data,
        unknowns=estimate.unknowns | {FINGER_TURN: turns.T},
    )  # fmt: skip
    q = estimate.quaternion
    told = touched_faces(estimate.measurements, q)
    assert told.max() >= KNOWN_FACE
    assert touched_faces(data, q).sum() < told.sum() / 2
    np.testing.assert_array_equal(touched_faces(data, q, turns=turns), told)
    for one, other in zip(found.contacts(), estimate.contacts(), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_turns_are_in_the_frame_of_the_world(estimate):
    """Also where the ground's frame, in which the page is written, is another one."""
    ground = Ground(
        normal=tuple(Rotation.from_euler("x", 30, degrees=True).apply([0, 0, 1]))
    )
    w = np.array([[0.05, 0.02, -0.03], [0.0, -0.01, 0.02]])
    leaning = replace(
        estimate, scene=replace(estimate.scene, ground=ground),
        unknowns=estimate.unknowns | {FINGER_TURN: (w @ ground.rotation.T).T},
    )  # fmt: skip
    np.testing.assert_allclose(leaning.finger_turn, w, atol=1e-12)
