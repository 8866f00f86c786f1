"""What no touch determines is open: sizes, a place and a yaw of whole estimates."""

from types import SimpleNamespace

import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import (
    CYLINDER,
    Ground,
    Options,
    World,
    explore,
    polytope,
    solve_estimate,
)
from tactilenlp.information.error_budget_terms import REACHED
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.refinement.profile_deviation import VAGUE_SHARE
from tactilenlp.refinement.profile_likelihood import KNOWN_POSITION, touched_ends

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
