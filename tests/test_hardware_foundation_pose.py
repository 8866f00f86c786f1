"""Poses that FoundationPose wrote: order, frames, what is missing."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hardware.errors import ClockError, RecordingError
from hardware.foundation_pose import load_poses


def motions(n):
    """n poses of an object that turns more than once and walks."""
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 9, n), [0.2, -0.5, 0.84]))
    X = np.tile(np.eye(4), (n, 1, 1))
    X[:, :3, :3] = turns.as_matrix()
    X[:, :3, 3] = np.linspace([0.0, 0.0, 0.5], [0.02, 0.01, 0.52], n)
    return X


def write(folder, X, names):
    folder.mkdir(parents=True, exist_ok=True)
    for name, matrix in zip(names, X, strict=True):
        np.savetxt(folder / f"{name}.txt", matrix.reshape(4, 4))


def same(poses, X):
    R = Rotation.from_quat(np.roll(poses.quaternion, -1, axis=1)).as_matrix()
    right = np.allclose(R, X[:, :3, :3], atol=1e-12)
    return right and np.allclose(poses.position, X[:, :3, 3], atol=1e-15)


@pytest.mark.parametrize(
    "name", ["{}", "{:06d}", "rgb_{}", "1581120424{:09d}"], ids=str
)
def test_both_styles_of_names_come_in_the_order_of_time(tmp_path, name):
    X = motions(120)
    write(tmp_path / "ob_in_cam", X, [name.format(k) for k in range(120)])
    for folder in (tmp_path, tmp_path / "ob_in_cam"):
        if name == "1581120424{:09d}":  # stems that are stamps count by rank
            poses = load_poses(folder, times=np.arange(120) / 30)
        else:
            poses = load_poses(folder)
        assert poses.valid.all()
        assert same(poses, X)
        assert poses.time == pytest.approx(np.arange(120) / 30)


def test_quaternions_never_jump_in_sign(tmp_path):
    write(tmp_path, motions(200), range(200))
    q = load_poses(tmp_path).quaternion
    assert ((q[1:] * q[:-1]).sum(axis=1) > 0.9).all()
    assert np.linalg.norm(q, axis=1) == pytest.approx(1)


def test_poses_are_carried_into_the_world(tmp_path):
    X, X_wc = motions(5), np.eye(4)
    X_wc[:3, :3] = Rotation.from_euler("xyz", [2.0, 0.3, -1.0]).as_matrix()
    X_wc[:3, 3] = 0.4, -0.3, 0.6
    write(tmp_path, X, range(5))
    assert same(load_poses(tmp_path, world_from_camera=X_wc), X_wc @ X)


@pytest.mark.parametrize(
    "wrong", [np.eye(3), 2 * np.eye(4), np.diag([1, 1, -1, 1]), "here"]
)
def test_a_camera_pose_must_be_a_rigid_motion(tmp_path, wrong):
    write(tmp_path, motions(3), range(3))
    with pytest.raises(RecordingError, match="world_from_camera"):
        load_poses(tmp_path, world_from_camera=wrong)


def test_missing_pictures_and_bad_rotations_are_not_valid(tmp_path):
    X = motions(10)
    bad = {2: 1.01 * X[2], 3: np.full((4, 4), np.nan), 4: np.diag([1, 1, -1, 1.0])}
    rest = [k for k in range(10) if k not in (6, 7, *bad)]
    write(tmp_path, X[rest], rest)
    write(tmp_path, list(bad.values()), list(bad))
    (tmp_path / "7.txt").write_bytes(b"\x00\xff no pose")
    poses = load_poses(tmp_path)
    assert np.flatnonzero(~poses.valid).tolist() == [2, 3, 4, 6, 7]
    assert np.isfinite(poses.position).all()
    assert np.allclose(poses.position[rest], X[rest, :3, 3])


def test_poses_between_close_pictures_are_interpolated(tmp_path):
    X = motions(100)
    write(tmp_path, X, range(100))
    poses = load_poses(tmp_path)
    middle = poses.at((poses.time[1:] + poses.time[:-1]) / 2)
    assert middle.valid.all()
    half = (X[1:, :3, 3] + X[:-1, :3, 3]) / 2
    assert np.allclose(middle.position, half, atol=1e-12)
    there = Rotation.from_quat(np.roll(middle.quaternion, -1, axis=1))
    before = Rotation.from_matrix(X[:-1, :3, :3])
    angle = (before.inv() * there).magnitude()
    assert angle == pytest.approx(9 / 99 / 2, rel=0.01)


def test_gaps_and_ends_are_not_bridged(tmp_path):
    keep = [0, 1, 2, 4, 5, 8, 9, 13]
    write(tmp_path, motions(14)[keep], keep)
    poses = load_poses(tmp_path)
    valid = poses.at(np.array([-0.1, 0.5, 3.0, 4.5, 6.5, 11.0, 20.0]) / 30).valid
    assert valid.tolist() == [False, True, True, True, False, False, False]
    (tmp_path / "1").mkdir()
    write(tmp_path / "1", motions(1), [0])
    assert not load_poses(tmp_path / "1").at([0.0]).valid.any()


@pytest.mark.parametrize("rate", [10.0, 30.0, 200.0])
def test_what_is_a_gap_follows_from_the_rate_of_the_pictures(tmp_path, rate):
    keep = [0, 1, 2, 4, 5, 8, 9]
    write(tmp_path, motions(10)[keep], keep)
    poses = load_poses(tmp_path, rate=rate)
    valid = poses.at(np.array([0.5, 3.0, 4.5, 6.5]) / rate).valid
    assert valid.tolist() == [True, True, True, False]


def test_times_must_fit_the_pictures(tmp_path):
    write(tmp_path, motions(5), range(5))
    times = 1.7e9 + np.arange(6) / 30
    assert load_poses(tmp_path, times=times).valid.tolist() == [True] * 5 + [False]
    for wrong in (times[:4], times[::-1], np.r_[times[:5], np.nan], "now", 0.1):
        with pytest.raises(ClockError):
            load_poses(tmp_path, times=wrong)
    for wrong in (0.0, np.nan, "30"):
        with pytest.raises(ClockError, match="rate: out of range"):
            load_poses(tmp_path, rate=wrong)


def test_a_folder_without_poses_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="ob_in_cam"):
        load_poses(tmp_path)


def test_a_pose_at_the_end_of_a_gap_is_valid_at_its_own_time(tmp_path):
    X, kept = motions(13), [0, 1, 2, 3, 10, 11, 12]
    write(tmp_path, X[kept], kept)
    poses = load_poses(tmp_path, times=np.arange(13) / 30)
    assert np.flatnonzero(poses.at(poses.time).valid).tolist() == kept
    assert not poses.at(poses.time[[3, 10]] + [1e-3, -1e-3]).valid.any()
