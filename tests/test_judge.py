"""How far off an estimate is, told by worlds that know it, and by no others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactilenlp.evaluation.ground_truth import errors_of, true_mesh

QUARTER = Rotation.from_rotvec([0, 0, np.pi / 2])


def holding(estimate, shift=(0, 0, 0), **body):
    """Return a world in which the object lies where the estimate says, but shifted."""
    truth = SimpleNamespace(
        object_position=estimate.position + np.array(shift),
        object_quaternion=estimate.quaternion,
    )
    body = body or {"side_lengths": estimate.side_lengths}
    return SimpleNamespace(truth=truth, measurements=estimate.measurements, **body)


def test_an_estimate_that_is_the_truth_is_off_by_nothing(estimate):
    errors = errors_of(holding(estimate), estimate)
    names = {"surface", "surface_max", "position", "side_lengths", "rotation"}
    assert errors.keys() == names
    # rounding, of a mesh of a few centimetres
    assert max(errors.values()) < 1e-6


def test_a_shift_along_a_face_normal_moves_two_faces_by_as_much(estimate):
    errors = errors_of(holding(estimate, shift=(0, 0, 1e-3)), estimate)
    assert errors["position"] == pytest.approx(1e-3)
    # 2000 points miss the very corners by less than their spacing
    assert errors["surface_max"] == pytest.approx(1e-3, rel=1e-6)
    x, y, z = estimate.side_lengths
    share = x * y / (x * y + y * z + z * x)  # of top and bottom
    # and next to nothing of the other four, so that points on them weigh 2 %
    assert errors["surface"] == pytest.approx(share * 1e-3, rel=0.02)
    assert errors["side_lengths"] < 1e-9
    assert errors["rotation"] < 1e-6


def test_relabelled_axes_of_the_true_box_are_the_same_box(estimate):
    turn = Rotation.from_quat(np.roll(estimate.quaternion, -1, axis=1)) * QUARTER
    world = holding(estimate, side_lengths=estimate.side_lengths[[1, 0, 2]])
    world.truth.object_quaternion = np.roll(turn.as_quat(), 1, axis=1)
    errors = errors_of(world, estimate)
    assert max(errors.values()) < 1e-6


def test_of_a_hull_surface_and_centroid_are_compared(estimate):
    world = holding(estimate, vertices=estimate.vertices)
    errors = errors_of(world, estimate)
    assert errors.keys() == {"surface", "surface_max", "position"}
    assert max(errors.values()) < 1e-6
    mesh, mean = true_mesh(world, estimate.measurements.time[0]), estimate.position[0]
    assert np.allclose(mesh.centroid, mean, atol=1e-9)


def test_a_world_without_a_truth_of_that_instant_tells_nothing(estimate):
    assert errors_of(object(), estimate) == {}
    assert errors_of(SimpleNamespace(truth=None), estimate) == {}
    data, world = estimate.measurements, holding(estimate)
    later = replace(estimate, measurements=replace(data, time=data.time + 1.0))
    assert errors_of(world, later) == {}
