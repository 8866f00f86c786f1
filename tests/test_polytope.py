"""Geometry of hulls: nearest points, moments, carving; degenerate vertices."""

from itertools import product

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from formulations.nearest_point import towards
from formulations.polytope import (
    inertia_about,
    polytope,
    polytope_distance,
    polytope_normal,
    whole_moments,
)
from tactilenlp import Problem
from tactilenlp.errors import TactileError
from tactilenlp.geometry import convex_hull as hull
from tactilenlp.geometry import simplification
from tactilenlp.geometry.convex_hull import nearest_points, unseen_ball
from tactilenlp.local.local_solve import with_vertices_on_hull
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.polytope_window import (
    hull_moments,
    support_shares,
    supporting_vertices,
)
from tactilenlp.search.polytope_init import closing_halfspaces

SMALL = 1e-4  # [m] rounding, as of a fingertip of 10 mm
CUBE = 0.02 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def ball(count, seed=0, radius=0.02):
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return radius * v / np.linalg.norm(v, axis=1, keepdims=True)


def nearest_exactly(vertices, q):
    """Solve the least squares of the simplex: the exact vector from hull to q."""
    heavy = 1e3 * np.ones((1, len(vertices)))
    w, _ = nnls(np.vstack([vertices.T, heavy]), np.r_[q, 1e3], maxiter=1000)
    return q - vertices.T @ w


def evaluated(vertices, points):
    V, q = ca.SX.sym("V", 3 * len(vertices)), ca.SX.sym("q", 3)
    out = [polytope_distance(V, q, 1e-3), polytope_normal(V, q, 1e-3)]
    f = ca.Function("f", [V, q], out, {"cse": True})
    d, n = f.map(len(points))(np.tile(vertices.ravel()[:, None], len(points)), points.T)
    return np.asarray(d).ravel(), np.asarray(n).T


@pytest.mark.parametrize(
    ("q", "distance", "normal"),
    [
        ((0.03, 0.001, 0.002), 0.01, (1, 0, 0)),
        ((0.026, 0.028, 0.001), 0.01, (0.6, 0.8, 0)),
        ((0.022, 0.021, 0.022), 0.003, (2 / 3, 1 / 3, 2 / 3)),
    ],
    ids=["face", "edge", "vertex"],
)
def test_distance_and_normal_are_right_for_faces_edges_and_vertices(
    q, distance, normal
):
    d, n = evaluated(CUBE, np.array([q]))
    assert abs(d[0] - distance) < SMALL
    assert np.arccos(n[0] @ normal) < 0.02


def test_distance_and_normal_are_those_of_the_exact_hull():
    vertices = ball(20)
    points = 1.8 * ball(100, seed=1)
    d, n = evaluated(vertices, points)
    exact = np.array([nearest_exactly(vertices, q) for q in points])
    away = np.linalg.norm(exact, axis=1)
    assert np.abs(d - away).max() < SMALL
    angle = np.arccos(np.clip((n * exact).sum(axis=1) / away, -1, 1))
    assert np.median(angle) < 0.01
    assert angle.max() < 0.1  # where the feature changes, over SMALL


@pytest.mark.slow
def test_the_nearest_point_is_found_on_large_faces_and_by_their_edges():
    rng = np.random.default_rng(4)
    for sides in rng.uniform(0.01, 0.1, (20, 3)):
        corners = CUBE / 0.04 * sides
        on = sides / 2 * rng.choice([-0.98, -0.5, 0.3, 0.9], (20, 3))
        axis = rng.integers(0, 3, 20)
        points = on.copy()
        points[range(20), axis] = (
            np.sign(on[range(20), axis]) * (sides / 2 + 0.01)[axis]
        )
        exact = np.array([nearest_exactly(corners, q) for q in points])
        away = np.linalg.norm(exact, axis=1)
        d, n = evaluated(corners, points)
        assert np.abs(d - away).max() < SMALL / 2
        off = np.linalg.norm(n - exact / away[:, None], axis=1)
        assert off.max() < 0.06  # rounding: a short side next to its edge


def test_a_finger_that_sank_in_reads_how_deep():
    d, n = evaluated(CUBE, np.array([[0.025, 0.003, 0.001]]))
    assert abs(d[0] - 5e-3) < SMALL  # half the radius of a fingertip deep
    assert n[0] == pytest.approx([1, 0, 0], abs=0.01)


def test_value_slope_and_curvature_agree_with_finite_differences():
    V = ball(8, seed=2)
    z, q = ca.SX.sym("z", 27), None
    q = z[24:]
    u = towards(ca.reshape(z[:24], 3, 8), q, SMALL)
    value = ca.norm_2(u) + 0.01 * ca.dot(u, ca.DM([0.3, -0.5, 0.8])) / ca.norm_2(u)
    gradient = ca.gradient(value, z)
    f = ca.Function("f", [z], [value, gradient, ca.jacobian(gradient, z)])
    at = np.r_[V.ravel(), 1.7 * V[:3].mean(axis=0) + [1e-3, 2e-3, 0]]
    _, slope, kkt = (np.asarray(o) for o in f(at))
    for i in np.random.default_rng(0).choice(27, 9, replace=False):
        step = np.zeros(27)
        step[i] = 1e-7
        up, down = f(at + step), f(at - step)
        assert float(up[0] - down[0]) / 2e-7 == pytest.approx(slope[i, 0], abs=1e-5)
        bend = np.asarray(up[1] - down[1]).ravel() / 2e-7
        assert np.abs(bend - kkt[:, i]).max() < 1e-3 * np.abs(kkt).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    "extra",
    [CUBE[0], CUBE[[0, 1, 3, 2]].mean(axis=0), np.zeros(3)],
    ids=["duplicate", "coplanar", "interior"],
)
def test_a_degenerate_vertex_changes_nothing_and_gives_no_nan(extra):
    points = 1.9 * ball(10, seed=3)
    d, n = evaluated(CUBE, points)
    more = np.vstack([CUBE, extra])
    d_more, n_more = evaluated(more, points)
    assert np.abs(d - d_more).max() < SMALL
    assert np.abs(n - n_more).max() < 0.05  # 3 degrees, near an edge
    V, q = ca.SX.sym("V", 3, 9), ca.SX.sym("q", 3)
    H = ca.hessian(ca.norm_2(towards(V, q, SMALL)), ca.vertcat(ca.vec(V), q))[0]
    kkt = ca.Function("H", [V, q], [H])
    assert all(np.isfinite(np.asarray(kkt(more.T, p))).all() for p in points[:5])


def test_moments_are_those_of_the_solid():
    vertices = np.add(ball(20, seed=4), [0.01, 0.02, 0.03])
    triangles = hull.triangles(vertices, 36)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    t = ca.SX.sym("t", 36 * 9)
    f = ca.Function("f", [t], [whole_moments(t)])
    m = np.asarray(f(vertices[triangles].ravel())).ravel()
    assert m[0] == pytest.approx(mesh.volume)
    assert m[1:4] / m[0] == pytest.approx(mesh.center_mass)
    assert np.r_[m[0], m[1:] / m[0]] == pytest.approx(hull_moments(vertices, triangles))
    inertia = np.asarray(ca.DM(inertia_about(ca.DM(m[1:4] / m[0]), m[4:] / m[0])))
    assert inertia == pytest.approx(mesh.moment_inertia / mesh.volume, rel=1e-6)


def test_half_spaces_of_a_cube_leave_its_corners():
    n = np.vstack([np.eye(3), -np.eye(3)])
    found = hull.merge_points(hull.vertices_behind(np.c_[n, np.full(6, 0.02)]))
    assert sorted(found.round(6).tolist()) == sorted(CUBE.tolist())


@pytest.mark.parametrize("missing", [None, 0])
def test_planes_and_ground_close_a_body_unless_a_face_is_missing(missing):
    n = np.vstack([np.eye(3), -np.eye(3)[:2]])  # the ground is below
    b = np.array([0.02, 0.02, 0.04, 0.02, 0.02])  # it stands on it
    points = 0.02 * n + np.array([0, 0, 0.02])  # felt amid each face
    kept = [i for i in range(5) if i != missing]
    planes = np.c_[n, b][kept]
    ball = unseen_ball(points[kept], (0.022, 0.008), ground=True)
    found = closing_halfspaces(planes, points[kept], ball)
    if missing is None:
        corners, up = (
            hull.merge_points(hull.vertices_behind(found)),
            np.array([0, 0, 0.02]),
        )
        assert sorted(corners.round(6).tolist()) == sorted((CUBE + up).tolist())
    else:
        assert found is None


def test_half_spaces_without_a_common_point_are_refused():
    with pytest.raises(TactileError, match="empty or flat"):
        hull.vertices_behind(
            np.array([[0, 0, 1, -0.01], [0, 0, -1, -0.01], [1, 0, 0, 0.1]])
        )


def test_thinning_keeps_what_carries_volume():
    bumps = 1.001 * CUBE[[0, 1, 3, 2]].mean(axis=0) + np.zeros((1, 3))
    kept = simplification.fewer_vertices(np.vstack([CUBE, bumps]), 8)
    assert sorted(kept.round(9).tolist()) == sorted(CUBE.round(9).tolist())


def test_a_hull_of_many_vertices_keeps_its_volume_as_one_of_few_does():
    few, many = ball(300, 3), ball(1200, 3)
    shares = [
        ConvexHull(simplification.fewer_vertices(points, 40)).volume
        / ConvexHull(points).volume
        for points in (few, many)
    ]
    assert shares[1] == pytest.approx(shares[0], rel=0.03)


def test_missing_vertices_are_put_where_the_hull_stays_as_it_is():
    more = simplification.more_vertices(CUBE, 20)
    assert len(more) == 20
    assert trimesh.convex.convex_hull(more).volume == pytest.approx(0.04**3)


def test_a_body_stands_on_the_vertices_that_span_most():
    low = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.1, 0, 0.0]])
    standing = supporting_vertices(0.01 * np.vstack([low, [[0, 0, 2.0]]]), 4)
    assert standing.tolist() == [0, 1, 2, 3]
    assert (
        len(supporting_vertices(np.vstack([0.01 * ball(9, 5), [[0, 0, -1.0]]]), 4)) >= 3
    )


def test_a_term_may_read_several_columns_of_a_variable():
    nlp = Problem()
    v = nlp.variable("v", 2, 4, guess=np.arange(8).reshape(4, 2).T, unit="m", scale=1)
    pairs = np.array([[0, 1], [1, 3], [2, 2]])

    def apart(two, weight):
        return weight * ca.sumsqr(two[:2] - two[2:]) ** 2

    nlp.minimize("apart", apart, v[:, pairs], [1.0, 2.0, 3.0], role="prior")
    x = nlp.pack({})
    assert nlp.value("apart", x, nlp.data())[:, 0].tolist() == [64, 2 * 32**2, 0]
    assert v[:, pairs].pick([1]).columns.tolist() == [[1, 3]]
    assert not any("apart" in finding for finding in nlp.check().findings)


def test_classes_of_a_number_of_vertices_are_one_object_each():
    assert polytope(30) is polytope(30)
    assert polytope(8).theta == 24


def test_legs_share_the_weight_by_the_law_of_the_lever():
    square = CUBE[CUBE[:, 2] < 0]
    assert support_shares(square, np.zeros(3)) == pytest.approx(
        np.full(4, 1 / 4), abs=1e-5
    )
    off = np.array([0.01, 0.0, 0.0])  # half way to the side at x = 20 mm
    assert support_shares(square, off) @ square == pytest.approx(
        [0.01, 0, -0.02], abs=1e-6
    )
    three = square[:3]
    share = support_shares(three, three.T @ [0.2, 0.3, 0.5])
    assert share == pytest.approx([0.2, 0.3, 0.5], abs=1e-4)
    outside = support_shares(three, np.array([0.03, 0.03, 0.0]))  # it would topple
    assert outside.min() >= 0
    assert outside.sum() == pytest.approx(1)


def test_an_invisible_vertex_is_moved_onto_the_hull_which_stays_as_it_is():
    inside = [[0.001, 0.002, 0.0], [0.0, 0.0, 0.01]]
    h = Hypothesis(np.vstack([inside, CUBE]).ravel(), np.zeros((3, 1)), 0.0, ())
    moved = with_vertices_on_hull(polytope(len(h.theta) // 3), h).theta.reshape(-1, 3)
    assert moved.shape == (10, 3)
    assert hull.hull_vertices(moved).shape == (8, 3)
    away = np.abs(moved).max(axis=1)
    assert away == pytest.approx(np.full(10, 0.02))  # every one is on a face
    assert hull_moments(moved, hull.triangles(moved, 16))[0] == pytest.approx(0.04**3)


def test_the_nearest_point_of_a_tiny_body_is_exact():
    half = 0.15e-3 * np.ones(3)
    corners = half * np.array(list(product((-1, 1), repeat=3)))
    points = 1e-3 * np.random.default_rng(0).uniform(-1, 1, (200, 3))
    points = points[(np.abs(points) > half).any(axis=1)]
    assert nearest_points(corners, points) == pytest.approx(
        np.clip(points, -half, half)
    )
