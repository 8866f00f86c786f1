"""Paths of bodies that are known only where fingers feel them, and full geometry."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp.tracking.felt_pushes import pushed_paths
from tactilenlp.tracking.pushing import Move, felt_push_motion, push_motion

RADIUS, HALF = 5e-3, 0.02  # [m]
FRICTION = (0.3, 0.5)
SIDES = [2 * HALF, 2 * HALF, 0.03]


def pushes(offset):
    """Return what one finger feels at an offset [m] as it pushes 12 samples along x."""
    k = np.arange(12)[:, None]
    x = -HALF - RADIUS + 1e-3 * k
    return SimpleNamespace(
        finger_position=np.stack([x, 0 * x + offset, 0 * x + 0.01], axis=2),
        normal=np.tile([-1.0, 0.0, 0.0], (12, 1, 1)), contact=k > 0,
        valid=np.ones((12, 1), bool), finger_radius=np.array([RADIUS]),
        action=np.zeros(12, int),
    )  # fmt: skip


def states(*feet):
    return np.array([[foot, 0.0, 0.0, 0.0] for foot in feet]).T


def test_a_push_through_the_centre_moves_a_body_as_far_as_the_finger():
    data = pushes(0.0)
    (path,) = pushed_paths(data, np.arange(12), states(0.015), np.ones(1), FRICTION)
    np.testing.assert_allclose(path[0], 1e-3 * np.arange(12), atol=1e-6)
    np.testing.assert_allclose(path[1:], 0.0, atol=1e-6)


def test_pushes_on_either_side_turn_a_body_either_way_alike():
    ends = [
        pushed_paths(pushes(y), np.arange(12), states(0.015), np.ones(1), FRICTION)[0]
        for y in (8e-3, -8e-3)
    ]
    assert ends[0][2, -1] < -0.05  # the force is along x, above the centre
    np.testing.assert_allclose(ends[0][2], -ends[1][2], atol=1e-9)
    np.testing.assert_allclose(ends[0][1], -ends[1][1], atol=1e-9)


def test_a_wider_support_turns_less():
    narrow, wide = pushed_paths(
        pushes(8e-3), np.arange(12), states(0.008, 0.02), np.ones(2), FRICTION
    )
    assert abs(narrow[2, -1]) > 1.2 * abs(wide[2, -1])


def test_a_touch_that_begins_late_pushes_less_and_none_moves_nothing():
    data = pushes(0.0)
    onset = np.array([1.0, 0.25])
    whole, late = pushed_paths(data, np.arange(12), states(0.01, 0.01), onset, FRICTION)
    assert whole[0, 1] - late[0, 1] == pytest.approx(0.75e-3, rel=1e-6)
    data.contact[:] = False
    still = pushed_paths(data, np.arange(12), states(0.01), np.ones(1), FRICTION)
    assert not still.any()


def test_a_felt_push_is_that_of_the_geometry_where_the_surface_is_known():
    """On a flat side both laws agree: the same contact, the same support."""
    z, before = ca.SX.sym("z", 6), ca.SX.sym("before", 3)
    p_0, p_1 = ca.SX.sym("p_0", 3), ca.SX.sym("p_1", 3)
    move = Move(p_0, p_1, ca.SX(RADIUS), ca.SX(0.7))
    full = push_motion(CUBOID, z, [move], before, FRICTION)
    foot = ca.vertcat(HALF, z[3:])
    normal = ca.SX([-1.0, 0.0, 0.0])
    felt = felt_push_motion(foot, [move], [normal], [1.0], before, FRICTION)
    both = ca.Function("both", [z, before, p_0, p_1], [full, felt])
    x = -HALF - RADIUS
    args = [*SIDES, 0, 0, 0], [0, 0, 0], [x, 5e-3, 0.01], [x + 1e-3, 5.2e-3, 0.01]
    known, as_felt = (np.asarray(out).ravel() for out in both(*args))
    np.testing.assert_allclose(as_felt, known, rtol=0.02, atol=1e-6)
    assert abs(known[2]) > 1e-3


def test_the_way_of_a_finger_between_two_actions_pushes_nothing():
    data = pushes(0.0)
    data.action[5:] = 1  # its first sample is in contact, far from where it was
    data.finger_position[5:, 0, 0] += 5e-3
    (path,) = pushed_paths(data, np.arange(12), states(0.015), np.ones(1), FRICTION)
    steps = np.diff(path[0])
    assert steps[4] == 0.0
    np.testing.assert_allclose(np.delete(steps, 4), 1e-3, rtol=1e-3)
