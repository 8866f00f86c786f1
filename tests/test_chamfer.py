"""The paper's Chamfer distances that benchmarks report."""

import numpy as np
import pytest
import trimesh
from bodies import POSITION, QUATERNION, SIDES, cuboid
from conftest import benchmark
from numpy.testing import assert_allclose
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp.errors import OptionError, TactileError
from tactilenlp.evaluation.metrics import surface_distance

chamfer = benchmark("chamfer")


def test_the_seed_decides_the_points(chamfer):
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    assert chamfer.chamfer_code(a, b, seed=3) == chamfer.chamfer_code(a, b, seed=3)
    assert chamfer.chamfer_code(a, b, seed=3) != chamfer.chamfer_code(a, b, seed=4)


def test_moving_both_bodies_changes_nothing(chamfer):
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], [0.6, 0, 0.8, 0])
    move = translation_matrix(POSITION) @ quaternion_matrix(QUATERNION)
    moved = [mesh.copy().apply_transform(move) for mesh in meshes]
    expected, got = chamfer.chamfer_code(*meshes), chamfer.chamfer_code(*moved)
    assert_allclose(got, expected, rtol=1e-9)


def test_distances_grow_with_the_scale_of_both_bodies(chamfer):
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    scaled = [mesh.copy().apply_scale(1000) for mesh in meshes]
    expected, got = chamfer.chamfer_code(*meshes), chamfer.chamfer_code(*scaled)
    assert_allclose(got, 1000 * expected)


def test_chamfer_paper_adds_squares_both_ways(chamfer):
    points_a = [[0, 0, 0], [0.01, 0, 0]]
    points_b = [[0, 0, 0.02]]
    # a to b: 0.02^2 and 0.01^2 + 0.02^2; b to a: 0.02^2.
    assert chamfer.chamfer_paper(points_a, points_b) == pytest.approx(0.0013, rel=1e-12)
    assert chamfer.chamfer_paper(points_b, points_a) == pytest.approx(0.0013, rel=1e-12)
    assert chamfer.chamfer_paper(points_a, points_a) == 0


@pytest.mark.parametrize(("side", "floor"), [(30, 2.3), (45, 3.5), (60, 4.6)])
def test_a_perfect_estimate_of_a_cube_scores_the_floor(chamfer, side, floor):
    cube = cuboid([side / 1000] * 3)
    assert 1000 * chamfer.chamfer_floor(cube) == pytest.approx(floor, rel=0.05)
    # Random points of density n / A are 1 / (2 sqrt(n / A)) from their nearest.
    assert chamfer.chamfer_floor(cube) == pytest.approx(
        np.sqrt(cube.area / 1000), rel=0.05
    )


def test_chamfer_code_of_distant_bodies_is_twice_their_surface_distance(chamfer):
    # Far apart, the sampling floor is small against the gap (1 m against 2 mm).
    a, b = cuboid([0.03] * 3), cuboid([0.03] * 3, [1, 0, 0])
    assert chamfer.chamfer_code(a, b) == pytest.approx(
        2 * surface_distance(a, b).mean, rel=0.005
    )


@pytest.mark.parametrize(
    "mesh", [None, "box", trimesh.Trimesh(), trimesh.PointCloud(np.eye(3))]
)
def test_what_is_no_surface_is_refused(chamfer, mesh):
    with pytest.raises(TactileError, match=r"mesh_a.*estimate\.mesh"):
        chamfer.chamfer_code(mesh, cuboid(SIDES))


@pytest.mark.parametrize("samples", [0, -1, 2.5, "many"])
def test_samples_must_be_a_positive_integer(chamfer, samples):
    with pytest.raises(OptionError, match="samples"):
        chamfer.chamfer_floor(cuboid(SIDES), samples)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 4)), np.zeros((0, 3)), [[0, 0, np.nan]], "points", 1.0]
)
def test_points_of_another_shape_are_refused(chamfer, points):
    with pytest.raises(TactileError, match=r"points_b: .*\(N, 3\) finite numbers"):
        chamfer.chamfer_paper(np.zeros((1, 3)), points)
