"""What an action is expected to tell of a hull: unseen faces most, felt ones little."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from believed import known
from scipy.spatial.transform import Rotation

from formulations import pushed_hull
from formulations.polytope import polytope, polytope_distance, polytope_normal
from tactilenlp import (
    Estimate,
    ExpectedInformation,
    Scene,
    Workspace,
    World,
    choose_action,
    expected_information_gain,
    information_gain,
)
from tactilenlp.exploration.polytope_beliefs import ball_prior

SPACE = Workspace(fingers=1)
SIDE = 0.03  # [m] of the cube
CUBE = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * SIDE
EDGES = [(i, j) for i in range(8) for j in (i | 1, i | 2, i | 4) if i != j]
VERTICES = np.vstack([CUBE, [CUBE[[i, j]].mean(axis=0) for i, j in EDGES]])  # 20
SIDES = {"right": 0.0, "back": np.pi / 2, "left": np.pi, "front": -np.pi / 2}
FELT = ("top", "left", "front", "back")


def touch(side, yaw=0.0):
    """Return the action of a finger that touches one side of the cube."""
    if side == "top":
        return SPACE.action([wrapped(yaw + np.pi), 1.25])
    return SPACE.action([wrapped(yaw + SIDES[side]), 0.1])


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def turned(estimate):
    return Rotation.from_quat(np.roll(estimate.quaternion[-1], -1)).as_euler("zyx")[0]


def estimate_of(world, data, vertices=VERTICES) -> Estimate:
    """Return what stands for an estimate: the truth, and what was felt."""
    return known(
        unknowns={"x": np.zeros((3, 1))}, information=SimpleNamespace(maps={}),
        shape="polytope", scene=Scene(), precision={"position": 0.0, "normal": 0.0},
        measurements=data, position=world.truth.object_position, theta=vertices.ravel(),
        quaternion=world.truth.object_quaternion, body_vertices=vertices,
    )  # fmt: skip


@pytest.fixture(scope="module")
def touched():
    """Estimates of a cube after one more side each was touched."""
    world, data, found = World(vertices=CUBE, finger_radius=[0.01]), None, []
    for side in FELT:
        yaw = 2 * np.arctan2(world.pose[6], world.pose[3])
        new = world.execute(touch(side, yaw).trajectory(world.pose[:3]))
        data = new if data is None else data.append(new)
        found.append(estimate_of(world, data))
    return found


@pytest.fixture(scope="module")
def cube(touched):
    return touched[-1]


@pytest.fixture(scope="module")
def expected(cube):
    return ExpectedInformation(cube, SPACE)


def actions(count, seed=0):
    rng = np.random.default_rng(seed)
    return [SPACE.random(rng) for _ in range(count)]


def test_the_called_distance_is_that_of_the_page_and_so_are_its_slopes():
    theta, rng = VERTICES.ravel(), np.random.default_rng(0)
    for page, called in (
        (polytope_distance, pushed_hull.distance),
        (polytope_normal, pushed_hull.normal),
    ):
        both = []
        for function, sym in ((page, ca.SX.sym), (called, ca.MX.sym)):
            t, q = sym("t", 60), sym("q", 3)
            out = function(t, q, 1e-3)
            slopes = ca.densify(ca.jacobian(out, ca.vertcat(t, q)))
            both.append(ca.Function("f", [t, q], [out, slopes], {"cse": True}))
        for way in rng.normal(size=(6, 3)):
            point = 0.03 * way / np.linalg.norm(way)
            (value, slopes), (again, others) = (
                [v.full() for v in f(theta, point)] for f in both
            )
            assert np.allclose(value, again, atol=2e-5)  # [m], [-]
            most = np.abs(slopes).max()
            assert np.allclose(slopes, others, atol=1e-2 * most)


@pytest.mark.slow
@pytest.mark.parametrize("slopes", ["motion", "identity"])
def test_no_action_is_expected_to_lose_information(cube, slopes):
    expected = ExpectedInformation(cube, SPACE, slopes=slopes)
    for action in actions(15):
        F = expected.prospect(action).information
        assert F.shape == (60, 60)
        assert np.linalg.eigvalsh(F).min() >= -1e-9 * np.abs(F).max()
        assert expected.gain(action) > 0


def test_two_actions_tell_as_much_in_either_order_and_in_any_unit(expected):
    before = expected.beliefs[0].information
    a, b = (expected.prospect(action).information for action in actions(2))
    both = information_gain(before, a + b)
    for one, then in ((a, b), (b, a)):
        chain = information_gain(before, one) + information_gain(before + one, then)
        assert both == pytest.approx(chain, abs=1e-6)
    assert information_gain(1e-6 * before, 1e-6 * a) == pytest.approx(
        information_gain(before, a), abs=1e-6
    )  # in millimetres


def test_neither_the_order_of_vertices_nor_the_place_matters(cube):
    order = np.random.default_rng(0).permutation(20)
    fields = {"body_vertices": VERTICES[order], "theta": VERTICES[order].ravel()}
    again = known(**vars(cube) | fields)
    away, data = np.array([0.3, -0.2, 0.0]), cube.measurements
    moved = replace(data, finger_position=data.finger_position + away)
    fields = {"measurements": moved, "position": cube.position + away}
    there = known(**vars(cube) | fields)
    for action in actions(4):
        gain = expected_information_gain(cube, action)
        for same in (again, there):
            other = expected_information_gain(same, action)
            assert other == pytest.approx(gain, rel=1e-6)


def side_gains(estimate) -> dict:
    """Return the gain of touching each side of a cube."""
    yaw = turned(estimate)
    return {
        side: expected_information_gain(estimate, touch(side, yaw))
        for side in (*SIDES, "top")
    }


def test_the_side_that_was_not_touched_gains_most(cube):
    gains = side_gains(cube)
    assert max(gains, key=gains.get) == "right", gains
    assert gains["right"] > 1.3 * max(v for k, v in gains.items() if k != "right")


def test_a_face_that_was_felt_has_less_to_tell(touched):
    before, after = (side_gains(estimate) for estimate in touched[:2])
    assert after["left"] < 0.6 * before["left"]


def test_what_is_known_before_any_touch_is_a_ball_anywhere():
    mean, deviation = polytope().size_prior
    C = np.linalg.inv(ball_prior(CUBE, (mean, deviation))).reshape(8, 3, 8, 3)
    middle = C.mean(axis=(0, 2))
    assert np.sqrt(np.diag(middle)) == pytest.approx(0.1, rel=0.01)
    between = C[0, :, 0] + C[7, :, 7] - C[0, :, 7] - C[7, :, 0]  # opposite corners
    way = (CUBE[7] - CUBE[0]) / np.linalg.norm(CUBE[7] - CUBE[0])
    width = (2 * deviation) ** 2 + 2 * (0.2 * mean) ** 2  # the ball's, the corners' own
    assert way @ between @ way == pytest.approx(width, rel=1e-6)


def test_every_touch_makes_what_is_known_more(touched):
    """Of the top's height by touching it, and of the whole by every touch."""
    known = [ExpectedInformation(e, SPACE).beliefs[0] for e in touched]
    top = np.zeros((20, 3))
    top[VERTICES[:, 2] > 0.0149, 2] = 1 / 8
    for belief in known:
        assert (
            np.sqrt(top.ravel() @ np.linalg.solve(belief.information, top.ravel()))
            < 1e-3
        )
    volumes = [np.linalg.slogdet(belief.information)[1] for belief in known]
    before = np.linalg.slogdet(known[0].before)[1]
    assert (np.diff([before, *volumes]) > 3).all()  # nats


@pytest.mark.slow
def test_the_prediction_agrees_with_a_simulation_of_the_same_body():
    """Contacts sample by sample; the way of the body to a few millimetres."""
    rng, off, wrong, felt = np.random.default_rng(5), [], 0, 0
    for _ in range(3):
        yaw = rng.uniform(-np.pi, np.pi)
        turn = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        world = World(vertices=CUBE, quaternion=turn, finger_radius=[0.01])
        data = world.execute(touch("left", yaw).trajectory(world.pose[:3]))
        expected = ExpectedInformation(estimate_of(world, data), SPACE)
        action, before = SPACE.random(rng), len(world.truth.object_position)
        prospect = expected.prospect(action)
        world.execute(action.trajectory(expected.target))
        way = world.truth.object_position[-1] - world.truth.object_position[before - 1]
        off.append(np.linalg.norm(prospect.motion[-1, :2] - way[:2]))
        contact = world.truth.contact[before + 1 :]
        wrong += ((prospect.contact > 0.5) != contact).sum()
        felt += contact.sum()
    assert np.median(off) < 3e-3
    assert wrong < 0.15 * felt


def test_choosing_for_a_hull_asks_for_no_more_than_its_budget(cube):
    """Cost is evaluations times a prediction: 4 ms of CPU each, 0.75 s at 180."""
    choice = choose_action(cube, SPACE, budget=30)
    assert choice.evaluations == 30
    assert choice.gain == choice.history.max() > np.median(choice.history)
