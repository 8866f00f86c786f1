"""The paper's Chamfer distance against geometry that can be worked out by hand."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from bodies import POSITION, QUATERNION, SIDES, cuboid
from numpy.testing import assert_allclose
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp.errors import OptionError, TactileError
from tactilenlp.evaluation.metrics import surface_distance

BENCHMARKS = Path(__file__).resolve().parents[1] / "examples" / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))
try:
    from chamfer import chamfer_code, chamfer_floor, chamfer_paper
finally:
    sys.path.remove(str(BENCHMARKS))


def test_the_paper_s_form_adds_squares_both_ways():
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


def test_the_code_s_form_of_distant_bodies_is_twice_their_surface_distance():
    # Far apart, the sampling floor is small against the gap (1 m against 2 mm).
    a, b = cuboid([0.03] * 3), cuboid([0.03] * 3, [1, 0, 0])
    assert chamfer_code(a, b) == pytest.approx(
        2 * surface_distance(a, b).mean, rel=0.005
    )


def test_the_seed_decides_the_points():
    a, b = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    assert chamfer_code(a, b, seed=3) == chamfer_code(a, b, seed=3)
    assert chamfer_code(a, b, seed=3) != chamfer_code(a, b, seed=4)


def test_moving_both_bodies_changes_nothing():
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], [0.6, 0, 0.8, 0])
    move = translation_matrix(POSITION) @ quaternion_matrix(QUATERNION)
    moved = [mesh.copy().apply_transform(move) for mesh in meshes]
    assert_allclose(chamfer_code(*moved), chamfer_code(*meshes), rtol=1e-9)


def test_distances_grow_with_the_scale_of_both_bodies():
    meshes = cuboid(SIDES), cuboid(1.1 * SIDES, [0.001, 0.002, 0], QUATERNION)
    scaled = [mesh.copy().apply_scale(1000) for mesh in meshes]
    assert_allclose(chamfer_code(*scaled), 1000 * chamfer_code(*meshes))


@pytest.mark.parametrize(
    "mesh", [None, "box", trimesh.Trimesh(), trimesh.PointCloud(np.eye(3))]
)
def test_what_is_no_surface_is_refused(mesh):
    with pytest.raises(TactileError, match=r"mesh_a.*estimate\.mesh"):
        chamfer_code(mesh, cuboid(SIDES))


@pytest.mark.parametrize("samples", [0, -1, 2.5, "many"])
def test_samples_must_be_a_positive_integer(samples):
    with pytest.raises(OptionError, match="samples"):
        chamfer_floor(cuboid(SIDES), samples)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 4)), np.zeros((0, 3)), [[0, 0, np.nan]], "points", 1.0]
)
def test_points_of_another_shape_are_refused(points):
    with pytest.raises(TactileError, match=r"points_b: unusable.*finite numbers"):
        chamfer_paper(np.zeros((1, 3)), points)
