"""What no touch determines is open: sizes, a place and a yaw of whole estimates."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import (
    CYLINDER,
    Ground,
    Options,
    Problem,
    Scene,
    World,
    explore,
    polytope,
    solve_estimate,
)
from tactilenlp.information.error_budget_terms import REACHED
from tactilenlp.information.laplace_approximation import sizes_at_bounds
from tactilenlp.information.tangent_space import prior_deviations
from tactilenlp.nlp.kkt import kkt_system_of
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.refinement.profile_deviation import VAGUE_SHARE
from tactilenlp.refinement.profile_likelihood import (
    KNOWN_POSITION,
    touched_ends,
)
from tactilenlp.solvers.solve import solve

PRIOR = CUBOID.size_prior[1]
AT = Hypothesis(np.full(3, 0.04), np.zeros((3, 2)), 0.0, ())


def test_sizes_of_classes_without_known_faces_are_all_open():
    solved = SimpleNamespace(at=AT)
    assert not touched_ends(CYLINDER, solved).any()
    assert len(touched_ends(CYLINDER, solved)) == CYLINDER.theta
    assert touched_ends(polytope(20), solved) is None


def test_the_yaw_of_a_box_that_was_only_pressed_on_its_top_is_open(recorded):
    """Friction alone would tell it to a degree or two."""
    data, scene, _ = recorded
    top = data.select([0])
    assert top.normal[top.contact][:, 2].min() > 0.99
    estimate = solve_estimate(top, scene, options=Options(hypotheses=2, starts=2))
    assert estimate.information.sigma("rotation")[2] > np.radians(5)


def test_an_untouched_size_is_no_surer_than_its_profile(touched, recorded):
    truth = recorded[2]["side_lengths"]
    untouched = [i for i, faces in enumerate(touched.faces) if faces.min() == 0]
    assert untouched
    sigma = touched.information.sigma("side_lengths")
    never = touched.faces.max(axis=1) == 0
    assert never.any()
    assert (sigma[never] >= VAGUE_SHARE * PRIOR).all()
    order = np.argsort(touched.side_lengths)  # the names of the axes are arbitrary
    error = touched.side_lengths[order] - np.sort(truth)
    assert (np.abs(error) < 3 * sigma[order]).all()  # each by its own sigma


def test_a_place_that_the_hessian_claims_little_of_is_no_surer_than_that(touched):
    sharp = touched.information.of_hessian().sigma("position")[:2]
    along = np.argmax(sharp)
    assert sharp[along] > KNOWN_POSITION
    within = sharp[along] / np.hypot(1, sharp[along] / REACHED)  # of the pose's prior
    assert touched.information.sigma("position")[along] > 0.99 * within


@pytest.mark.slow
def test_a_touch_of_the_top_alone_leaves_finite_sigma():
    """The Hessian is indefinite: the place of what only its top tells is open."""
    turn = 1.0909 / 2
    world = World(
        (0.03693529, 0.05700028, 0.04258107), position=(-0.01250407, -0.00079563),
        quaternion=[np.cos(turn), 0, 0, np.sin(turn)],
    )  # fmt: skip
    steps = [*explore(world, actions=1, seed=1005, centre=world.pose[:3])]
    first = steps[0].estimate
    assert np.isfinite(first.information.sigma("side_lengths")).all()
    assert np.isfinite(first.information.sigma("position")).all()


def test_only_a_ground_touches_the_lowest_face_of_a_box():
    for ground in (None, Ground()):
        job = SimpleNamespace(scene=SimpleNamespace(ground=ground))
        faces = np.array([[0, 9], [0, 0], [0, 9]])
        solved = SimpleNamespace(at=AT, job=job, touched=faces)
        ends = touched_ends(CUBOID, solved)
        assert (ends.min(axis=1) > 0).tolist() == [False, False, ground is not None]


def test_a_size_that_no_touch_tells_varies_as_the_prior_at_the_others():
    """Student's t of five degrees of freedom: a variance twice that at its mode."""
    mean, deviation = CUBOID.size_prior
    alone = prior_deviations(CUBOID, np.full(3, mean))
    np.testing.assert_allclose(alone, np.sqrt(2) * deviation)
    grid = np.linspace(-3.0, 3.0, 200_001)  # [m]
    sides = np.stack([np.full_like(grid, mean + 2 * deviation), 0 * grid + mean, grid])
    square = np.sum(((sides - mean) / deviation) ** 2, axis=0)
    density = (1 + square / 6) ** -3.0
    variance = (density * (grid - mean) ** 2).sum() / density.sum()
    found = prior_deviations(CUBOID, sides[:, 0] * [1, 1, 0] + [0, 0, 0.3])[2]
    assert found == pytest.approx(np.sqrt(variance), rel=1e-3)


def test_a_size_at_its_bound_is_not_known_exactly():
    nlp = Problem()
    theta = nlp.variable(
        "theta", 3, guess=0.05, lower=0.004, upper=0.4, unit="m", scale=1e-3
    )
    nlp.minimize(
        "cost", lambda a: ca.sumsqr((a[:2] - 0.05) / 0.01) / 2 - 40 * a[2], theta,
        role="likelihood",
    )  # fmt: skip
    solution = solve(nlp)
    at = SimpleNamespace(
        problem=nlp, solution=solution, kkt=kkt_system_of(nlp, solution)
    )
    expected = [0, 0, np.sqrt(2) / 40]
    np.testing.assert_allclose(sizes_at_bounds(at), expected, rtol=1e-3)


@pytest.mark.slow
def test_a_body_that_was_dragged_from_above_may_have_slipped():
    """Only friction tells how far it came: along and across the drag."""
    world = World([0.06, 0.04, 0.05], friction_finger=1.0, max_force=6.0)
    away = np.array([1.0, 1.0, 0.5])

    def act(*places):
        path = np.stack([places, np.broadcast_to(away, (len(places), 3))], axis=1)
        time = np.linspace(0, 0.6 * (len(places) - 1), len(places))
        world.execute(SimpleNamespace(time=time, finger_position=path))

    for turn in np.arange(4) * np.pi / 2:
        side = np.array([np.cos(turn), np.sin(turn), 0.0])
        at = world.pose[:3] + 0.01 * side[[1, 0, 2]]
        act(at + 0.08 * side, at + 0.03 * side, at + 0.08 * side)
    x, y, z = world.pose[:3]
    press = np.array([x, y, z + 0.032])  # 3 mm deep
    up, along = np.array([0, 0, 0.03]), np.array([0.06, 0, 0])
    act(press + up, press, press + along, press + along + up)
    scene = Scene(friction_finger=1.0)
    estimate = solve_estimate(world.measurements, scene)
    off = estimate.position[-1] - world.truth.object_position[-1]
    assert (np.abs(off) < 5 * estimate.information.sigma("position")).all()
