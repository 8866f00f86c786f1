"""Shipped classes of shapes: distance, normal, mesh, mass, symmetry, prior."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from formulations import sensing
from formulations.finger import SPHERE
from formulations.ground_contact import Corner, GroundContact
from formulations.rigid_body import FREE, Step
from formulations.shape import CUBOID
from formulations.size_prior import size_cost
from tactilenlp import CYLINDER, ELLIPSOID, log_size_prior, prism
from tactilenlp.errors import OptionError
from tactilenlp.tracking.surface import body_surface

RHO, SMALL = 10e-3, 1e-3  # [m] a fingertip, and the rounding that pages ask for
SHAPES = CYLINDER, prism(3), prism(6), ELLIPSOID
SWEPT = CYLINDER, prism(3), prism(5), prism(6)
ALL = pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s.name)


def sizes(shape):
    return np.array([0.05, 0.04, 0.035])[: shape.theta]


@cache
def solid(shape):
    """The body as a mesh; the ellipsoid with facets within 0.06 mm."""
    theta = sizes(shape)
    if shape is not ELLIPSOID:
        return trimesh.convex.convex_hull(body_surface(shape, theta))
    ball = trimesh.creation.icosphere(4)
    ball.vertices *= theta / 2
    return ball


def functions(shape):
    theta, q = ca.SX.sym("theta", shape.theta), ca.SX.sym("q", 3)
    out = [f(theta, q, SMALL) for f in (shape.distance, shape.normal)]
    return ca.Function("shape", [theta, q], out)


@cache
def around(shape, count=200, near=5e-3, far=15e-3):
    """Points (n, 3) [m] outside the body, at most `far` from it, and their distance."""
    rng, body = np.random.default_rng(3), solid(shape)
    q = rng.normal(size=(count, 3))
    way = shape.reach(sizes(shape)) * rng.uniform(0.6, 1.6, count)
    q *= (way / _length(q))[:, None]
    nearest, distance, _ = trimesh.proximity.closest_point_naive(body, q)
    plane = ConvexHull(body.vertices).equations
    outside = (q @ plane[:, :3].T + plane[:, 3]).max(axis=1) > 0
    rows = outside & (distance > near) & (distance < far)
    assert rows.sum() > 30
    away = (q - nearest)[rows] / distance[rows, None]
    return q[rows], distance[rows], away


def _length(q):
    return np.linalg.norm(q, axis=1)


def _columns(theta, q):
    return np.repeat(theta[:, None], len(q), axis=1)


def evaluated(shape, q):
    phi, n = functions(shape).map(len(q))(_columns(sizes(shape), q), q.T)
    return np.asarray(phi).ravel(), np.asarray(n).T


@ALL
def test_gap_and_normal_are_those_of_the_solid_where_a_fingertip_can_be(shape):
    q, distance, away = around(shape)
    phi, n = evaluated(shape, q)
    # A tenth of a fingertip rounds edges: (small / 5)^2 / (4 d) at d = 5 mm is 2 um a
    # face; facets of the meshes of round bodies are 0.06 mm inside at most.
    assert np.abs(phi - distance).max() < 0.07e-3
    assert np.abs(n - away).max() < 0.05  # facets turn the mesh's normals by 2 degrees


@ALL
def test_distance_and_normal_have_exact_derivatives(shape):
    theta, q = ca.SX.sym("theta", shape.theta), ca.SX.sym("q", 3)
    z = ca.vertcat(theta, q)
    value = ca.vertcat(shape.distance(theta, q, SMALL), shape.normal(theta, q, SMALL))
    f = ca.Function("f", [z], [value])
    slope = ca.Function("slope", [z], [ca.jacobian(value, z)])
    step = 1e-6
    for point in around(shape)[0][:20]:
        at = np.r_[sizes(shape), point]
        numeric = [
            np.asarray(f(at + step * e) - f(at - step * e)).ravel() / (2 * step)
            for e in np.eye(len(at))
        ]
        # Normals turn by 1 / 5 mm at most: third derivatives make 1e-12 / (5 mm)^3.
        np.testing.assert_allclose(slope(at), np.transpose(numeric), atol=1e-3)


@ALL
def test_normal_is_the_slope_of_the_distance(shape):
    theta, q = ca.DM(sizes(shape)), ca.SX.sym("q", 3)
    f = ca.Function("f", [q], [ca.gradient(shape.distance(theta, q, SMALL), q)])
    points, *_ = around(shape)
    slope = np.asarray(f.map(len(points))(points.T)).T
    np.testing.assert_allclose(slope, evaluated(shape, points)[1], atol=5e-3)


@ALL
def test_symmetries_leave_the_body_what_it_is(shape):
    points, *_ = around(shape)
    turns = [Rotation.from_euler("z", a).as_matrix() for a in (0.3, 2.0)]
    more = [((0, 1), R) for R in turns if shape.round]
    one = functions(shape)
    phi, _ = evaluated(shape, points)
    for order, S in (*shape.symmetries, *more):
        theta = sizes(shape)[list(order)]
        named = points @ np.array(S)
        again = np.asarray(one.map(len(named))(_columns(theta, named), named.T)[0])
        np.testing.assert_allclose(again.ravel(), phi, atol=1e-9)


@ALL
def test_gap_does_not_depend_on_the_frame_of_the_world(shape):
    theta, rng = ca.DM(sizes(shape)), np.random.default_rng(0)
    x, p_wf = rng.normal(size=6), rng.normal(size=3) * 0.05
    p_wf += x[:3]
    turn, shift = Rotation.from_rotvec([0.4, -1.0, 0.2]), np.array([0.3, -0.1, 0.2])
    there = turn * Rotation.from_rotvec(x[3:])
    moved = np.r_[turn.apply(x[:3]) + shift, there.as_rotvec()]

    def gap(x, p_wf):
        pose = FREE.pose(shape, theta, ca.DM(x))
        return float(SPHERE.gap(shape, theta, pose, ca.DM(p_wf), RHO))

    assert gap(x, p_wf) == pytest.approx(
        gap(moved, turn.apply(p_wf) + shift), abs=1e-12
    )


@ALL
def test_surface_and_inertia_are_those_of_the_solid(shape):
    theta, body = sizes(shape), solid(shape)
    phi, _ = evaluated(shape, body_surface(shape, theta))
    # On the surface, rounding moves a face by 0.1 mm and cuts a corner by 0.5 mm.
    assert np.abs(phi).max() < 0.8e-3
    exact = body.moment_inertia / body.volume
    inertia = np.asarray(ca.densify(shape.inertia(ca.DM(theta))))
    # 96 points of a rim lack 0.07 % of the area; the facets of the ball 0.15 %.
    np.testing.assert_allclose(inertia, exact, rtol=2e-3, atol=1e-12)
    assert np.abs(body.center_mass).max() < 1e-9
    assert _length(body.vertices).max() <= shape.reach(theta) + 1e-12


@pytest.mark.parametrize("shape", SWEPT, ids=lambda s: s.name)
def test_a_swept_body_stands_on_its_corners(shape):
    theta = ca.DM(sizes(shape))
    corners = np.array([shape.corner(theta, ca.DM(s)) for s in shape.corners])[..., 0]
    np.testing.assert_allclose(corners[:, 2], -0.02, atol=1e-15)
    assert float(shape.rest_height(theta)) == 0.02
    rim = body_surface(shape, sizes(shape))
    for corner in corners:
        # The rim of a cylinder has points every 3.75 degrees.
        assert _length(rim - corner).min() < (1e-3 if shape.round else 1e-12)


def test_a_prism_of_four_sides_is_the_cuboid():
    q = np.random.default_rng(1).uniform(-0.05, 0.05, (200, 3))
    phi, _ = evaluated(prism(4), q)
    box = functions(CUBOID)
    sides = np.array([0.05, 0.05, 0.04])
    far = phi > 2e-3
    exact = [box(sides, p) for p in q[far]]
    np.testing.assert_allclose(phi[far], [float(e[0]) for e in exact], atol=1e-5)
    np.testing.assert_allclose(
        prism(4).inertia(ca.DM([0.05, 0.04])), CUBOID.inertia(ca.DM(sides)), atol=1e-18
    )


def test_a_prism_needs_three_sides():
    for sides in (2, 3.5, "six"):
        with pytest.raises(OptionError, match="from 3 to"):
            prism(sides)
    assert prism(6) is prism(6)


def test_support_of_the_ellipsoid_is_where_the_normal_is():
    n = np.array([0.3, -0.5, -0.8]) / np.linalg.norm([0.3, -0.5, -0.8])
    p = np.asarray(ELLIPSOID.support(ca.DM(sizes(ELLIPSOID)), ca.DM(n))).T
    phi, normal = evaluated(ELLIPSOID, p)
    assert abs(phi[0]) < 1e-8
    np.testing.assert_allclose(normal[0], n, atol=1e-6)


def test_a_ball_that_rolls_does_not_slide_on_the_ground():
    theta, angle, dt = ca.DM([0.05] * 3), 0.02, 1 / 30
    ground, low = GroundContact(ELLIPSOID, FREE), Corner(None, None, ca.DM([0, 0, -1]))
    x_1 = ca.DM([0, 0, 0.025, 0, 0, 0])
    x = ca.DM([0.025 * angle, 0, 0.025, 0, angle, 0])
    _, v_s = ground.velocity(Step(theta, x, x_1, dt, None), low)
    slid = ca.DM([0.025 * angle, 0, 0.025, 0, 0, 0])
    _, sliding = ground.velocity(Step(theta, slid, x_1, dt, None), low)
    # To second order in the angle of a step: r angle^2 / 2.
    assert np.abs(np.asarray(v_s)).max() < 0.025 * angle**2 / dt
    assert float(sliding[0]) == pytest.approx(0.025 * angle / dt)
    assert float(ground.corner(theta, x, ca.DM([0, 0, -1]))[2]) == pytest.approx(0)


@pytest.mark.parametrize("shape", [CUBOID, CYLINDER, ELLIPSOID], ids=lambda s: s.name)
def test_the_prior_of_sizes_integrates_to_one(shape):
    n, (low, high) = shape.theta, shape.bounds
    mean, deviation = shape.size_prior
    z, weight = np.polynomial.legendre.leggauss(80)  # of theta, over its bounds
    z = ((low + high) / 2 + (high - low) / 2 * z - mean) / deviation
    square = np.sum(np.meshgrid(*[z**2] * n), axis=0)
    density = np.exp(log_size_prior(shape, [mean] * n)) * (1 + square / (3 + n)) ** (
        -(3 + n) / 2
    )
    for _ in range(n):
        density = density @ weight * (high - low) / 2
    assert density == pytest.approx(1, abs=1e-3)
    far = [mean + 5 * deviation, *[mean] * (n - 1)]
    odds = log_size_prior(shape, [mean] * n) - log_size_prior(shape, far)
    assert odds == pytest.approx((3 + n) / 2 * np.log(1 + 25 / (3 + n)))


def test_a_size_ten_deviations_off_is_rare_but_not_impossible():
    z = ca.SX.sym("z")
    cost = sensing.heavy_tailed(z**2)
    curve = ca.Function("curve", [z], [cost, ca.hessian(cost, z)[0]])
    assert [float(v) for v in curve(0)] == pytest.approx([0, 1])
    assert float(curve(0.5)[0]) == pytest.approx(0.5**2 / 2, rel=0.05)
    assert float(curve(10)[0]) < 7  # nats, where a Gaussian asks for 50
    assert float(curve(-10)[0]) == pytest.approx(float(curve(10)[0]))


def test_where_some_sizes_are_far_from_the_mean_the_others_may_be():
    """Two sides of 125 mm: the price of a third one of 165 mm falls."""
    mean, deviation = CUBOID.size_prior

    def price(known):
        cost = [size_cost(CUBOID, mean + deviation * ca.DM([known, known, z]))
                for z in (0, 6)]  # fmt: skip
        return float(cost[1] - cost[0])

    assert price(0) == pytest.approx(3 * np.log(7))
    assert price(4) == pytest.approx(3 * np.log((1 + 68 / 6) / (1 + 32 / 6)))
