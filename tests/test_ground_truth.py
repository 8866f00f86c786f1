"""The error of an estimate, from the ground truth of worlds that have one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trimesh.convex import convex_hull
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix

from tactilenlp import (
    CYLINDER,
    Scene,
    TrueBody,
    World,
    explore,
    plot_estimate,
    solve_estimate,
)
from tactilenlp.errors import OptionError, TactileError
from tactilenlp.evaluation.metrics import errors_of

QUARTER = Rotation.from_rotvec([0, 0, np.pi / 2])


class Holding:
    """A world in which the object lies where the estimate says, but shifted."""

    def __init__(self, estimate, shift=(0, 0, 0), sides=None, turn=None, hull=False):
        self.estimate, self.shift, self.hull = estimate, np.array(shift), hull
        self.sides = estimate.side_lengths if sides is None else sides
        self.turn = estimate.quaternion[-1] if turn is None else turn

    def true_body(self, time):
        times = self.estimate.measurements.time
        if not np.isclose(times, time).any():
            return None
        where = self.estimate.position[-1] + self.shift
        place = quaternion_matrix(self.turn)
        place[:3, 3] = where
        if self.hull:
            mesh = convex_hull(self.estimate.vertices).apply_transform(place)
            return TrueBody(mesh, where, self.turn)
        return TrueBody(box(self.sides, place), where, self.turn, self.sides)


def test_an_estimate_that_is_the_truth_is_off_by_nothing(estimate):
    errors = errors_of(Holding(estimate), estimate)
    names = {"surface", "surface_max", "position", "side_lengths", "rotation"}
    assert errors.keys() == names
    # rounding, of a mesh of a few centimetres
    assert max(errors.values()) < 1e-6


def test_a_shift_along_a_face_normal_moves_two_faces_by_as_much(estimate):
    errors = errors_of(Holding(estimate, shift=(0, 0, 1e-3)), estimate)
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
    turn = Rotation.from_quat(estimate.quaternion[-1], scalar_first=True) * QUARTER
    turn = turn.as_quat(scalar_first=True)
    world = Holding(estimate, sides=estimate.side_lengths[[1, 0, 2]], turn=turn)
    errors = errors_of(world, estimate)
    assert max(errors.values()) < 1e-6


def test_of_a_hull_surface_and_centroid_are_compared(estimate):
    errors = errors_of(Holding(estimate, hull=True), estimate)
    assert errors.keys() == {"surface", "surface_max", "position"}
    assert max(errors.values()) < 1e-6


def test_a_world_without_a_truth_at_that_instant_gives_no_error(estimate):
    assert errors_of(object(), estimate) == {}
    assert errors_of(SimpleNamespace(true_body=None), estimate) == {}
    assert errors_of(SimpleNamespace(truth="of something else"), estimate) == {}
    data, world = estimate.measurements, Holding(estimate)
    later = replace(estimate, measurements=replace(data, time=data.time + 1.0))
    assert errors_of(world, later) == {}


def test_a_truth_of_another_type_is_named(estimate):
    world = SimpleNamespace(true_body=lambda time: (1, 2))
    with pytest.raises(OptionError, match=r"world\.true_body.*TrueBody"):
        errors_of(world, estimate)


def test_what_is_no_method_of_a_world_is_refused_before_the_first_command():
    class Odd:
        true_body = np.zeros(3)

        def execute(self, trajectory):
            raise AssertionError("a command was given")

    with pytest.raises(OptionError, match=r"world\.true_body.*TouchedWorld"):
        next(explore(Odd(), Scene()))
    with pytest.raises(OptionError, match=r"execute\(trajectory\)"):
        next(explore(object(), Scene()))


def test_a_world_with_a_truth_of_its_own_kind_is_explored(world_of_a_box):
    class Mine:
        truth, finger_radius = "in my own words", world_of_a_box.finger_radius

        def execute(self, trajectory):
            return world_of_a_box.execute(trajectory)

    step = next(explore(Mine(), Scene(), actions=0, centre=(0.0, 0.0)))
    assert step.errors == {}


@pytest.fixture
def world_of_a_box():
    return World((0.04, 0.05, 0.045))


def test_what_a_body_is_follows_from_its_shape_and_not_from_its_name(
    recorded, estimate
):
    """A cylinder that its user calls "cuboid" has no sides, a box named "brick" has."""
    data, scene, _ = recorded
    named = replace(CYLINDER, name="cuboid")
    how = {"formulation": "quasi_static", "throw": False}
    can = solve_estimate(data.select(range(2)), scene, shape=named, **how)
    assert can.shape == "cuboid"
    assert can.summary().startswith("A cuboid of diameter ")
    true = Holding(can, sides=np.array([0.04, 0.03, 0.02]))
    assert errors_of(true, can).keys() == {"surface", "surface_max", "position"}
    titles = [axis.get_title() for axis in plot_estimate(can).axes]
    assert not any("sizes alone" in title for title in titles)
    with pytest.raises(TactileError, match="has side lengths"):
        _ = can.side_lengths
    brick = replace(estimate, shape="brick")
    assert "side_lengths" in errors_of(Holding(brick), brick)
    assert "sizes alone" in plot_estimate(brick).axes[0].get_title()
    assert brick.summary().startswith("A brick of ")
