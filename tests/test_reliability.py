"""An action like one that told less than was expected is expected to tell as little."""

import numpy as np
import pytest

from tactilenlp import Workspace, World, explore
from tactilenlp.exploration.policies import Told, directions_of, reliability

SPACE = Workspace()


def test_directions_turn_with_the_body(estimate):
    action = SPACE.action([0.2, 0.4, -0.3, 0.1])
    d = directions_of(action, estimate)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0)
    world = d @ estimate.rotation().T
    start = action.positions(np.array([0.0, 0.0, 0.1]), 2)[0] - [0.0, 0.0, 0.1]
    away = start / np.linalg.norm(start, axis=1, keepdims=True)
    np.testing.assert_allclose(world, away, atol=0.05)  # but for the fingers' sectors


@pytest.mark.parametrize(
    ("angle", "share", "counts"),
    [(0.0, 0.1, 0.1), (0.0, 1.0, 1.0), (0.2, 0.0, 1 - np.exp(-0.5)), (1.5, 0.0, 1.0)],
)
def test_what_told_little_counts_little_nearby(angle, share, counts):
    before = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    turn = np.array([[np.cos(angle), np.sin(angle), 0]] * 2) * [[1.0], [-1.0]]
    found = reliability([Told(before, share)], turn)
    assert found == pytest.approx(counts, abs=1e-6)
    assert reliability([], turn) == 1.0


def test_the_least_share_of_several_counts():
    here = np.array([[0.0, 0, 1.0], [0.0, 1.0, 0]])
    told = [Told(here, 0.7), Told(here, 0.2), Told(here, 1.0)]
    assert reliability(told, here) == pytest.approx(0.2)


@pytest.mark.slow
def test_a_box_that_two_corners_jam_is_touched_elsewhere():
    """The push model predicts that it turns; it does not, time after time."""
    yaw, place = 2.7214, (0.0033, -0.0162)  # as drawn by the command line, seed 3
    world = World(
        (0.05, 0.035, 0.04), position=place,
        quaternion=[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)],
    )  # fmt: skip
    steps = [*explore(world, actions=3, seed=3, centre=world.pose[:3])]
    sigma = steps[-1].estimate.information.sigma("side_lengths")
    assert sigma.max() < 1e-3
    assert steps[-1].errors["surface"] < 0.2e-3
