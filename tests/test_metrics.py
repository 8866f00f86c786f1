"""The metrics against geometry that can be worked out by hand."""

import time

import numpy as np
import pytest
import trimesh
from bodies import POSITION, QUATERNION, ROUNDING, SAMPLING, SIDES, cuboid, matrix, wxyz
from numpy.testing import assert_allclose
from scipy.integrate import dblquad
from scipy.spatial.transform import Rotation
from trimesh.creation import icosphere
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp.errors import OptionError, TactileError
from tactilenlp.evaluation.metrics import surface_distance


def test_two_equal_boxes_are_at_distance_zero():
    a, b = (cuboid(SIDES, POSITION, QUATERNION) for _ in range(2))
    distance = surface_distance(a, b)
    assert distance.mean == pytest.approx(0, abs=ROUNDING)
    assert distance.maximum == pytest.approx(0, abs=ROUNDING)


def test_a_relabeled_box_is_the_same_surface():
    turned = matrix(QUATERNION) @ Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    other = cuboid(SIDES[[1, 0, 2]], POSITION, wxyz(turned))
    distance = surface_distance(cuboid(SIDES, POSITION, QUATERNION), other)
    assert distance.maximum == pytest.approx(0, abs=ROUNDING)


def test_concentric_cubes_are_apart_by_face_edge_and_corner_regions():
    inner, gap = 0.03, 0.005
    outer = inner + 2 * gap
    distance = surface_distance(cuboid([inner] * 3), cuboid([outer] * 3))
    # Every point of the inner cube is one gap from the face above it.  Of each outer
    # face, a square sees the inner face, four strips an edge, four squares a corner.
    strip = gap**2 / 2 * (np.sqrt(2) + np.arcsinh(1))
    corner = gap**3 * dblquad(lambda s, t: np.sqrt(1 + s * s + t * t), 0, 1, 0, 1)[0]
    inwards = (inner**2 * gap + 4 * inner * strip + 4 * corner) / outer**2
    assert distance.a_to_b == pytest.approx(gap, rel=1e-9)
    assert distance.b_to_a == pytest.approx(inwards, rel=SAMPLING)
    assert distance.mean == (distance.a_to_b + distance.b_to_a) / 2
    assert distance.maximum == pytest.approx(np.sqrt(3) * gap, rel=1e-9)


def test_a_box_shifted_along_an_axis_is_off_by_the_shift():
    shift, (_, b, c) = 0.002, SIDES
    distance = surface_distance(cuboid(SIDES), cuboid(SIDES, [shift, 0, 0]))
    # The face that came out is off by the shift, the sides' overhang by what hangs
    # over, the face that went in by the nearest of the face behind and the four sides.
    area = 2 * (SIDES[0] * b + b * c + c * SIDES[0])
    mean = (2 * b * c * shift + 4 * shift**3 / 3) / area
    assert distance.maximum == pytest.approx(shift, rel=1e-9)
    assert distance.mean == pytest.approx(mean, rel=SAMPLING)


def test_a_box_shifted_diagonally_is_off_most_at_its_corner():
    distance = surface_distance(cuboid(SIDES), cuboid(SIDES, [0.001, 0.002, 0.002]))
    assert distance.maximum == pytest.approx(0.003, rel=1e-9)


def test_a_hull_with_many_faces_is_measured_as_exactly_as_a_box():
    # A radius apart everywhere; an icosphere of 1280 faces sags by less than 0.5 %.
    small, large = icosphere(3, radius=0.02), icosphere(3, radius=0.03)
    distance = surface_distance(small, large)
    assert distance.mean == pytest.approx(0.01, rel=0.02)


def test_triangles_far_below_a_millimetre_change_nothing():
    coarse, other = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0, 0])
    fine = coarse.subdivide().subdivide().subdivide().subdivide()
    tiny = cuboid(SIDES / 100), cuboid(1.1 * SIDES / 100, [1e-5, 0, 0])
    expected = surface_distance(coarse, other)
    assert surface_distance(other, fine).a_to_b == pytest.approx(
        expected.b_to_a, rel=1e-9
    )
    assert surface_distance(*tiny).mean == pytest.approx(expected.mean / 100, rel=1e-9)


def test_needles_among_the_triangles_change_nothing():
    plain = cuboid(SIDES)
    first, second = plain.vertices[plain.edges[0]]
    middle = (first + second) / 2
    needle = [first, middle, second], [first, first, second]
    soup = np.concatenate((plain.triangles, needle))
    messy = trimesh.Trimesh(**trimesh.triangles.to_kwargs(soup), process=False)
    other = cuboid(1.1 * SIDES, [0.001, 0, 0])
    assert surface_distance(other, messy).a_to_b == pytest.approx(
        surface_distance(other, plain).a_to_b, rel=1e-9
    )


def test_surface_distance_is_symmetric_in_its_arguments():
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    forth, back = surface_distance(a, b), surface_distance(b, a)
    assert (forth.mean, forth.maximum) == (back.mean, back.maximum)
    assert (forth.a_to_b, forth.b_to_a) == (back.b_to_a, back.a_to_b)


def test_the_seed_decides_the_points():
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    assert surface_distance(a, b, seed=3) == surface_distance(a, b, seed=3)
    assert surface_distance(a, b, seed=3).mean != surface_distance(a, b, seed=4).mean


@pytest.mark.parametrize("samples", [500, 2000])
def test_another_seed_stays_within_the_sampling_accuracy(samples):
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    means = [surface_distance(a, b, samples, seed).mean for seed in range(5)]
    # Evenly spread points converge nearly as 1 / N.
    assert_allclose(means, np.mean(means), rtol=SAMPLING * 2000 / samples)


def test_moving_both_bodies_changes_nothing():
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], [0.6, 0, 0.8, 0])
    move = translation_matrix(POSITION) @ quaternion_matrix(QUATERNION)
    moved = [mesh.copy().apply_transform(move) for mesh in meshes]
    expected, got = surface_distance(*meshes), surface_distance(*moved)
    assert_allclose(got.mean, expected.mean, rtol=1e-9)
    assert_allclose(got.maximum, expected.maximum, rtol=1e-9)


def test_distances_grow_with_the_scale_of_both_bodies():
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    scaled = [mesh.copy().apply_scale(1000) for mesh in meshes]
    expected, got = surface_distance(*meshes), surface_distance(*scaled)
    assert_allclose(got.mean, 1000 * expected.mean)


def test_two_boxes_take_less_than_fifty_milliseconds():
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, POSITION / 100, QUATERNION)
    seconds = []
    for _ in range(5):
        start = time.process_time()
        surface_distance(a, b)
        seconds.append(time.process_time() - start)
    assert min(seconds) < 0.05


@pytest.mark.parametrize(
    "mesh", [None, "box", trimesh.Trimesh(), trimesh.PointCloud(np.eye(3))]
)
def test_what_is_no_surface_is_refused(mesh):
    with pytest.raises(TactileError, match=r"mesh_b: unusable.*with an area"):
        surface_distance(cuboid(SIDES), mesh)


def test_a_mesh_that_is_not_finite_or_has_no_area_is_refused():
    for bad in (np.nan, np.inf, 0.0):
        body = cuboid(SIDES)
        body.vertices = body.vertices * bad if bad == 0 else np.full((8, 3), bad)
        with pytest.raises(TactileError, match="mesh_a: unusable"):
            surface_distance(body, cuboid(SIDES))


@pytest.mark.parametrize("samples", [0, -1, 2.5, "many"])
def test_samples_must_be_a_positive_integer(samples):
    with pytest.raises(OptionError, match=r"samples.*integer, 1 or more"):
        surface_distance(cuboid(SIDES), cuboid(SIDES), samples)


def test_seed_must_not_be_negative():
    with pytest.raises(OptionError, match=r"seed.*integer, 0 or more.*-1"):
        surface_distance(cuboid(SIDES), cuboid(SIDES), seed=-1)
