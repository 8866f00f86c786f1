"""The pages say what physics says: derivatives, invariance, cases solved by hand."""

import itertools
import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from formulations import contact, quasi_static, sensing, violation_implicit
from formulations.finger import SPHERE, capsule
from formulations.rigid_body import FREE, PLANAR, momentum_change, rotation, turn
from formulations.shape import CUBOID
from tactilenlp.measurements import Measurements
from tactilenlp.nlp import Problem
from tactilenlp.precision import Precision
from tactilenlp.reduce import Reductions, reduce
from tactilenlp.scene import Scene
from tactilenlp.solve import SolverOptions, solve, solve_levels

PAGES = {"quasi_static": quasi_static, "violation_implicit": violation_implicit}
SENSORS = Precision(position=0.0, normal=0.0)
RHO = 0.01  # [m] of the fingertips below
# The solid is rounded by a tenth of a fingertip: gaps are right to a thirtieth of a
# millimetre and normals to half a degree wherever a fingertip can be.
GAP, ANGLE = 0.03e-3, np.radians(0.5)


# A cuboid, by brute force


def solid_distance(half, q):
    """Return the exact signed distance (n,) of points (n, 3) from a cuboid."""
    d = np.abs(q) - half
    outside = np.linalg.norm(np.maximum(d, 0), axis=1)
    return outside + np.minimum(d.max(axis=1), 0)


def solid_normal(half, q):
    """Return the exact outward normal (n, 3) at the nearest surface points."""
    out = q - np.clip(q, -half, half)
    d = np.abs(q) - half
    face = np.sign(q) * (d == d.max(axis=1, keepdims=True))
    out = np.where((d.max(axis=1) > 0)[:, None], out, face)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def cuboid_functions(small=RHO / 10):
    """Return distance and normal (theta, q) of the page, as numbers."""
    theta, q = ca.SX.sym("theta", 3), ca.SX.sym("q", 3)
    out = [CUBOID.distance(theta, q, small), CUBOID.normal(theta, q, small)]
    return ca.Function("cuboid", [theta, q], out)


def angle(a, b):
    """Return the angles (n,) [rad] between unit vectors (n, 3)."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=1) / 2, 0, 1))


def around(half, rng, distance, n=400):
    """Return points whose nearest surface points cover faces, edges and corners."""
    s = rng.uniform(-1, 1, (n, 3))
    ends = rng.integers(1, 4, n)  # how many coordinates lie at the end: 1 is a face
    order = np.argsort(rng.random((n, 3)), axis=1) < ends[:, None]
    s = np.where(order, np.sign(s), s)
    out = np.abs(rng.normal(size=(n, 3))) * order * np.sign(s)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return s * half + out * distance * rng.uniform(0.8, 1, (n, 1))


@pytest.mark.parametrize("distance", [0.9 * RHO, 1.2 * RHO, 5 * RHO])
def test_gap_and_normal_are_those_of_the_solid_at_faces_edges_and_corners(distance):
    rng, half = np.random.default_rng(0), np.array([0.02, 0.03, 0.015])
    q = around(half, rng, distance)
    phi, n = cuboid_functions().map(len(q))(2 * half, q.T)
    exact = solid_distance(half, q)
    assert exact.min() > 0.7 * RHO
    assert np.abs(np.asarray(phi).ravel() - exact).max() < GAP
    assert angle(np.asarray(n).T, solid_normal(half, q)).max() < ANGLE


def test_a_finger_that_sank_in_reads_its_depth_and_the_nearest_face():
    rng, half = np.random.default_rng(1), np.array([0.02, 0.03, 0.015])
    q = half * rng.uniform(-1, 1, (2000, 3))
    d = np.sort(np.abs(q) - half, axis=1)
    inside, next_face = -d[:, 2], -d[:, 1]
    q = q[(inside > 2e-3) & (inside < 4e-3) & (next_face > 12e-3)]
    assert len(q) > 50
    phi, n = cuboid_functions().map(len(q))(2 * half, q.T)
    # Rounding takes S(d) - d = (small / 5)^2 / (4 d) from each of depths above 2 mm;
    # the log-sum-exp adds exp(-8) of a millimetre a face.
    exact = solid_distance(half, q)
    assert np.abs(np.asarray(phi).ravel() - exact).max() < 0.03e-3
    # S(d) ~ 1 / d of the next face turns the normal by (4 / 12)^3 at most.
    assert angle(np.asarray(n).T, solid_normal(half, q)).max() < np.radians(3)


def test_a_thin_plate_keeps_its_faces():
    half = np.array([0.03, 0.02, 0.002])
    q = np.array([[0, 0, 0.012], [0.01, -0.01, -0.012], [0.04, 0, 0.0]])
    phi, n = cuboid_functions().map(3)(2 * half, q.T)
    # |q| is rounded over a tenth of `small`, 0.1 mm: nothing is left of it at 2 mm.
    assert np.asarray(phi).ravel() == pytest.approx([0.01] * 3, abs=0.01e-3)
    np.testing.assert_allclose(
        np.asarray(n).T, [[0, 0, 1], [0, 0, -1], [1, 0, 0]], atol=2e-3
    )


@pytest.mark.parametrize("motion", [PLANAR, FREE], ids=["planar", "free"])
def test_gap_is_zero_when_a_fingertip_touches_a_face(motion):
    theta = np.array([0.04, 0.06, 0.05])
    x = np.array([0.1, -0.2, 0.7])
    R = Rotation.from_euler("z", 0.7)
    if motion is FREE:
        R = Rotation.from_rotvec([0.3, -0.5, 0.7])
        x = np.r_[0.1, -0.2, 0.3, R.as_rotvec()]
    centre = np.array([0.1, -0.2, 0.025 if motion is PLANAR else 0.3])
    for axis, side in itertools.product(range(3), (-1, 1)):
        out = side * np.eye(3)[axis]
        p_wf = centre + R.apply(out * (theta / 2 + RHO))
        pose = motion.pose(CUBOID, ca.DM(theta), ca.DM(x))
        gap = SPHERE.gap(CUBOID, ca.DM(theta), pose, ca.DM(p_wf), RHO)
        normal = SPHERE.normal(CUBOID, ca.DM(theta), pose, ca.DM(p_wf), RHO)
        assert float(gap) == pytest.approx(0, abs=5e-6)  # rounded by S(d) - d = 1 um
        np.testing.assert_allclose(np.asarray(normal).ravel(), R.apply(out), atol=1e-3)


def test_inertia_is_that_of_the_solid():
    theta = np.array([0.04, 0.06, 0.05])
    box = trimesh.creation.box(theta)
    exact = box.moment_inertia / box.volume
    inertia = np.asarray(ca.densify(CUBOID.inertia(ca.DM(theta))))
    np.testing.assert_allclose(inertia, exact, atol=1e-12)


def test_a_cuboid_at_rest_stands_on_its_corners():
    theta = ca.DM([0.04, 0.06, 0.05])
    p, R = PLANAR.pose(CUBOID, theta, ca.DM([0.1, 0.2, 0.3]))
    for signs in CUBOID.corners:
        corner = p + R @ CUBOID.corner(theta, ca.DM(signs))
        assert float(corner[2]) == pytest.approx(0, abs=1e-15)


# A capsule


def quaternion(axis, rng):
    """Return quaternions wxyz (n, 4) that turn z to the axis (n, 3), spun at random."""
    across = np.cross(axis, rng.normal(size=axis.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frame = np.stack([across, np.cross(axis, across), axis], axis=2)
    return np.roll(Rotation.from_matrix(frame).as_quat(), 1, axis=1)


def finger_function(finger):
    """Return gap and normal (theta, x, p_wf) of a finger as numbers, x a free pose."""
    theta, x = ca.SX.sym("theta", 3), ca.SX.sym("x", 6)
    p_wf = ca.SX.sym("p_wf", finger.numbers)
    given = CUBOID, theta, FREE.pose(CUBOID, theta, x), p_wf, RHO
    out = [finger.gap(*given), finger.normal(*given)]
    return ca.Function("finger", [theta, x, p_wf], out, {"cse": True})


def nearest(half, c, a):
    """Return the points of the segments c -/+ a that are nearest to a cuboid.

    Brute force: ternary search along the segment, on which the distance is convex.
    """
    low, high = -np.ones((len(c), 1)), np.ones((len(c), 1))
    for _ in range(120):
        u, v = (2 * low + high) / 3, (low + 2 * high) / 3
        left = solid_distance(half, c + u * a) <= solid_distance(half, c + v * a)
        low, high = np.where(left[:, None], low, u), np.where(left[:, None], v, high)
    return c + (low + high) / 2 * a


def capsules(half, half_length, rng, n=600):
    """Return centres and axes of capsules around a cuboid, half of them near parallel.

    Nearly: within three degrees of an edge, where the nearest point runs far.
    """
    axis = rng.normal(size=(n, 3))
    tilted = np.eye(3)[rng.integers(0, 3, n)] + 0.05 * rng.normal(size=(n, 3))
    axis[::2] = tilted[::2]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    c = around(half, rng, 1.3 * RHO, n)
    return c + axis * half_length * rng.uniform(-1, 1, (n, 1)), axis


@pytest.mark.parametrize("half_length", [0.004, 0.02, 0.05])
def test_a_capsule_touches_where_brute_force_says(half_length):
    rng, half = np.random.default_rng(2), np.array([0.02, 0.03, 0.015])
    c, axis = capsules(half, half_length, rng)
    q = nearest(half, c, half_length * axis)
    near = solid_distance(half, q) > 0.7 * RHO  # not sunk in by more than 3 mm
    assert near.sum() > 200
    c, axis, q = c[near], axis[near], q[near]
    R, p = Rotation.from_rotvec([0.4, -0.7, 1.1]), np.array([0.2, -0.1, 0.3])
    p_wf = np.hstack([R.apply(c) + p, quaternion(R.apply(axis), rng)])
    x = np.r_[p, R.as_rotvec()]
    phi, n = finger_function(capsule(half_length)).map(len(c))(2 * half, x, p_wf.T)
    exact = solid_distance(half, q) - RHO
    assert np.abs(np.asarray(phi).ravel() - exact).max() < GAP
    assert angle(np.asarray(n).T, R.apply(solid_normal(half, q))).max() < ANGLE


def test_a_capsule_parallel_to_a_face_touches_with_its_middle():
    p_wf = np.array(
        [0.005, 0, 0.025 + RHO, np.sqrt(0.5), 0, np.sqrt(0.5), 0]
    )  # along x
    theta, x = [0.04, 0.06, 0.05], np.zeros(6)
    phi, n = finger_function(capsule(0.01))(theta, x, p_wf)
    assert float(phi) == pytest.approx(0, abs=5e-6)
    np.testing.assert_allclose(np.asarray(n).ravel(), [0, 0, 1], atol=1e-3)
    pose = FREE.pose(CUBOID, ca.DM(theta), ca.DM(x))
    core = capsule(0.01).core(CUBOID, ca.DM(theta), pose, ca.DM(p_wf), RHO)
    np.testing.assert_allclose(np.asarray(core).ravel(), p_wf[:3], atol=0.1e-3)


def test_a_sphere_is_a_capsule_of_no_length():
    rng, half = np.random.default_rng(3), np.array([0.02, 0.03, 0.015])
    q, x = around(half, rng, 1.5 * RHO, 50), np.zeros(6)
    turned = np.hstack([q, quaternion(rng.normal(size=(50, 3)), rng)])
    sphere = finger_function(SPHERE).map(50)(2 * half, x, q.T)
    short = finger_function(capsule(0.0)).map(50)(2 * half, x, turned.T)
    for a, b in zip(sphere, short, strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))


def test_gap_and_normal_of_a_capsule_are_twice_differentiable():
    rng, half = np.random.default_rng(4), np.array([0.02, 0.03, 0.015])
    c, axis = capsules(half, 0.02, rng, 60)
    p_wf = np.hstack([c, quaternion(axis, rng)])
    theta, x = ca.SX.sym("theta", 3), ca.SX.sym("x", 6)
    given = ca.SX.sym("p_wf", 7)
    gap, normal = finger_function(capsule(0.02))(theta, x, given)
    z = ca.vertcat(theta, x)
    direction = ca.DM([0.2, -0.5, 0.8])
    scale = np.r_[[1e-3] * 6, [0.05] * 3]  # a millimetre, three degrees
    for scalar in (gap / RHO, ca.dot(direction, normal)):
        slope = ca.gradient(scalar, z)
        values = ca.Function("f", [z, given], [scalar, slope], {"cse": True})
        bends = ca.Function("h", [z, given], [ca.jacobian(slope, z)], {"cse": True})
        z_0 = np.r_[2 * half, 1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.03]
        values, count = values.map(len(p_wf)), len(p_wf)
        slopes = np.asarray(values(z_0, p_wf.T)[1])
        bend = np.asarray(bends.map(count)(z_0, p_wf.T)).reshape(9, count, 9)
        step = 1e-5
        numeric, numeric_2 = np.zeros((9, count)), np.zeros((9, count, 9))
        for i in range(9):
            away = step * scale[i] * np.eye(9)[i]
            (f, df), (f_1, df_1) = (
                map(np.asarray, values(z_0 + side * away, p_wf.T)) for side in (1, -1)
            )
            numeric[i] = (f - f_1).ravel() / (2 * step)
            numeric_2[i] = ((df - df_1) / (2 * step)).T
        slopes, numeric_2 = slopes * scale[:, None], numeric_2 * scale
        bend = bend * scale[:, None, None] * scale
        # The nearest point runs into an end of the segment within 70 um, the root
        # of tau rho: steps of 10 nm err by (1 / 7000)^2 of the largest entry.
        size = np.abs(slopes).max(axis=0) + 1e-3
        assert (np.abs(numeric - slopes).max(axis=0) / size).max() < 1e-4
        size = np.abs(bend).max(axis=(0, 2)) + 1e-3
        assert (np.abs(numeric_2 - bend).max(axis=(0, 2)) / size).max() < 1e-3


def test_a_finger_travels_between_processes():
    finger = pickle.loads(pickle.dumps(capsule(0.01)))
    where = [0.04, 0.06, 0.05], np.zeros(6), [0.01, 0.02, 0.04, 1, 0, 0, 0]
    gaps = [float(finger_function(f)(*where)[0]) for f in (finger, capsule(0.01))]
    assert gaps[0] == gaps[1]
    assert capsule(0.01) is capsule(0.01)  # what depends on it is derived once


# Rotations and momentum


def test_rotation_agrees_with_scipy():
    rng = np.random.default_rng(5)
    w = rng.normal(size=(100, 3))
    w[:3] = [[0, 0, 0], [1e-9, 0, 0], [0, 0, 3.0]]
    for vector, R in zip(w, Rotation.from_rotvec(w).as_matrix(), strict=True):
        np.testing.assert_allclose(rotation(ca.DM(vector)), R, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-7, 1e-5])
def test_a_rotation_that_is_hardly_one_bends_as_its_series_does(size):
    w = ca.SX.sym("w", 3)
    K, weight = ca.skew(w), ca.DM([[1, 2, 3], [4, 5, 6], [7, 8, 10]])
    series = ca.DM.eye(3) + K + K @ K / 2 + K @ K @ K / 6  # the next is w^4 / 24
    bends = [
        ca.hessian(ca.sum1(ca.vec(weight * R)), w)[0] for R in (rotation(w), series)
    ]
    H, exact = ca.Function("H", [w], bends)(size * np.array([0.6, 0, 0.8]))
    np.testing.assert_allclose(np.asarray(H), np.asarray(exact), atol=1e-6)


def test_turn_is_the_rotation_vector_between_two_poses():
    rng = np.random.default_rng(6)
    for size, error in ((0.03, 1e-10), (0.3, 4e-5), (0.8, 1e-2)):
        for _ in range(20):
            w = rng.normal(size=3)
            w *= size / np.linalg.norm(w)
            before = Rotation.from_rotvec(rng.normal(size=3))
            after = Rotation.from_rotvec(w) * before
            got = turn(ca.DM(after.as_matrix()), ca.DM(before.as_matrix()))
            # The series of arcsin is cut after the fifth power of the sine.
            assert np.abs(np.asarray(got).ravel() - w).max() < error


def changes(theta, poses, dt):
    """Return the change of momentum per unit mass at the last of three free poses."""
    x_2, x_1, x = (
        ca.DM(np.r_[p, Rotation.from_matrix(R).as_rotvec()]) for p, R in poses
    )
    out = momentum_change(CUBOID, FREE, ca.DM(theta), x, x_1, x_2, dt)
    return (np.asarray(o).ravel() for o in out)


def test_a_body_in_free_fall_gains_g_dt_and_no_spin():
    dt, g = 1 / 30, 9.81
    R = Rotation.from_rotvec([0.2, 0.3, 0.4]).as_matrix()
    v = np.array([0.3, -0.2, 0.1])
    poses = [(v * t + [0, 0, -g * t**2 / 2], R) for t in np.arange(3) * dt]
    linear, angular = changes([0.04, 0.06, 0.05], poses, dt)
    np.testing.assert_allclose(linear, [0, 0, -g * dt], atol=1e-12)
    np.testing.assert_allclose(angular, 0, atol=1e-15)


def test_a_body_that_spins_up_gains_its_inertia_times_the_change_of_speed():
    dt, theta = 1 / 30, np.array([0.04, 0.06, 0.05])
    turns = [0.0, 0.1, 0.25]  # [rad] about z: 3 rad/s, then 4.5 rad/s
    poses = [(np.zeros(3), Rotation.from_euler("z", a).as_matrix()) for a in turns]
    linear, angular = changes(theta, poses, dt)
    gain = (0.04**2 + 0.06**2) / 12 * 1.5
    np.testing.assert_allclose(angular, [0, 0, gain], rtol=1e-5, atol=1e-15)
    np.testing.assert_allclose(linear, 0, atol=1e-15)


def test_a_body_that_tumbles_freely_keeps_its_angular_momentum():
    theta, dt = np.array([0.04, 0.06, 0.05]), 1e-3
    inertia = np.diag(np.asarray(ca.densify(CUBOID.inertia(ca.DM(theta)))))
    w_0 = np.array([2.0, 8.0, 3.0])  # [rad/s] near the unstable axis

    def rate(_, state):
        R, w = state[:9].reshape(3, 3), state[9:]  # w in the body frame
        turning = np.cross(R, w)  # row by row: R [w]x
        return np.r_[turning.ravel(), -np.cross(w, inertia * w) / inertia]

    t = np.array([0.2, 0.2 + dt, 0.2 + 2 * dt])
    way = solve_ivp(
        rate, (0, 0.3), np.r_[np.eye(3).ravel(), w_0], t_eval=t, rtol=1e-12, atol=1e-12
    )
    poses = [(np.zeros(3), s[:9].reshape(3, 3)) for s in way.y.T]
    _, angular = changes(theta, poses, dt)
    total = np.linalg.norm(inertia * w_0)
    # The mean speed of a step stands for the speed at its end: one part in dt w = 1 %
    # of the turning of the body, which changes by as much again from step to step.
    assert np.abs(angular).max() < 1e-3 * total


# What a finger feels


def test_contact_booleans_cost_what_the_logistic_says():
    alpha, phi = 1500.0, np.linspace(-2e-3, 2e-3, 41)
    p_free = 1 / (1 + np.exp(-alpha * phi))
    for gap, p in zip(phi, p_free, strict=True):
        assert float(sensing.free(gap, alpha)) == pytest.approx(-np.log(p), rel=1e-12)
        assert float(sensing.felt(gap, alpha)) == pytest.approx(
            -np.log(1 - p), rel=1e-12
        )


def test_a_metre_of_gap_overflows_neither_cost_nor_slope():
    phi = ca.SX.sym("phi")
    cost = sensing.mixture(sensing.free(phi, 1500.0), 7.0), sensing.free(phi, 1500.0)
    slope = [ca.gradient(c, phi) for c in cost]
    f = ca.Function("f", [phi], [*cost, *slope, *(ca.gradient(s, phi) for s in slope)])
    bounded, free, *derivatives = (float(v) for v in f(-1.0))
    assert free == 1500.0
    assert bounded == pytest.approx(7.0 + np.log1p(np.exp(-7.0)), abs=1e-12)
    assert np.isfinite(derivatives).all()
    bounded, free, *derivatives = (float(v) for v in f(1.0))
    assert free == 0.0
    assert abs(bounded) < 1e-15
    assert derivatives == [0.0, 0.0, 0.0, 0.0]


def test_a_measured_normal_costs_its_squared_chord():
    n, n_m = np.array([0.6, 0, 0.8]), np.array([0.0, 0.6, 0.8])
    cost = float(sensing.normal(ca.DM(n), ca.DM(n_m), 0.1))
    assert cost == pytest.approx(((0.6**2 + 0.6**2) / 0.02), rel=1e-14)


def test_a_touch_costs_quadratically_near_and_linearly_far():
    sigma = 0.3e-3
    assert float(sensing.touch(0.0, sigma)) == 0.0
    near, far = 0.1 * sigma, 100 * sigma
    # Off by (phi / 4 sigma)^2 near and by 4 nats of 200 far.
    assert float(sensing.touch(near, sigma)) == pytest.approx(0.1**2 / 2, rel=1e-3)
    assert float(sensing.touch(far, sigma)) == pytest.approx(2 * 100 - 4, rel=1e-3)
    assert float(sensing.touch(-far, sigma)) == float(sensing.touch(far, sigma))


def test_no_sample_costs_more_than_the_ceiling_and_none_more_than_alone():
    for cost in (0.0, 0.5, 3.0, 7.0, 30.0, 1e6):
        bounded = float(sensing.mixture(cost, 7.0))
        most = 7.0 + np.log1p(np.exp(-7.0))
        assert bounded <= min(cost, most) + 1e-15
        direct = -np.log((np.exp(-cost) + np.exp(-7.0)) / (1 + np.exp(-7.0)))
        assert bounded == pytest.approx(direct, abs=1e-12)


# Contact


@pytest.mark.parametrize("seed", range(3))
def test_tangents_and_normal_are_a_right_handed_frame(seed):
    rng = np.random.default_rng(seed)
    n, t = rng.normal(size=(2, 3))
    n /= np.linalg.norm(n)
    t_1, t_2 = (np.asarray(v).ravel() for v in contact.tangents(ca.DM(n), ca.DM(t)))
    frame = np.array([n, t_1, t_2])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-8)  # 1e-9 rounds |t|
    assert np.linalg.det(frame) == pytest.approx(1, abs=1e-8)
    assert t_1 @ t > 0


def test_the_friction_cone_is_that_of_coulomb_but_for_its_apex():
    rounding = 1e-3
    inside, on, outside = ([2.0, 0.6 * s, 0.8 * s] for s in (0.9, 1.0, 1.1))
    for lam, exact in ((inside, 0.1), (on, 0.0), (outside, -0.1)):
        value = float(contact.cone(0.5, ca.DM(lam), rounding))
        assert exact <= value <= exact + rounding
    assert float(contact.cone(0.5, ca.DM.zeros(3), rounding)) == 0.0


def test_friction_that_opposes_sliding_at_the_cone_dissipates_all_it_can():
    mu, still, v = 0.5, 1e-4, np.array([0.06, -0.08])
    opposing = np.r_[2.0, -mu * 2.0 * v / 0.1]
    least = float(contact.dissipation(mu, ca.DM(opposing), ca.DM(v), still))
    # sqrt(v^2 + still^2) - v = still^2 / (2 v)
    assert 0 <= least <= mu * 2.0 * still**2 / 0.2 * 1.001
    rng = np.random.default_rng(7)
    for _ in range(100):
        direction = rng.normal(size=2)
        share = rng.uniform(0, 1) * mu * 2.0 / np.linalg.norm(direction)
        lam = ca.DM(np.r_[2.0, share * direction])
        assert float(contact.dissipation(mu, lam, ca.DM(v), still)) >= least


def test_an_impulse_needs_contact_and_returns_no_energy():
    lam = ca.DM([2.0, 0, 0])
    for of in (contact.complementarity, contact.inelasticity):
        assert float(of(lam, 1e-2, 1e-6)) == pytest.approx(2e-2, rel=1e-6)
        assert float(of(lam, -1e-2, 1e-6)) == pytest.approx(0, abs=1e-9)
        assert float(of(0 * lam, 1e-2, 1e-6)) == 0


# Whole pages


def programme(page, data, scene, choice=None, finger=None):
    """Return the problem and the window that a page makes of data."""
    window = reduce(data, scene, CUBOID, SENSORS, choice or Reductions())
    if finger is not None:
        window = replace(window, **finger(window))
    problem = Problem()
    page.build(problem, window, scene, CUBOID)
    return problem, window


def true_values(problem, window, truth, rng=None):
    """Return theta and poses as they were; impulses at random if `rng` is given."""
    position = truth["object_position"][window.last]
    R = Rotation.from_quat(np.roll(truth["object_quaternion"], -1, axis=1))[window.last]
    x = np.vstack([position.T[:2], R.as_euler("xyz").T[2:]])
    if window.motion is FREE:
        x = np.vstack([position.T, R.as_rotvec().T])
    values = {"theta": truth["side_lengths"], "x": x}
    for name in ("finger", "ground"):
        if rng is not None and name in problem.variables:
            v = problem.variables[name]
            force = v.scale[:, None] * rng.normal(size=(3, v.columns))
            values[name] = np.vstack([np.abs(force[:1]), force[1:]])
    return values


def cost(problem, values):
    x, data = problem.pack(values), problem.data()
    return {name: problem.value(name, x, data).sum() for name in problem.costs}


CASES = {
    "planar": {},
    "free": {"choice": Reductions(planar=False)},
    "unreduced, unknown friction": {
        "choice": Reductions(still=False, far=False, absent=False),
        "scene": {"friction_ground": None, "friction_finger": None},
    },
    "no ground": {
        "choice": Reductions(planar=False),
        "scene": {"ground": None, "gravity": 0.0},
    },
}


@pytest.fixture(scope="module")
def touched(recorded):
    """The first two actions of the recording: from the top, then on two sides."""
    data, scene, truth = recorded
    return data.select(range(2)), scene, truth


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("page", PAGES)
def test_every_term_of_a_page_has_the_derivatives_of_finite_differences(
    page, case, touched, request
):
    if case not in ("planar", "free"):  # used nowhere else: not worth compiling
        request.getfixturevalue("interpreted")
    data, scene, truth = touched
    scene = replace(scene, **CASES[case].get("scene", {}))
    problem, window = programme(PAGES[page], data, scene, CASES[case].get("choice"))
    rng = np.random.default_rng(8)
    values = true_values(problem, window, truth, rng)
    if case == "no ground":  # at rest its balance is flat: differences are rounding
        x = problem.variables["x"]
        values["x"] += x.scale[:, None] * rng.normal(size=(x.rows, x.columns))
    report = problem.check(values)
    for name, (first, second) in report.derivatives.items():
        # Steps of 6e-6 of a scale, edges rounded over a tenth of one: 1e-8, rounding.
        assert first < 1e-5, name
        assert second < 1e-5, name
    assert report.assembled < 1e-5
    # Without a ground nothing tells how the object goes on between actions.
    idle = {"ground friction", "gap scale"} if case == "no ground" else set()
    assert set(report.unused) <= idle


@pytest.mark.parametrize("case", ["planar", "free"])
@pytest.mark.parametrize("page", PAGES)
def test_moving_the_whole_world_over_the_ground_costs_nothing(page, case, touched):
    data, scene, truth = touched
    spin, t = Rotation.from_euler("z", 0.8), np.array([0.3, -0.2, 0.0])
    moved = data.transformed(spin.as_matrix(), t)
    choice = CASES[case].get("choice")
    problem, window = programme(PAGES[page], data, scene, choice)

    def carry_tangents(_):
        # Where a finger touches the top, t1 is a fixed direction: it moves as well.
        return {"push": replace(window_2.push, tangent=spin.apply(window.push.tangent))}

    window_2 = reduce(moved, scene, CUBOID, SENSORS, choice or Reductions())
    problem_2, _ = programme(PAGES[page], moved, scene, choice, carry_tangents)
    values = true_values(problem, window, truth, np.random.default_rng(9))
    there = dict(values)
    x = values["x"]
    rows = 3 if window.motion is FREE else 2
    position = np.vstack([x[:rows], np.zeros((3 - rows, x.shape[1]))])
    there["x"] = np.vstack([(spin.apply(position.T) + t).T[:rows], x[rows:] + 0.8])
    if window.motion is FREE:
        turned = spin * Rotation.from_rotvec(x[3:].T)
        there["x"][3:] = turned.as_rotvec().T
    if "ground" in values:
        force = values["ground"][[1, 2, 0]]  # along x, y, z
        there["ground"] = spin.apply(force.T).T[[2, 0, 1]]
    here, moved_cost = cost(problem, values), cost(problem_2, there)
    for name in here:
        # Positions of 0.3 m, known to 1e-16 of that, are compared with 1e-4 m.
        assert moved_cost[name] == pytest.approx(here[name], rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize("case", ["planar", "free"])
@pytest.mark.parametrize("page", PAGES)
def test_a_quarter_turn_with_two_sides_swapped_is_the_same_body(page, case, touched):
    data, scene, truth = touched
    problem, window = programme(PAGES[page], data, scene, CASES[case].get("choice"))
    values = true_values(problem, window, truth, np.random.default_rng(10))
    other = dict(values)
    other["theta"] = values["theta"][[1, 0, 2]]
    other["x"] = (
        values["x"] + np.array([[0], [0], [np.pi / 2]] + [[0]] * 3)[: len(values["x"])]
    )
    if window.motion is FREE:
        R = Rotation.from_rotvec(values["x"][3:].T) * Rotation.from_euler(
            "z", np.pi / 2
        )
        other["x"] = np.vstack([values["x"][:3], R.as_rotvec().T])
    if "ground" in values:
        # The corner (a, b) of the old body is (b, -a) of the turned one.
        signs, step = window.corner.signs, window.corner.step
        order = np.empty(len(step), int)
        for i, (a, b, c) in enumerate(signs):
            same = (signs == [b, -a, c]).all(axis=1) & (step == step[i])
            order[np.nonzero(same)[0][0]] = i
        other["ground"] = values["ground"][:, order]
    here, there = cost(problem, values), cost(problem, other)
    for name in here:
        assert there[name] == pytest.approx(here[name], rel=1e-9, abs=1e-9), name


def test_where_the_object_slides_the_impulses_are_those_of_the_simulator(recorded):
    data, scene, truth = recorded
    problem, window = programme(violation_implicit, data, scene)
    values = true_values(problem, window, truth)
    known = tuple({"theta", "x", "depth"} & set(problem.variables))
    options = SolverOptions(barrier=1e-1)
    solution = solve(problem, options, start=values, fixed=known)
    x, push = problem.pack(solution.values), window.push
    impulse = problem.value("finger impulse", x, problem.data())
    way = np.diff(truth["object_position"], axis=0, prepend=np.nan)
    sliding = np.linalg.norm(way, axis=1)[push.sample] > 2e-3
    assert sliding.sum() > 10
    true = truth["truth_impulse"][push.sample, push.finger]
    error = np.linalg.norm(impulse - true, axis=1)[sliding] / (scene.mass * 9.81 / 30)
    # In weights: at 6 cm/s friction with the ground, 0.3, is known in size and sense.
    # The simulator's contacts are not quite rigid, and two fingers share a push; a
    # wrong sign or frame would be off by one weight everywhere.
    assert np.median(error) < 0.25
    assert error.max() < 0.8


SIDES, POSE = np.array([0.04, 0.06, 0.05]), np.array([0.01, -0.02, 0.3])


def squeezed(samples=8):
    """Measure a cuboid at rest, touched on two opposite sides, two others, and the top.

    Three actions of two fingers that stay where they touch.
    """
    rng = np.random.default_rng(11)
    R, centre = Rotation.from_euler("z", POSE[2]), np.r_[POSE[:2], SIDES[2] / 2]
    p, n = np.zeros((3, 2, 3)), np.zeros((3, 2, 3))
    for axis, (f, side) in itertools.product(range(3), enumerate((1, -1))):
        out = side * np.eye(3)[axis]
        inner = rng.uniform(-0.3, 0.3, 3) * SIDES * (out == 0)
        n[axis, f] = R.apply(out)
        p[axis, f] = R.apply(out * (SIDES / 2 + RHO) + inner) + centre
    p[2, 1], n[2, 1] = [0.2, 0.2, 0.2], 0  # there is no way below: it waits
    action = np.repeat(np.arange(3), samples)
    return Measurements(
        time=np.arange(len(action)) / 30, finger_position=p[action],
        finger_radius=RHO, contact=n[action].any(axis=2), normal=n[action],
        action=action,
    )  # fmt: skip


def with_capsules(window):
    """Make every fingertip a capsule that stands upright."""
    upright = [1.0, 0, 0, 0]
    rows = {}
    for name in ("touch", "free"):
        of = getattr(window, name)
        p_wf = np.hstack([of.p_wf, np.tile(upright, (len(of), 1))])
        rows[name] = replace(of, p_wf=p_wf)
    return {"finger": capsule(0.005), **rows}


@pytest.mark.parametrize(
    ("page", "finger"),
    [
        ("quasi_static", None),
        ("quasi_static", with_capsules),
        ("violation_implicit", None),
    ],
    ids=["quasi_static", "quasi_static with capsules", "violation_implicit"],
)
def test_a_cuboid_touched_on_both_faces_has_the_sides_between_them(
    page, finger, interpreted
):
    data, scene = squeezed(), Scene(mass=0.5)
    if finger is not None:
        data = raised(data)
    problem, window = programme(PAGES[page], data, scene, finger=finger)
    off = 2e-3 if page == "quasi_static" else 0.2e-3  # the second starts from the first
    start = {
        "theta": SIDES + off,
        "x": np.tile(POSE[:, None], (1, window.knots)) + off / 2,
    }
    options = SolverOptions(tolerance=1e-8)
    solution = solve_levels(problem, PAGES[page].LEVELS, start, options)
    assert solution.success
    # Eight touches a face, of 0.3 mm, against a prior of 20 mm that is up to 20 mm
    # away; gaps are rounded by a few micrometres.
    np.testing.assert_allclose(solution.values["theta"][:, 0], SIDES, atol=0.02e-3)
    x = solution.values["x"]
    np.testing.assert_allclose(
        x[:2], np.tile(POSE[:2, None], window.knots), atol=0.02e-3
    )
    np.testing.assert_allclose(x[2], POSE[2], atol=1e-3)
    if page == "violation_implicit":
        assert_at_rest(problem, window, solution, scene)


def assert_at_rest(problem, window, solution, scene):
    """All impulses of a step add up to what carries the weight."""
    x, data = problem.pack(solution.values), problem.data()
    total = np.zeros((len(window.step), 3))
    for name, of in (("finger", window.push), ("ground", window.corner)):
        np.add.at(total, of.step, problem.value(f"{name} impulse", x, data))
    weight = scene.mass * 9.81 / 30
    # A balance that is off by 3 % of the weight costs half a nat.
    np.testing.assert_allclose(total, np.tile([0, 0, weight], (len(total), 1)),
                               atol=0.03 * weight)  # fmt: skip


def raised(data):
    """Lift the fingers on the top by the half length of an upright capsule."""
    p = data.finger_position.copy()
    p[data.normal[..., 2] > 0.5] += [0, 0, 0.005]
    return replace(data, finger_position=p)


def test_a_size_ten_deviations_off_is_rare_but_not_impossible():
    z = ca.SX.sym("z")
    cost = sensing.heavy_tailed(z)
    curve = ca.Function("curve", [z], [cost, ca.hessian(cost, z)[0]])
    assert [float(v) for v in curve(0)] == pytest.approx([0, 1])
    assert float(curve(0.5)[0]) == pytest.approx(0.5**2 / 2, rel=0.05)
    assert float(curve(10)[0]) < 7  # nats, where a Gaussian asks for 50
    assert float(curve(-10)[0]) == pytest.approx(float(curve(10)[0]))
