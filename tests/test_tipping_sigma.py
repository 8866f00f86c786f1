"""A body that the ground carries on one edge may have been tipped: sigma says so."""

from types import SimpleNamespace

import numpy as np
import pytest

from formulations.names import GROUND, NORMAL_SCALE, TOUCH_SCALE
from formulations.rigid_body import PLANAR
from formulations.shape import CUBOID
from tactilenlp.information.trajectory import errors_of_tipping
from tactilenlp.problem.poses import body_corners
from tactilenlp.problem.window import Pushes, Samples, Steps

SIDES, RADIUS = np.array([0.04, 0.06, 0.05]), 0.01
HIGH, WAY = 0.04, 2e-3  # [m] of the finger over the ground; that it moves in a step
YAW = 0.3


def linearisation(on_edge, sigma=1e6, lean=0.0, let_go=None):
    """Return what is read of a solve in which a finger pushes towards +x for 4 steps.

    on_edge (4,): whether the ground carries the body on its edge +x alone; lean: by
    which share of the finger's way over its height the felt normals lean; let_go: the
    step from which on nothing pushes.
    """
    n, one = len(on_edge), np.ones(len(on_edge))
    pose = np.arange(1, n + 1)
    loads = np.array([[0, 1, 0, 1] if edge else [1, 1, 1, 1] for edge in on_edge])
    pushing = np.arange(n) < (n if let_go is None else let_go)
    forward = np.array([np.cos(YAW), np.sin(YAW), 0.0])
    p = pose[:, None] * WAY * forward + [0, 0, HIGH]
    tip = lean * WAY / HIGH * np.arange(1, n + 1)
    normal = -forward * np.cos(tip)[:, None] + np.outer(np.sin(tip), [0, 0, 1.0])
    none = np.zeros(n, int)
    touch = Samples(pose, none, pose, p, RADIUS * one, normal, 0 * one)
    push = Pushes(
        pose, none, np.arange(n), pose - 1, p, p - WAY * forward, RADIUS * one, normal
    )  # fmt: skip
    step = Steps(pose, pose, pose - 1, pose - 1, one, one, np.zeros((n, 3)))
    window = SimpleNamespace(
        shape=CUBOID, motion=PLANAR, poses=n + 1, step=step, touch=touch,
        push=push.pick(pushing), unfelt=np.zeros(0, int), corner=range(4 * n),
        supports=lambda theta: body_corners(CUBOID, theta),
    )  # fmt: skip
    parameters = {TOUCH_SCALE: slice(0, 1), NORMAL_SCALE: slice(1, 2)}
    problem = SimpleNamespace(
        parameters={name: SimpleNamespace(span=s) for name, s in parameters.items()}
    )
    x = np.vstack([np.zeros((2, n + 1)), np.full(n + 1, YAW)])
    values = {"theta": SIDES[:, None], "x": x, GROUND: loads.reshape(1, -1)}
    return SimpleNamespace(
        window=window, values=values, R_wg=np.eye(3),
        kkt=SimpleNamespace(problem=problem, data=np.array([1e-3, sigma])),
        job=SimpleNamespace(data=SimpleNamespace(action=np.zeros(n + 1, int))),
    )  # fmt: skip


def test_a_body_on_its_edge_may_turn_by_the_way_of_the_finger_over_its_height():
    sigma = np.sqrt(np.diagonal(errors_of_tipping(linearisation([1] * 4)), 0, 1, 2))
    tip = WAY / HIGH * np.arange(5) / np.sqrt(3)  # any share of it
    across, along = tip * abs(np.sin(YAW)), tip * np.cos(YAW)
    assert sigma[:, 2] == pytest.approx(tip * SIDES[0] / 2)  # its middle rises
    assert sigma[:, 3] == pytest.approx(across)
    assert sigma[:, 4] == pytest.approx(along)
    # The finger stays on the face: the middle moves as it is lower than the finger.
    assert sigma[:, 0] == pytest.approx(along * (HIGH - SIDES[2] / 2))
    assert not sigma[:, 5].any()


def test_a_body_that_all_corners_carry_does_not_tip():
    assert not errors_of_tipping(linearisation([0] * 4)).any()


def test_a_tip_begins_where_the_edge_carries_and_ends_where_the_finger_lets_go():
    C = errors_of_tipping(linearisation([0, 1, 0, 0], let_go=3))
    assert C[:, 2, 2].nonzero()[0].tolist() == [2, 3]
    assert C[3, 2, 2] == pytest.approx(4 * C[2, 2, 2])


def test_it_tips_no_farther_than_to_where_it_falls():
    C = errors_of_tipping(linearisation([1] * 80))
    over = np.arctan2(SIDES[0], SIDES[2]) / np.sqrt(3)
    assert np.sqrt(C[-1, 3, 3] + C[-1, 4, 4]) == pytest.approx(over)


def test_felt_normals_tell_how_far_it_tipped():
    blind = errors_of_tipping(linearisation([1] * 4))[-1, 2, 2]
    level = errors_of_tipping(linearisation([1] * 4, sigma=0.01))[-1, 2, 2]
    leans = errors_of_tipping(linearisation([1] * 4, sigma=0.01, lean=1.0))[-1, 2, 2]
    assert level < 0.01 * blind
    assert leans == pytest.approx(3 * blind, rel=0.05)  # it tipped all the way
