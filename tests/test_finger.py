"""A capsule touches a cuboid where brute force says."""

import pickle

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solid import RHO, angle, around, solid_distance, solid_normal

from formulations.finger import SPHERE, capsule
from formulations.rigid_body import FREE
from formulations.shape import CUBOID

# The solid is rounded by a tenth of a fingertip: gaps are right to a thirtieth of a
# millimetre and normals to half a degree wherever a fingertip can be.
GAP, ANGLE = 0.03e-3, np.radians(0.5)


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
