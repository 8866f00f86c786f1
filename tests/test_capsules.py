"""Capsule fingertips, whose positions have an orientation below them."""

from dataclasses import replace

import numpy as np
import pytest

from formulations.finger import SPHERE, capsule
from tactilenlp import Measurements, Options, solve_estimate
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
