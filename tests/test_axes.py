"""The axes of a box are named by convention, and keep their names in updates."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactilenlp import CUBOID, CYLINDER, Guess, solve_estimate
from tactilenlp.geometry.transforms import rotation_matrix
from tactilenlp.local.comparison import same_body
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.refinement.axis_names import canonical_relabelling, with_axes


def in_canonical_axes(shape, h, like=None):
    """Return the hypothesis with the axes that the convention names."""
    order, S = canonical_relabelling(shape, h, like)
    return replace(h, theta=h.theta[order], x=with_axes(h.x, S))


def planar(theta, yaw, samples=4):
    """Return a box that turns by 0.1 rad from sample to sample."""
    yaws = yaw + 0.1 * np.arange(samples)
    place = np.linspace([0.01, -0.02], [0.02, 0.0], samples).T
    return Hypothesis(np.array(theta), np.vstack([place, yaws]), 1.0, ("track",))


def free(theta, R, samples=4):
    """Return a box in free motion whose first rotation is R."""
    turns = Rotation.from_rotvec(np.outer(np.arange(samples), [0.1, 0.2, -0.1]))
    x = np.vstack([np.full((3, samples), 0.03), (turns * R).as_rotvec().T])
    return Hypothesis(np.array(theta), x, 1.0, ("track",))


@pytest.mark.parametrize("yaw", np.radians([-170, -91, -89, -20, 0, 45, 89, 135, 179]))
@pytest.mark.parametrize("sides", [(0.05, 0.03, 0.04), (0.03, 0.05, 0.04)])
def test_x_is_the_longer_side_and_points_ahead(sides, yaw):
    h = planar(sides, yaw)
    found = in_canonical_axes(CUBOID, h)
    assert found.theta.tolist() == [0.05, 0.03, 0.04]
    assert rotation_matrix(found.x[:, 0])[0, 0] >= 0
    assert same_body(CUBOID, h, found, range(4))
    assert (canonical_relabelling(CUBOID, found)[1] == np.eye(3)).all()


@pytest.mark.parametrize("seed", range(6))
def test_z_is_upright_at_the_first_sample_of_a_body_in_free_motion(seed):
    R = Rotation.random(random_state=seed)
    h = free((0.03, 0.05, 0.04), R)
    found = in_canonical_axes(CUBOID, h)
    up = rotation_matrix(found.x[:, 0])[2]
    assert up[2] == pytest.approx(np.abs(R.as_matrix()[2]).max(), abs=1e-12)
    assert found.theta[0] >= found.theta[1]
    assert rotation_matrix(found.x[:, 0])[0, 0] >= 0
    assert same_body(CUBOID, h, found, range(4))


@pytest.mark.parametrize("make", [planar, lambda t, yaw: free(t, about_z(yaw))])
def test_an_update_keeps_the_names_of_its_start(make):
    start = planar((0.0301, 0.0299, 0.04), 0.2)
    like = start.theta, (R := rotation_matrix(start.x[:, 0]))
    later = make((0.0303, 0.0297, 0.04), 0.2 + np.pi / 2)  # x and y are exchanged
    found = in_canonical_axes(CUBOID, later, like)
    assert found.theta.tolist() == [0.0297, 0.0303, 0.04]
    assert rotation_matrix(found.x[:, 0]) == pytest.approx(R, abs=1e-9)
    assert same_body(CUBOID, later, found, range(4))


def about_z(yaw):
    return Rotation.from_rotvec([0, 0, yaw])


def test_only_boxes_have_axes_to_name():
    h = Hypothesis(np.array([0.03, 0.05]), np.zeros((3, 2)), 0.0, ())
    other = SimpleNamespace(faced=False)
    for given in ((CYLINDER, h), (other, h, (h.theta, None))):
        order, S = canonical_relabelling(*given)
        assert order == [0, 1]
        assert (np.eye(3) == S).all()


def test_a_box_whose_symmetries_are_not_told_keeps_its_axes(recorded):
    plain = replace(CUBOID, symmetries=(), size_prior=((0.05, 0.04, 0.045), 0.02))
    order, S = canonical_relabelling(plain, planar((0.03, 0.05, 0.04), 2.0))
    assert order == [0, 1, 2]
    assert (np.eye(3) == S).all()
    data, scene, _ = recorded
    assert solve_estimate(data.select([0]), scene, shape=plain).success


def test_the_shipped_box_is_named_by_the_convention(estimate):
    x, y, _ = estimate.side_lengths
    assert x > y
    R = Rotation.from_quat(np.roll(estimate.quaternion[0], -1)).as_matrix()
    assert R[2, 2] == pytest.approx(1.0, abs=1e-9)
    assert R[0, 0] >= 0


@pytest.mark.slow
def test_a_recording_that_is_turned_gives_the_same_names(recorded, estimate):
    R = Rotation.from_rotvec([0, 0, np.radians(100)]).as_matrix()
    data, scene, _ = recorded
    turned = data.select(range(3)).transformed(R, np.zeros(3))
    turned = solve_estimate(turned, scene)
    off = np.abs(turned.side_lengths - estimate.side_lengths)
    assert off.max() < 0.3e-3


@pytest.mark.slow
def test_a_guess_keeps_the_names_of_the_user(recorded, estimate):
    data, scene, _ = recorded
    x, y, z = estimate.side_lengths
    yaw = Rotation.from_quat(np.roll(estimate.quaternion[0], -1)).as_rotvec()[2]
    guess = Guess([y, x, z], estimate.position[0], yaw=yaw + np.pi / 2)
    found = solve_estimate(data.select(range(3)), scene, start=guess)
    assert found.side_lengths == pytest.approx([y, x, z], abs=0.3e-3)
