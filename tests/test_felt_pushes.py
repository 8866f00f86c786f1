"""Paths of bodies that are known only where fingers feel them, and full geometry."""

from dataclasses import dataclass
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from formulations.polytope import polytope
from formulations.quasi_static import add_least_motion, add_unpredicted_motion
from formulations.rigid_body import PLANAR
from formulations.shape import CUBOID
from tactilenlp import Problem, Scene
from tactilenlp.problem.window import Steps
from tactilenlp.search.predicted_motion import with_motion, with_pushes
from tactilenlp.tracking.felt_pushes import pushed_paths, pushed_steps
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


def test_fingers_that_pinch_a_body_turn_it_with_the_line_between_them():
    left, right = pushes(0.0), pushes(0.0)
    k = np.arange(12)
    for finger, side in (left, -1), (right, 1):
        finger.finger_position[:, 0, 0] = side * (HALF + RADIUS - 2e-5 * k)
        finger.finger_position[:, 0, 1] = side * 3e-4 * k
        finger.normal[:, 0, 0] = side
    names = "finger_position", "normal", "contact", "valid"
    both = {n: np.hstack([getattr(d, n) for d in (left, right)]) for n in names}
    radius = np.full(2, RADIUS)
    data = SimpleNamespace(**both, finger_radius=radius, action=left.action)
    (path,) = pushed_paths(data, np.arange(12), states(0.015), np.ones(1), FRICTION)
    (a, b) = data.finger_position[-1]
    line = np.arctan2((b - a)[1], (b - a)[0])
    assert path[2, -1] == pytest.approx(line, rel=0.25)
    np.testing.assert_allclose(path[:2], 0.0, atol=1e-4)


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


def path_of(data):
    """Return the path (3, T) along which a finger pushes the body of foot 0.015 m."""
    onset = np.full(1, 0.5)  # the share of `pushed_steps`
    return pushed_paths(data, np.arange(12), states(0.015), onset, FRICTION)[0]


def test_along_a_predicted_path_the_predicted_motion_is_that_of_the_path():
    data = pushes(8e-3)
    path = path_of(data)
    steps = pushed_steps(data, path, 0.015, FRICTION)
    np.testing.assert_allclose(steps[:, 1:], np.diff(path, axis=1), atol=1e-9)
    assert not steps[:, 0].any()
    data.contact[:] = False
    assert not pushed_steps(data, path, 0.015, FRICTION).any()


@dataclass(frozen=True)
class Moved:
    """A window of which only its steps are read."""

    step: Steps


def window_of_steps() -> Moved:
    """Return the steps of a window in which every sample has a pose of its own."""
    k = np.arange(1, 12)
    steps = Steps(k, k, k - 1, np.maximum(k - 2, 0), k / 30, k / 30, np.zeros((11, 3)))
    return Moved(steps)


def test_predicted_motion_does_not_depend_on_where_a_body_has_its_origin():
    """The same path of the centre of mass, told by another point of the body."""
    data, path = pushes(8e-3), path_of(pushes(8e-3))
    size = SimpleNamespace(size_prior=(0.03, 0.01))
    scene = Scene(friction_ground=FRICTION[0], friction_finger=FRICTION[1])
    job = SimpleNamespace(data=data, shape=size, scene=scene)
    centre = np.array([4e-3, -7e-3])
    c, s = np.cos(path[2]), np.sin(path[2])
    turned = np.array([c * centre[0] - s * centre[1], s * centre[0] + c * centre[1]])
    other = np.vstack([path[:2] - turned, path[2]])
    moved = with_pushes(job, window_of_steps(), other, centre).step.motion
    np.testing.assert_allclose(moved, np.diff(other, axis=1).T, atol=1e-9)
    afloat = SimpleNamespace(data=data, shape=size, scene=Scene(ground=None))
    assert not with_pushes(afloat, window_of_steps(), other).step.motion.any()


def test_motion_costs_nothing_where_it_is_as_predicted():
    path = path_of(pushes(8e-3))
    window = with_motion(window_of_steps(), np.diff(path, axis=1, prepend=path[:, :1]))
    costs = {}
    for name, add in (
        ("unpredicted motion", add_unpredicted_motion),
        ("least motion", add_least_motion),
    ):
        nlp = Problem()
        x = nlp.variable("x", 3, 12, guess=path, unit="m, m, rad", scale=1e-3)
        unseen = np.zeros(0, int)
        whole = SimpleNamespace(motion=PLANAR, step=window.step, unseen_steps=unseen)
        add(nlp, whole, polytope(), 0.0, x)
        costs[name] = nlp.value(name, nlp.pack({}), nlp.data()).sum()
    assert costs["unpredicted motion"] == pytest.approx(0.0, abs=1e-9)
    assert costs["least motion"] > 1.0
