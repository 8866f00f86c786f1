"""Capsule fingertips, whose positions have an orientation below them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formulations.finger import SPHERE, capsule
from tactilenlp import Measurements, Options, solve_estimate
from tactilenlp.errors import MeasurementError
from tactilenlp.evaluation.metrics import cuboid_errors
from tactilenlp.problem.fingertips import finger_of, finger_poses


@pytest.fixture
def upright(recorded):
    """Two actions of the shipped recording, by capsules that stand upright."""
    data, scene, _ = recorded
    data = data.select([0, 1])
    wxyz = np.tile([1.0, 0.0, 0.0, 0.0], (*data.contact.shape, 1))
    data = Measurements(**data.arrays() | {"finger_orientation": wxyz})
    return data, replace(scene, finger_length=0.01)


def test_fingertips_of_a_scene_are_as_long_as_it_says(upright):
    data, scene = upright
    assert finger_of(scene) is capsule(scene.finger_length / 2)
    assert finger_of(replace(scene, finger_length=0.0)) is SPHERE
    assert finger_poses(data, scene).shape[-1] == capsule(0.005).numbers


@pytest.mark.slow
def test_upright_capsules_tell_of_sides_what_spheres_do(upright, estimate):
    data, scene = upright
    found = solve_estimate(data, scene, options=Options(without="planar"))
    sphere = solve_estimate(data, replace(scene, finger_length=0.0))
    off = (found.side_lengths - sphere.side_lengths)[:2]
    assert np.abs(off / found.information.sigma("side_lengths")[:2]).max() < 1
    assert not found.reductions["planar"]
    assert np.isfinite(found.information.sigma("position")).all()


def with_capsules(data, length, rng):
    """Return the data as capsules measure them whose near ends touch as the spheres do.

    Each leans by about 15 degrees from its normal and sways by some during a push.
    """
    q = np.zeros((*data.contact.shape, 4))
    p = data.finger_position.copy()
    for f in range(data.fingers):
        for action in np.unique(data.action):
            rows = np.nonzero(data.action == action)[0]
            touch = data.normal[rows, f].sum(axis=0)
            ahead = touch if touch.any() else np.array([0, 0, 1.0])
            axis = ahead / np.linalg.norm(ahead) + 0.25 * rng.normal(size=3)
            R = Rotation.align_vectors([axis], [[0, 0, 1.0]])[0]
            sway = Rotation.from_rotvec(
                np.outer(0.1 * np.sin(np.arange(len(rows)) / 5), rng.normal(size=3))
            )
            R = sway * R
            q[rows, f] = np.roll(R.as_quat(), 1, axis=1)
            p[rows, f] += R.apply([0, 0, length / 2])
    return replace(data, finger_position=p, finger_orientation=q)


@pytest.mark.slow
def test_capsules_measure_a_box_as_well_as_spheres(recorded):
    data, scene, truth = recorded
    length, data = 0.03, data.select(range(3))
    data = with_capsules(data, length, np.random.default_rng(12))
    estimate = solve_estimate(data, replace(scene, finger_length=length))
    last = data.samples - 1
    error = cuboid_errors(
        estimate.side_lengths, estimate.position[-1], estimate.quaternion[-1],
        truth["side_lengths"], truth["object_position"][last],
        truth["object_quaternion"][last],
    )  # fmt: skip
    sigma = estimate.information.sigma("side_lengths")[error.permutation]
    known = sigma < 1e-3
    assert known.any()
    # The near ends touch where the spheres did, to the barrier's micrometres.
    assert np.abs(error.side_lengths[known]).max() < 0.1e-3
    assert (np.abs(error.side_lengths) < 3 * sigma).all()


def test_capsules_without_an_orientation_are_refused(recorded):
    data, scene, _ = recorded
    with pytest.raises(MeasurementError, match="finger_orientation"):
        solve_estimate(data, replace(scene, finger_length=0.03))
