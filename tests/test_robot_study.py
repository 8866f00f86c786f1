"""The study on the simulated robot: its conditions, its judgement, its figure."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import benchmark
from scipy.spatial.transform import Rotation

from hardware.errors import LimitError

pytest.importorskip("cv2", reason="needs tactilenlp[optical]")
study = benchmark("explore_on_robot")


def test_tips_at_rest_are_as_far_off_as_the_papers(study):
    rig = study.simulated_rig("densetact", "far off")
    degrees = []
    for seed in range(20):
        error = study.zero_errors(rig, np.random.default_rng(seed))
        for finger, one in zip(rig.fingers, error, strict=True):
            jacobian = finger.geometry.jacobian(study.INITIAL)
            assert 3e-3 < np.linalg.norm(jacobian @ one) < 5e-3
        degrees += np.degrees(error).ravel().tolist()
    assert 0.5 < np.std(degrees) < 1.2  # about one degree


def test_trials_are_the_same_under_every_policy(study):
    one, other = (study.robot_of(3, policy) for policy in ("eig", "random"))
    assert np.array_equal(one.pose, other.pose)
    assert np.array_equal(one.fingers[0].joints.zero, other.fingers[0].joints.zero)
    assert np.abs(one.pose[:2]).max() <= study.NEAR


@pytest.mark.parametrize("quarters", range(-2, 3))
def test_an_error_does_not_depend_on_how_the_sides_are_named(study, quarters):
    pose = np.r_[0.01, -0.01, 0.0265, np.cos(0.2), 0, 0, np.sin(0.2)]
    turn = Rotation.from_quat(np.roll(pose[3:], -1))
    found = turn * Rotation.from_rotvec([0, 0, quarters * np.pi / 2 + 0.01])
    sides = np.array(study.BOX)[[1, 0, 2] if quarters % 2 else [0, 1, 2]]
    estimate = SimpleNamespace(
        rotation=found.as_matrix,
        side_lengths=sides + np.array([0.001, 0.0, 0.0]),
        position=(pose[:3] + np.array([0.002, 0.0, 0.0]))[None],
    )
    off = study.error_of(estimate, pose, turn)
    assert off == pytest.approx([0.001, 0, 0, 0.002, 0, 0.01], abs=1e-12)


@pytest.mark.slow
def test_a_trial_goes_through_all_wires_and_is_judged_again(study, tmp_path):
    told = study.run(3, "random", 0, 60, tmp_path)
    assert [row["step"] for row in told] == [0]
    assert told[0]["moved_mm"] < 20
    (row,) = study.judge(3, "random", "ignored", [told], tmp_path)
    assert row["offset"] == "ignored"
    assert row["pose"] == told[0]["pose"]
    (again,) = study.judge(3, "random", told[0]["offset"], [told], tmp_path)
    assert again["nees"] == told[0]["nees"]  # the same touches, told the same
    assert row["nees"] != told[0]["nees"]


@pytest.mark.slow
def test_a_robot_that_stops_itself_ends_its_trial_only(study, tmp_path, monkeypatch):
    """The limit of the joints' speed, here one that every motion exceeds."""

    def stops(*arguments, **given):
        raise LimitError("a joint runs away", where="finger 1")
        yield

    monkeypatch.setattr(study, "explore", stops)
    (row,) = study.run(3, "random", 0, 60, tmp_path)
    assert "a joint runs away" in row["stopped"]
    assert "a joint runs away" in study.said((3, "random"), [row])


def test_a_trial_that_the_robot_ended_is_left_out_with_its_pair(study):
    cases = [(trial, policy) for trial in (3, 4) for policy in ("eig", "random")]
    told = [[{"trial": trial, "policy": policy}] for trial, policy in cases]
    told[1] = [told[1][0] | {"stopped": "a joint runs away"}]
    assert study.completed(cases, told) == (cases[2:], told[2:], [3])


def rows(study):
    rng = np.random.default_rng(0)
    return [
        {
            "trial": n, "policy": policy, "step": k, "offset": offset,
            "p2s_mm": (2.0 if policy == "eig" else 4.0) * rng.uniform(0.9, 1.1),
            "centred_mm": rng.uniform(0.9, 1.1),
            "bch_mm": (6.0 if policy == "eig" else 9.0) * rng.uniform(0.9, 1.1),
            "nees": 1.0 if offset == "joints" else 100.0,
        }
        for n in range(6)
        for policy in ("eig", "random")
        for offset in study.OFFSETS
        for k in range(3)
    ]  # fmt: skip


def test_the_table_tells_medians_and_the_papers_test(study):
    words = study.table(rows(study), ["eig", "random"], range(3))
    last = words.splitlines()[3].split()
    assert last[:3] == ["eig", "joints", "2"]
    assert float(last[3]) == pytest.approx(2.0, abs=0.2)
    paired = next(line for line in words.splitlines() if line.startswith("  1 + 2:"))
    assert "better in 6 of 6" in paired
    assert float(paired.split("independent, ")[1].split(" paired")[0]) < 0.01


def test_the_figure_is_drawn(study, tmp_path):
    study.draw(tmp_path / "real.png", rows(study), ["eig", "random"], range(3))
    assert (tmp_path / "real.png").stat().st_size > 10_000
