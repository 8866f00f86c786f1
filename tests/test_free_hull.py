"""Hulls that move freely: the page in free motion, and what reads poses of a hull."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from programmes import slid_octahedron
from scipy.spatial.transform import Rotation

from formulations import polytope_violation_implicit as page
from formulations.polytope import polytope
from formulations.pushed_hull import LIFTED
from formulations.rigid_body import rotation
from tactilenlp import Options
from tactilenlp.geometry.tipping import planar_to_free
from tactilenlp.geometry.transforms import (
    directions_in_body,
    left_jacobians,
    matrices,
    points_in_body,
    rotvecs_back,
)
from tactilenlp.interface.request import make_job
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.reductions import REDUCTION_NAMES

SHAPE = polytope(8)
# Edges are rounded over 0.03 mm, a thirtieth of the scale of which differences take
# steps: their own error; a wrong derivative is off by its size.
CURVED = 1e-3
SAME = 1e-9  # of costs that are one and the same expression, up to rounding

pytestmark = pytest.mark.usefixtures("not_compiled")


@pytest.fixture(scope="module")
def slid():
    return slid_octahedron()


def posed(data, scene, vertices, x, without=("planar",)):
    """Return the problem of the joint page at vertices and poses, and its window."""
    job = make_job(data, scene, SHAPE, Options(without=without), 0.0, page)
    window = job.window((vertices.ravel(), x))
    problem = Problem()
    page.build(problem, window, scene, window.shape)
    return problem, window


def values_of(problem, window, vertices, x, rng):
    """Return vertices, poses and random impulses as unknowns of a problem."""
    values = {"theta": vertices.T, "x": x[:, window.last]}
    for name in ("finger", "ground"):
        v = problem.variables[name]
        force = v.scale[:, None] * rng.normal(size=(v.rows, v.columns))
        values[name] = np.vstack([np.abs(force[:1]), force[1:]])
    return values


def costs(problem, values):
    x, data = problem.pack(values), problem.data()
    return {name: problem.value(name, x, data).sum() for name in problem.costs}


@pytest.mark.slow
def test_a_hull_that_slides_costs_the_same_in_free_motion(slid):
    data, scene, vertices, x = slid
    free = planar_to_free(vertices.ravel(), x, SHAPE)
    flat, window = posed(data, scene, vertices, x, without=("still",))
    known = values_of(flat, window, vertices, x, np.random.default_rng(1))
    loose, opened = posed(data, scene, vertices, free, without=("planar", "still"))
    assert opened.poses == window.poses
    lying = known | {"x": free[:, opened.last]}
    one, other = costs(flat, known), costs(loose, lying)
    assert {*one} - {*other} == {"legs on the ground"}
    assert {*other} - {*one} == {"ground complementarity", "rest"}
    for name in {*one} & {*other}:
        assert other[name] == pytest.approx(one[name], rel=SAME, abs=SAME), name


@pytest.mark.slow
@pytest.mark.parametrize("grounded", [True, False])
def test_the_page_in_free_motion_has_the_derivatives_of_finite_differences(
    slid, grounded
):
    data, scene, vertices, x = slid
    free = planar_to_free(vertices.ravel(), x, SHAPE)
    given = scene if grounded else replace(scene, ground=None, gravity=0.0)
    problem, window = posed(data, given, vertices, free)
    rng = np.random.default_rng(2)
    values = values_of(problem, window, vertices, free, rng)
    pose = problem.variables["x"]  # tilted, and off the ground
    values["x"] += pose.scale[:, None] * rng.normal(size=(pose.rows, pose.columns))
    report = problem.check(values)
    for name, (first, second) in report.derivatives.items():
        assert first < CURVED, name
        assert second < CURVED, name
    assert report.assembled < CURVED
    idle = set() if grounded else {"ground friction", "gap scale"}
    assert set(report.unused) <= idle


@pytest.mark.slow
def test_moving_a_floating_hull_and_its_fingers_costs_nothing(slid):
    data, scene, vertices, x = slid
    scene = replace(scene, ground=None, gravity=0.0)
    spin, t = Rotation.from_rotvec([0.4, -0.3, 0.8]), np.array([0.3, -0.2, 0.1])
    free = planar_to_free(vertices.ravel(), x, SHAPE)
    R = spin * Rotation.from_rotvec(free[3:].T) * spin.inv()
    turned = np.vstack([spin.as_matrix() @ free[:3] + t[:, None], R.as_rotvec().T])
    problem, window = posed(data, scene, vertices, free)
    moved = data.transformed(spin.as_matrix(), t)
    problem_2, window_2 = posed(moved, scene, spin.apply(vertices), turned)
    known = values_of(problem, window, vertices, free, np.random.default_rng(3))
    here = known | {"theta": spin.apply(vertices).T, "x": turned[:, window_2.last]}
    for values in (known, here):  # tangents are the world's: normal impulses alone
        values["finger"] = values["finger"] * [[1.0], [0.0], [0.0]]
    *centre, radius = problem.variables["ball"].guess[:, 0]
    here["ball"] = np.r_[spin.apply(centre), radius][:, None]
    one, other = costs(problem, known), costs(problem_2, here)
    for name, cost in one.items():
        # Steps towards the nearest point are frozen at round numbers: 1e-5 of a cost.
        assert other[name] == pytest.approx(cost, rel=1e-4, abs=1e-7), name


@pytest.mark.slow
def test_what_falls_needs_no_impulse_and_what_hangs_does(slid):
    data, scene, vertices, x = slid
    scene = replace(scene, ground=None)
    free = planar_to_free(vertices.ravel(), 0 * x, SHAPE)
    problem, window = posed(data, scene, vertices, free, without=REDUCTION_NAMES)
    step, values = window.step, {"theta": vertices.T, "x": free[:, window.last]}
    zero = np.zeros((3, problem.variables["finger"].columns))
    hung = costs(problem, values | {"finger": zero})
    speed = np.zeros(window.poses)
    fallen = values["x"].copy()
    for k, before, dt in zip(step.pose, step.before, step.dt, strict=True):
        speed[k] = speed[before] - scene.gravity * dt  # an action starts at rest
        fallen[2, k] = fallen[2, before] + speed[k] * dt
    fell = costs(problem, values | {"finger": zero, "x": fallen})
    balances = [name for name in fell if name.startswith("balance")]
    per_step = 1 / (2 * 0.03**2)  # all of the weight is missing
    assert sum(hung[n] for n in balances) == pytest.approx(len(step) * per_step)
    assert sum(fell[n] for n in balances) < 1e-6 * per_step


@pytest.mark.slow
def test_a_hull_that_tilts_stands_on_what_is_low_and_bears_nothing_in_the_air(slid):
    data, scene, vertices, x = slid
    free = planar_to_free(vertices.ravel(), x, SHAPE)
    _, flat = posed(data, scene, vertices, free, without=("planar", "still"))
    assert set(flat.corner_vertex) == set(flat.legs)
    assert flat.weight_share.reshape(len(flat.step), -1).sum(axis=1) == pytest.approx(
        1.0
    )
    over = Rotation.from_rotvec([0.6, 0, 0])
    R = over * Rotation.from_rotvec(free[3:].T)
    tilted = np.vstack([free[:3], R.as_rotvec().T])
    tilted[2] -= (matrices(tilted)[:, 2] @ vertices.T).min(axis=1)
    _, window = posed(data, scene, vertices, tilted, without=("planar", "still"))
    at = window.step.sample[window.corner.step]
    z = (matrices(tilted)[:, 2] @ vertices.T + tilted[2][:, None])[at]
    low = z[np.arange(len(at)), window.corner_vertex]
    assert low.reshape(len(window.step), -1).min(axis=1) == pytest.approx(0, abs=1e-9)
    assert (window.weight_share[low > LIFTED] == 0).all()
    assert len(window.grounded) == 0
    assert window.floor == -tilted[2, -1]


@pytest.mark.slow
def test_without_a_ground_a_window_has_none(slid):
    data, scene, vertices, x = slid
    free = planar_to_free(vertices.ravel(), x, SHAPE)
    scene = replace(scene, ground=None, gravity=0.0)
    problem, window = posed(data, scene, vertices, free)
    assert len(window.corner) == len(window.lift) == len(window.rest) == 0
    assert len(window.grounded) == 0
    assert window.floor == -np.inf
    assert not any("ground" in name for name in problem.constraints)
    held = problem.variables["x"]
    assert (held.lower[:, -1] == held.upper[:, -1]).all()
    assert np.isinf(held.lower[:, :-1]).all()


def test_points_and_directions_are_the_same_in_planar_and_in_lifted_poses():
    rng = np.random.default_rng(4)
    x, samples = rng.normal(size=(3, 5)), rng.integers(0, 5, 20)
    free, p = planar_to_free(np.zeros(24), x, SHAPE), rng.normal(size=(20, 3))
    np.testing.assert_allclose(
        points_in_body(free, samples, p), points_in_body(x, samples, p)
    )
    np.testing.assert_allclose(
        directions_in_body(free, samples, p), directions_in_body(x, samples, p)
    )


def test_a_rotation_vector_turns_a_body_as_its_slope_says():
    w = np.array([[0.3, -1.2, 0.7], [0, 0, 0], [1e-5, 0, 2e-5], [0, 0, 1.5]])
    step = 1e-6
    for vector, slope in zip(w, left_jacobians(np.hstack([0 * w, w]).T), strict=True):
        R = np.asarray(rotation(ca.DM(vector)))
        for i in range(3):
            ahead = np.asarray(rotation(ca.DM(vector + step * np.eye(3)[i])))
            turn = Rotation.from_matrix(ahead @ R.T).as_rotvec() / step
            np.testing.assert_allclose(turn, slope[:, i], atol=1e-5)


def test_rotations_end_upright_however_far_they_came():
    angle = np.linspace(-1.6 * np.pi, 0, 60)
    R = Rotation.from_rotvec(np.outer(angle, [0, 0.6, 0.8])).as_matrix()
    w = rotvecs_back(R)
    assert w[-1] == pytest.approx(np.zeros(3), abs=1e-12)
    np.testing.assert_allclose(np.linalg.norm(w, axis=1), -angle, atol=1e-9)


@pytest.mark.slow
def test_legs_of_a_rigid_body_move_as_its_poses_do(slid):
    data, scene, vertices, x = slid
    square = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * 0.015
    vertices = np.vstack([square, square + np.array([0, 0, 0.03])])
    free = planar_to_free(vertices.ravel(), x, SHAPE)
    problem, window = posed(data, scene, vertices, free)
    values = {"theta": vertices.T, "x": free[:, window.last]}
    slopes = problem.jacobian("ground gap", problem.pack(values), problem.data())
    slopes = slopes[:, problem.variables["x"].span]
    steps = len(window.step)
    rigid = np.tile([1.0, 1.0, 1.0, 1.0], steps)[:, None]
    bent = np.tile([1.0, -1.0, 1.0, -1.0], steps)[:, None]
    np.testing.assert_allclose(window.rigid_moves(rigid, slopes), rigid, atol=1e-9)
    np.testing.assert_allclose(window.rigid_moves(bent, slopes), 0, atol=1e-9)
    others = window.corner_vertex != window.legs[0]
    three = rigid * others[:, None]  # stands on three: all free
    np.testing.assert_allclose(window.rigid_moves(three, slopes), three, atol=1e-9)
