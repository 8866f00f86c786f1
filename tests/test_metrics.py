"""The metrics against geometry that can be worked out by hand."""

import time

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import dblquad
from scipy.spatial.transform import Rotation
from trimesh.creation import box, icosphere
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp.errors import OptionError, TactileError
from tactilenlp.metrics import (
    chamfer_code,
    chamfer_floor,
    chamfer_paper,
    cuboid_errors,
    polytope_pose_error,
    surface_distance,
)

SIDES = np.array([0.03, 0.045, 0.06])
POSITION = np.array([0.1, -0.2, 0.03])
QUATERNION = np.array([0.5, -0.5, 0.1, np.sqrt(0.49)])  # of unit length, wxyz
# 2000 evenly spread points integrate the distance between two boxes to about 0.2 %
# (one sigma over seeds, measured); five of these for a fixed seed.
SAMPLING = 0.01
ROUNDING = 1e-12  # metres and radians, on bodies of centimetres


def cuboid(side_lengths, position=(0, 0, 0), quaternion=(1, 0, 0, 0)):
    return box(
        side_lengths, translation_matrix(position) @ quaternion_matrix(quaternion)
    )


def matrix(quaternion):
    return quaternion_matrix(quaternion)[:3, :3]


def wxyz(rotation):
    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)


# --- exact surface distance ---


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
    assert chamfer_code(a, b, seed=3) == chamfer_code(a, b, seed=3)
    assert chamfer_code(a, b, seed=3) != chamfer_code(a, b, seed=4)


@pytest.mark.parametrize("samples", [500, 2000])
def test_another_seed_stays_within_the_sampling_accuracy(samples):
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    means = [surface_distance(a, b, samples, seed).mean for seed in range(5)]
    # Evenly spread points converge nearly as 1 / N.
    assert_allclose(means, np.mean(means), rtol=SAMPLING * 2000 / samples)


@pytest.mark.parametrize("measure", [surface_distance, chamfer_code])
def test_moving_both_bodies_changes_nothing(measure):
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], [0.6, 0, 0.8, 0])
    move = translation_matrix(POSITION) @ quaternion_matrix(QUATERNION)
    moved = [mesh.copy().apply_transform(move) for mesh in meshes]
    expected, got = measure(*meshes), measure(*moved)
    assert_allclose(
        getattr(got, "mean", got), getattr(expected, "mean", expected), rtol=1e-9
    )
    assert_allclose(
        getattr(got, "maximum", 0), getattr(expected, "maximum", 0), rtol=1e-9
    )


@pytest.mark.parametrize("measure", [surface_distance, chamfer_code])
def test_distances_grow_with_the_scale_of_both_bodies(measure):
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    scaled = [mesh.copy().apply_scale(1000) for mesh in meshes]
    expected, got = measure(*meshes), measure(*scaled)
    assert_allclose(
        getattr(got, "mean", got), 1000 * getattr(expected, "mean", expected)
    )


def test_two_boxes_take_less_than_fifty_milliseconds():
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, POSITION / 100, QUATERNION)
    seconds = []
    for _ in range(5):
        start = time.process_time()
        surface_distance(a, b)
        seconds.append(time.process_time() - start)
    assert min(seconds) < 0.05


# --- the paper's Chamfer distance ---


def test_chamfer_paper_adds_squares_both_ways():
    points_a = [[0, 0, 0], [0.01, 0, 0]]
    points_b = [[0, 0, 0.02]]
    # a to b: 0.02^2 and 0.01^2 + 0.02^2; b to a: 0.02^2.
    assert chamfer_paper(points_a, points_b) == pytest.approx(0.0013, rel=1e-12)
    assert chamfer_paper(points_b, points_a) == pytest.approx(0.0013, rel=1e-12)
    assert chamfer_paper(points_a, points_a) == 0


@pytest.mark.parametrize(("side", "floor"), [(30, 2.3), (45, 3.5), (60, 4.6)])
def test_a_perfect_estimate_of_a_cube_scores_the_floor(side, floor):
    cube = cuboid([side / 1000] * 3)
    assert 1000 * chamfer_floor(cube) == pytest.approx(floor, rel=0.05)
    # Random points of density n / A are 1 / (2 sqrt(n / A)) from their nearest.
    assert chamfer_floor(cube) == pytest.approx(np.sqrt(cube.area / 1000), rel=0.05)


def test_chamfer_code_of_distant_bodies_is_twice_their_surface_distance():
    # Far apart, the sampling floor is small against the gap (1 m against 2 mm).
    a, b = cuboid([0.03] * 3), cuboid([0.03] * 3, [1, 0, 0])
    assert chamfer_code(a, b) == pytest.approx(
        2 * surface_distance(a, b).mean, rel=0.005
    )


# --- sizes and pose modulo symmetry ---


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


def wedge():
    """Return a tetrahedron whose volume centroid is (1, 2, 3) cm."""
    corners = np.vstack((np.zeros(3), np.diag([0.04, 0.08, 0.12])))
    return trimesh.Trimesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def test_a_polytope_is_compared_at_its_hull_centroid():
    body, shift = wedge(), np.array([0.001, -0.002, 0.003])
    # Turned about its own centroid, so only the shift moves this.
    centroid = np.array([0.01, 0.02, 0.03])
    about = translation_matrix(centroid + shift) @ quaternion_matrix(QUATERNION)
    moved = body.copy().apply_transform(about @ translation_matrix(-centroid))
    error = polytope_pose_error(moved, QUATERNION, body, [1, 0, 0, 0])
    turn = Rotation.from_quat(np.roll(QUATERNION, -1))
    assert_allclose(error.position, shift, atol=ROUNDING)
    assert error.rotation_angle == pytest.approx(turn.magnitude(), rel=1e-9)
    assert_allclose(error.rotation_vector, turn.as_rotvec(), atol=ROUNDING)


def test_more_vertices_on_one_face_do_not_move_the_centroid():
    body = wedge()
    lopsided = body.subdivide(face_index=[0]).subdivide(face_index=[0, 1])
    pose = [1, 0, 0, 0]
    error = polytope_pose_error(lopsided, pose, body, pose)
    assert_allclose(error.position, 0, atol=ROUNDING)


def test_a_symmetry_of_the_polytope_is_no_error():
    group = Rotation.create_group("C5").as_matrix()
    estimate = Rotation.from_rotvec([0, 0, 2 * np.pi / 5 + 0.01]).as_matrix()
    body = wedge()
    with_symmetry = polytope_pose_error(body, wxyz(estimate), body, [1, 0, 0, 0], group)
    without = polytope_pose_error(body, wxyz(estimate), body, [1, 0, 0, 0])
    assert_allclose(with_symmetry.rotation_vector, [0, 0, 0.01], atol=ROUNDING)
    assert without.rotation_angle == pytest.approx(2 * np.pi / 5 + 0.01)


# --- bad input ---


@pytest.mark.parametrize(
    "mesh", [None, "box", trimesh.Trimesh(), trimesh.PointCloud(np.eye(3))]
)
def test_what_is_no_surface_is_refused(mesh):
    with pytest.raises(TactileError, match=r"mesh_b: unusable.*with an area"):
        surface_distance(cuboid(SIDES), mesh)
    with pytest.raises(TactileError, match=r"mesh_a.*estimate\.mesh"):
        chamfer_code(mesh, cuboid(SIDES))


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
    with pytest.raises(OptionError, match="samples"):
        chamfer_floor(cuboid(SIDES), samples)


def test_seed_must_not_be_negative():
    with pytest.raises(OptionError, match=r"seed.*integer, 0 or more.*-1"):
        surface_distance(cuboid(SIDES), cuboid(SIDES), seed=-1)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 4)), np.zeros((0, 3)), [[0, 0, np.nan]], "points", 1.0]
)
def test_points_of_another_shape_are_refused(points):
    with pytest.raises(TactileError, match=r"points_b: unusable.*finite numbers"):
        chamfer_paper(np.zeros((1, 3)), points)


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


def test_reflections_and_flat_bodies_are_refused():
    body, flat = wedge(), trimesh.Trimesh(np.eye(3), [[0, 1, 2]])
    pose = [1, 0, 0, 0]
    for wrong in (np.diag([1, 1, -1]), 2 * np.eye(3)):
        with pytest.raises(TactileError, match=r"symmetries.*rotation"):
            polytope_pose_error(body, pose, body, pose, [np.eye(3), wrong])
    with pytest.raises(TactileError, match=r"true_mesh.*plane"):
        polytope_pose_error(body, pose, flat, pose)
