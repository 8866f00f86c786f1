"""Rotations and momentum, as a body in free fall and one that tumbles say."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from formulations.rigid_body import FREE, momentum_change, rotation, turn, uniform
from formulations.shape import CUBOID


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
    poses = [FREE.pose(CUBOID, ca.DM(theta), c) for c in (x, x_1, x_2)]
    out = momentum_change(uniform(CUBOID, ca.DM(theta)), poses, dt)
    return (np.asarray(o).ravel() for o in out)


def test_a_body_in_free_fall_gains_g_dt_and_no_spin():
    dt, g = 1 / 30, 9.81
    R = Rotation.from_rotvec([0.2, 0.3, 0.4]).as_matrix()
    v = np.array([0.3, -0.2, 0.1])
    poses = [(v * t + [0, 0, -g * t**2 / 2], R) for t in np.arange(3) * dt]
    linear, angular = changes([0.04, 0.06, 0.05], poses, dt)
    np.testing.assert_allclose(linear, [0, 0, -g * dt], atol=1e-12)
    np.testing.assert_allclose(angular, 0, atol=1e-15)


def test_a_body_that_coasts_gains_nothing_whatever_the_times_of_samples():
    """Two steps of 1/30 and 3/30 s, of one velocity and one spin."""
    times, v, spin = np.array([0, 1, 4]) / 30, np.array([0.3, -0.2, 0.1]), 1.5
    poses = [(v * t, Rotation.from_euler("z", spin * t).as_matrix()) for t in times]
    x_2, x_1, x = (
        ca.DM(np.r_[p, Rotation.from_matrix(R).as_rotvec()]) for p, R in poses
    )
    body = uniform(CUBOID, ca.DM([0.04, 0.06, 0.05]))
    found = [FREE.pose(CUBOID, ca.DM([0.04, 0.06, 0.05]), c) for c in (x, x_1, x_2)]
    linear, angular = momentum_change(body, found, 3 / 30, 1 / 30)
    np.testing.assert_allclose(np.asarray(linear).ravel(), 0, atol=1e-12)
    np.testing.assert_allclose(np.asarray(angular).ravel(), 0, atol=1e-9)


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
