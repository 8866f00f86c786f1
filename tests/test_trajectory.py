"""Deviations of the pose at every sample: by differences, by hand, by the truth."""

from types import SimpleNamespace

import numpy as np
import pytest

from formulations.rigid_body import FREE, PLANAR
from formulations.shape import CUBOID
from tactilenlp.errors import OptionError
from tactilenlp.information import trajectory
from tactilenlp.information.error_budget_terms import MOVED_ON
from tactilenlp.information.linearisation import Linearisation
from tactilenlp.information.tangent_space import pose_jacobians
from tactilenlp.information.trajectory import moved_between, trajectory_variance
from tactilenlp.nlp.kkt import kkt_system_of
from tactilenlp.problem.window import Steps

THETA = np.array([0.05, 0.04, 0.03])
STEP = 1e-6


@pytest.mark.parametrize("motion", [PLANAR, FREE])
def test_jacobians_of_poses_are_those_of_differences(motion):
    x = np.random.default_rng(3).normal(0, 0.2, (motion.unknowns, 3))
    *_, R, J_p, J_R = pose_jacobians(CUBOID, motion, THETA, x)
    for i in range(len(THETA) + motion.unknowns):
        ends = []
        for side in (1, -1):
            at = np.vstack([np.repeat(THETA[:, None], 3, axis=1), x])
            at[i] += side * STEP
            one = [pose_jacobians(CUBOID, motion, c[:3], c[3:, None]) for c in at.T]
            ends.append([np.concatenate(parts) for parts in zip(*one, strict=True)])
        (p, R_1, *_), (p_1, R_2, *_) = ends
        assert np.allclose(J_p[:, :, i], (p - p_1) / (2 * STEP), atol=1e-7)
        turn = (R_1 - R_2) / (2 * STEP) @ R.swapaxes(1, 2)
        by = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
        assert np.allclose(J_R[:, :, i], by, atol=1e-7)


def test_the_last_sample_has_the_deviation_of_the_final_pose(estimate):
    final = estimate.information.sigma("position")
    assert estimate.sigma_position.shape == estimate.position.shape
    assert estimate.sigma_position[-1] == pytest.approx(final, rel=0.05)
    yaw = estimate.information.sigma("rotation")[2]
    assert estimate.sigma_yaw[-1] == pytest.approx(yaw, rel=0.05)
    assert estimate.information.sigma("position", sample=-1) == pytest.approx(
        estimate.sigma_position[-1], rel=0
    )


def test_the_first_poses_are_as_far_off_as_their_deviation_says(estimate, recorded):
    truth = recorded[2]["object_position"]
    off = np.abs(estimate.position - truth[: len(estimate.position)])[:, :2]
    assert off[0].max() > 1e-3  # an early push from above leaves no trace in touches
    assert (off < 4 * estimate.sigma_position[:, :2]).all()
    assert np.mean(off < estimate.sigma_position[:, :2]) > 0.68


def test_what_a_body_may_have_moved_unseen_is_at_those_poses_alone(
    programme, monkeypatch
):
    """At every pose, also one between those that are computed for any recording."""
    monkeypatch.setattr(trajectory, "POSES", 6)
    again, variances = programme, []
    pose, k = again.problem.variables["x"], again.window.poses // 2
    for turn in (0.0, 0.05):
        at = Linearisation(
            kkt_system_of(again.problem, again.solution), again.job, again.window
        )  # fmt: skip
        motions = at.motions.copy()
        motions[:, 1] = 0.0
        motions[pose.span.start + k * pose.rows + 2, 1] = turn
        vars(at)["motions"] = motions
        variances.append(trajectory_variance(at, (np.zeros(3), np.zeros((3, 3)))))
    there = again.window.pose == k
    more = variances[1][:, 5] - variances[0][:, 5]
    assert more[there] == pytest.approx(MOVED_ON * 0.05**2, rel=0.05)
    assert np.abs(more[~there]).max() < 0.1 * MOVED_ON * 0.05**2


def test_paths_of_other_optima_and_carried_errors_add_up(programme):
    again = programme
    at = Linearisation(
        kkt_system_of(again.problem, again.solution), again.job, again.window
    )  # fmt: skip
    none = np.zeros(3), np.zeros((3, 3))
    values = again.solution.values
    plain = trajectory_variance(at, none)
    far = values | {"x": values["x"] + np.array([[3e-3], [0], [0]])}
    other = type("Other", (), {"values": far})
    k = len(again.tangent.names)
    maps = np.vstack([np.eye(3, k, 3), np.zeros((3, k))])

    def with_other(solution):
        optimum = SimpleNamespace(solution=solution, window=again.window)
        optima, of_end = [(0.25, optimum)], (np.zeros((k, k)), maps)
        return trajectory_variance(at, none, of_end, optima)

    here = type("Other", (), {"values": values})  # what is left of the best one
    same = with_other(here)
    assert (same <= plain).all()
    more = with_other(other) - same
    assert more[:, 0] == pytest.approx(0.25 * 3e-3**2)
    assert np.abs(more[:, 1:]).max() == pytest.approx(0.0, abs=1e-15)
    turned = values | {"x": values["x"] + np.array([[0], [0], [0.1 + np.pi / 2]])}
    other = type("Other", (), {"values": turned})  # the same box with other names
    more = with_other(other) - same
    assert more[:, 5] == pytest.approx(0.25 * 0.1**2)
    assert np.abs(more[:, :5]).max() == pytest.approx(0.0, abs=1e-15)
    along = np.zeros((k, k))
    along[3, 3] = 1e-6  # [m^2] of the final position, along the world's x
    more = trajectory_variance(at, none, (along, maps)) - plain
    yaw = values["x"][2, again.window.pose] - values["x"][2, -1]
    assert more[[0, -1], 0] == pytest.approx(1e-6 * np.cos(yaw[[0, -1]]) ** 2)
    assert more[:, :2].sum(axis=1) == pytest.approx(1e-6, rel=0.05)


def test_what_widens_the_final_pose_widens_its_past(estimate):
    wide = estimate.information.widened(2.0)
    assert wide.path == pytest.approx(2 * estimate.information.path, nan_ok=True)


def test_only_poses_have_deviations_of_a_trajectory(estimate):
    with pytest.raises(OptionError, match="trajectory"):
        estimate.information.sigma("side_lengths", sample=0)
    with pytest.raises(OptionError, match="this version"):
        estimate.information.of_hessian().along_path("position")


@pytest.mark.parametrize(("lean", "falls"), [(0.0, False), (0.2, True), (1.2, False)])
def test_a_tilted_body_that_is_let_go_falls_flat_and_was_not_carried(lean, falls):
    x = np.zeros((6, 3))  # two samples of an action, the first of the next
    x[2] = 0.04
    x[3, :2], x[1, 2] = lean, 0.012
    end, before, first = (np.array([k]) for k in (0, 1, 2))
    gap = Steps(first, first, before, end, *[np.full(1, 1 / 30)] * 2, np.zeros((1, 3)))
    on = moved_between(x, SimpleNamespace(gap=gap, braking=3.0))[1].item()
    assert on == pytest.approx(0.08 * np.sin(lean / 2) * falls)
