"""Errors of size and pose, modulo the symmetries of the body."""

import numpy as np
import pytest
from bodies import POSITION, QUATERNION, ROUNDING, SIDES, matrix, wxyz
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from tactilenlp.errors import TactileError
from tactilenlp.evaluation.metrics import cuboid_errors


@pytest.mark.parametrize("symmetry", Rotation.create_group("O").as_matrix())
def test_each_of_the_24_relabelings_of_a_box_is_no_error(symmetry):
    sides = np.abs(symmetry.T) @ SIDES
    rotation = matrix(QUATERNION) @ symmetry
    error = cuboid_errors(sides, POSITION, wxyz(rotation), SIDES, POSITION, -QUATERNION)
    assert_allclose(error.side_lengths, 0, atol=ROUNDING)
    assert_allclose(error.position, 0, atol=ROUNDING)
    assert error.rotation_angle == pytest.approx(0, abs=ROUNDING)
    assert_allclose(sides[error.permutation], SIDES, atol=ROUNDING)
    assert_allclose(error.symmetry, symmetry.T, atol=ROUNDING)


def test_errors_are_signed_and_belong_to_the_true_axes():
    symmetry = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    turn = np.array([0.02, -0.01, 0.03])
    rotation = Rotation.from_rotvec(turn).as_matrix() @ matrix(QUATERNION) @ symmetry
    size_error, shift = np.array([0.001, -0.002, 0.003]), np.array([1e-3, 0, -2e-3])
    sides = (SIDES + size_error)[[1, 0, 2]]
    error = cuboid_errors(
        sides, POSITION + shift, wxyz(rotation), SIDES, POSITION, QUATERNION
    )
    assert_allclose(error.side_lengths, size_error, atol=ROUNDING)
    assert_allclose(error.position, shift, atol=ROUNDING)
    assert_allclose(error.rotation_vector, turn, atol=ROUNDING)
    assert error.rotation_angle == pytest.approx(np.linalg.norm(turn), rel=1e-9)
    assert_array_equal(error.permutation, [1, 0, 2])


def test_a_covariance_permutes_with_the_sizes():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    for symmetry in Rotation.create_group("O").as_matrix():
        rotation = matrix(QUATERNION) @ symmetry
        labels = cuboid_errors(
            SIDES, POSITION, wxyz(rotation), SIDES, POSITION, QUATERNION
        ).permutation
        relabel = np.eye(3)[labels]
        assert_allclose(
            covariance[np.ix_(labels, labels)], relabel @ covariance @ relabel.T
        )
        # The relabeled body axes are the true ones up to sign: a size travels along.
        assert_allclose(relabel, np.abs(symmetry), atol=ROUNDING)


def test_the_relabeled_estimate_differs_from_the_truth_by_the_rotation_vector():
    rng = np.random.default_rng(1)
    for estimate, truth in Rotation.random(40, rng).as_matrix().reshape(20, 2, 3, 3):
        error = cuboid_errors(
            SIDES, POSITION, wxyz(estimate), SIDES, POSITION, wxyz(truth)
        )
        turned = Rotation.from_rotvec(error.rotation_vector).as_matrix() @ truth
        assert_allclose(estimate @ error.symmetry, turned, atol=ROUNDING)
        # No two cubes differ by more than 62.8 degrees (the disorientation of cubes).
        assert error.rotation_angle <= np.deg2rad(62.8) + np.deg2rad(1)
        assert np.linalg.det(error.symmetry) == pytest.approx(1)


@pytest.mark.parametrize("degrees", [44.8, 45.0, 45.2])
def test_near_forty_five_degrees_the_sizes_tell_the_labels(degrees):
    yaw = Rotation.from_rotvec([0, 0, np.deg2rad(degrees)]).as_matrix()
    error = cuboid_errors(SIDES, POSITION, wxyz(yaw), SIDES, POSITION, [1, 0, 0, 0])
    assert_allclose(error.side_lengths, 0, atol=ROUNDING)
    assert error.rotation_angle == pytest.approx(np.deg2rad(degrees), rel=1e-9)


def test_moving_both_cuboids_moves_no_error():
    move = matrix(QUATERNION)
    estimate = Rotation.from_rotvec([0.1, 0.7, -0.2]).as_matrix()
    plain = cuboid_errors(
        1.1 * SIDES, [0.001, 0, 0], wxyz(estimate), SIDES, [0, 0, 0], [1, 0, 0, 0]
    )
    moved = cuboid_errors(
        1.1 * SIDES,
        POSITION + move @ [0.001, 0, 0],
        wxyz(move @ estimate),
        SIDES,
        POSITION,
        QUATERNION,
    )
    assert_allclose(moved.side_lengths, plain.side_lengths, atol=ROUNDING)
    assert_allclose(moved.position, move @ plain.position, atol=ROUNDING)
    assert_allclose(moved.rotation_vector, move @ plain.rotation_vector, atol=1e-9)


@pytest.mark.parametrize(
    ("index", "value", "where"),
    [
        (0, [0.03, 0, 0.06], "side_lengths.*positive"),
        (0, [0.03, 0.06], "side_lengths.*shape"),
        (1, [0, 0, np.inf], "position.*finite"),
        (2, [1, 0, 0], "quaternion.*shape"),
        (2, [0, 0, 0, 0], "quaternion.*length 1"),
        (3, [-0.03, 0.04, 0.05], "true_side_lengths.*positive"),
        (4, None, "true_position"),
        (5, [1, 1, 0, 0], "true_quaternion.*length 1"),
    ],
)
def test_a_cuboid_that_cannot_be_is_refused(index, value, where):
    body = [SIDES, POSITION, QUATERNION] * 2
    body[index] = value
    with pytest.raises(TactileError, match=where):
        cuboid_errors(*body)
