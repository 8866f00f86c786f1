"""Steps of the filter of tracks: motion by hand, slopes, the Kalman update, columns."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from formulations.between_actions import GAP
from formulations.rigid_body import ARM
from formulations.shape import CUBOID
from tactilenlp.shapes import CYLINDER
from tactilenlp.tracking import filter_steps, mapped
from tactilenlp.tracking.filter_steps import OUTLIER, corrections, prediction
from tactilenlp.tracking.geometry import geometry_of
from tactilenlp.tracking.tracking import between_actions
from tactilenlp.tracking.tracks import new_tracks

RADIUS, FRICTION = 0.01, (0.3, 0.5)  # [m]; of the ground, of the fingers
BOX = np.array([0.06, 0.04, 0.05, 0.0, 0.0, 0.0])  # [m, rad] sides, pose
STEP = 1e-7  # [m, rad] of central differences


def upper(P):
    return P[np.triu_indices(len(P))]


def whole(values, k):
    P = np.zeros((k, k))
    P[np.triu_indices(k)] = values
    return P + np.triu(P, 1).T


def moved(shape, z, *ways, press=0.7, before=(0.0, 0.0, 0.0), P=None, noise=1.0):
    """Return z, P (k, k), motion (3,) and slopes (3, k) after one sample.

    ways: of each finger that touches, its centre before and after.
    """
    k = len(z)
    P = np.zeros((k, k)) if P is None else P
    ways = np.concatenate([[*p_0, *p_1, RADIUS] for p_0, p_1 in ways])
    press = np.full(len(ways) // 7, press)
    state = (np.atleast_2d(a).T for a in (z, upper(P), before, press))
    found = prediction(shape, len(press))(*state, ways, np.array([*FRICTION, noise]))
    after, P, motion, slopes = (a[:, 0] for a in found)
    return after, whole(P, k), motion, slopes.reshape(k, 3).T


def at_side(x, y=0.0, z=0.025):
    """A finger beside the face +x of BOX, its surface at x [m]."""
    return np.array([x + RADIUS, y, z])


def test_a_finger_through_the_middle_moves_a_box_as_far_as_it_would_overlap():
    z, _, motion, _ = moved(CUBOID, BOX, (at_side(0.031), at_side(0.0295)))
    assert motion == pytest.approx([-0.5e-3, 0.0, 0.0], abs=5e-6)  # rounding of edges
    assert z == pytest.approx(BOX + np.r_[0, 0, 0, motion])


def test_a_finger_that_goes_away_or_stays_in_the_air_moves_nothing():
    for way in ((0.0295, 0.031), (0.035, 0.033)):
        *_, motion, _ = moved(CUBOID, BOX, tuple(map(at_side, way)))
        assert np.abs(motion).max() < 1e-12


def test_a_push_beside_the_middle_turns_a_box():
    *_, motion, _ = moved(CUBOID, BOX, (at_side(0.0305, 0.015), at_side(0.0295, 0.015)))
    assert motion[0] < 0 < motion[2]
    mirrored = at_side(0.0305, -0.015), at_side(0.0295, -0.015)
    *_, other, _ = moved(CUBOID, BOX, mirrored)
    assert other == pytest.approx(motion * [1, -1, -1], abs=1e-12)


def test_a_finger_on_the_top_drags_a_box_as_far_as_its_friction_allows():
    on_top = np.array([0.0, 0.0, 0.05 + RADIUS]), np.array([1e-3, 0.0, 0.05 + RADIUS])
    light, hard = (moved(CUBOID, BOX, on_top, press=p)[2] for p in (0.05, 20.0))
    assert hard == pytest.approx([1e-3, 0.0, 0.0], abs=1e-6)  # 10 against 6.3 weights
    assert 0 < light[0] < 0.2e-3


def test_a_motion_does_not_depend_on_the_axes_of_the_world():
    R = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
    yaw, way = np.arctan2(0.6, 0.8), (at_side(0.0305, 0.01), at_side(0.0295, 0.012))
    before = np.array([1e-3, -2e-3, 0.03])
    *_, motion, _ = moved(CUBOID, BOX, way, before=before)
    turned = R @ before * [1, 1, 0] + before * [0, 0, 1]
    there = BOX + np.r_[0, 0, 0, 0, 0, yaw], tuple(R @ p for p in way)
    *_, other, _ = moved(CUBOID, *there, before=turned)
    assert other == pytest.approx([*(R @ [*motion[:2], 0])[:2], motion[2]], abs=1e-12)


def test_a_box_whose_sides_have_other_names_is_moved_alike():
    way = at_side(0.0305, 0.01), at_side(0.0295, 0.012)
    *_, motion, _ = moved(CUBOID, BOX, way)
    renamed = BOX[[1, 0, 2, 3, 4, 5]] + np.r_[0, 0, 0, 0, 0, np.pi / 2]
    *_, same, _ = moved(CUBOID, renamed, way)
    assert same == pytest.approx(motion, abs=1e-12)


@pytest.mark.parametrize("shape", [CUBOID, CYLINDER], ids=["cuboid", "cylinder"])
@pytest.mark.parametrize("fingers", [1, 2])
def test_slopes_of_the_motion_are_those_of_differences(shape, fingers):
    z = BOX if shape is CUBOID else np.array([0.03, 0.05, 0.0, 0.0, 0.0])
    k = len(z)
    z = z + np.r_[np.zeros(k - 3), 1e-3, -2e-3, 0.1]
    ways = (at_side(0.0330, 0.004), at_side(0.0285, 0.0052)), (
        -at_side(0.0320, 0.0080, -0.02), -at_side(0.0270, 0.0100, -0.02)
    )  # fmt: skip
    before = np.array([-2e-3, 1e-3, 0.05])
    given = {"before": before}
    *_, slopes = moved(shape, z, *ways[:fingers], **given)
    for i, one in enumerate(np.eye(k)):
        ends = [
            moved(shape, z + side * STEP * one, *ways[:fingers], **given)[2]
            for side in (1, -1)
        ]
        by_differences = (ends[0] - ends[1]) / (2 * STEP)
        assert slopes[:, i] == pytest.approx(by_differences, rel=1e-4, abs=1e-5), i


def test_a_covariance_moves_with_the_slopes_and_grows_by_the_process_noise():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(6, 6)) * 1e-3
    way = at_side(0.0305, 0.01), at_side(0.0295, 0.012)
    _, P, _, slopes = moved(CUBOID, BOX, way, P=A @ A.T)
    *_, noisier = (moved(CUBOID, BOX, way, P=A @ A.T, noise=f)[1] for f in (0.0, 2.0))
    F = np.eye(6)
    F[3:] += slopes
    added = P - F @ A @ A.T @ F.T
    assert np.abs(added - np.diag(np.diag(added))).max() < 1e-18
    assert (np.diag(added)[3:] > np.square([1e-4, 1e-4, 5e-3])).all()
    assert np.diag(added)[:3] == pytest.approx(np.zeros(3), abs=1e-18)
    both = noisier - F @ A @ A.T @ F.T
    assert np.diag(both)[3:] == pytest.approx(4 * np.diag(added)[3:], rel=1e-6)


@pytest.mark.parametrize("name", ["TOUCHED", "PUSH_ERROR", "ADDED_VARIANCE"])
def test_an_edited_process_noise_is_not_that_of_an_earlier_compilation(
    name, monkeypatch
):
    way = at_side(0.0305, 0.01), at_side(0.0295, 0.012)
    usual = moved(CUBOID, BOX, way)[1]
    monkeypatch.setattr(filter_steps, name, 3 * getattr(filter_steps, name))
    prediction.cache_clear()
    try:
        edited = moved(CUBOID, BOX, way)[1]
    finally:
        prediction.cache_clear()
    assert (np.diag(edited)[3:] > np.diag(usual)[3:]).all()


def test_an_edited_cost_of_outliers_is_not_that_of_an_earlier_compilation(monkeypatch):
    touch = at_side(0.035), np.array([RADIUS]), np.array([1.0, 0.0, 0.0])
    across, sigma = np.eye(3)[1:].ravel(), np.array([1e-4, 0.05])
    state = [a[:, None] for a in (BOX, np.zeros(6), upper(np.zeros((6, 6))))]

    def evidence():
        return corrections(CUBOID)[0](*state, *touch, across, sigma)[2].item()

    usual = evidence()  # 5 mm off
    monkeypatch.setattr(filter_steps, "OUTLIER", OUTLIER + 3.0)
    corrections.cache_clear()
    try:
        assert evidence() == pytest.approx(usual - 3.0)
    finally:
        corrections.cache_clear()


def test_a_touch_corrects_as_a_kalman_filter_does():
    """Three measurements, one after the other, are as good as all at once."""
    rng = np.random.default_rng(2)
    A = rng.normal(size=(6, 6)) * 1e-3
    P, z, p = A @ A.T, BOX + 1e-3, at_side(0.0302, 0.004)
    mean, felt = z + rng.normal(size=6) * 5e-4, np.array([0.995, 0.0, 0.0999])
    felt /= np.linalg.norm(felt)
    across, sigma = np.linalg.svd(felt[None])[2][1:], np.array([3e-4, 0.05])
    given = p, np.array([RADIUS]), felt, across.ravel(), sigma
    state = [a[:, None] for a in (z, mean - z, upper(P))]
    found = corrections(CUBOID)[0](*state, *given)
    off, P_1, evidence, gap = (a[:, 0] for a in found)

    def measured(state):
        gap, n = geometry_of(CUBOID).contact(state[:, None], p, RADIUS)
        c, s = np.cos(state[5]), np.sin(state[5])
        n = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ n[:, 0]
        return np.r_[gap / sigma[0], across @ n / sigma[1]], (1 - felt @ n) / sigma[1]

    values, along = measured(z)
    assert gap[0] == pytest.approx(values[0] * sigma[0], abs=1e-12)
    H = np.stack([
        (measured(z + STEP * e)[0] - measured(z - STEP * e)[0]) / (2 * STEP)
        for e in np.eye(6)
    ], axis=1)  # fmt: skip
    S = H @ P @ H.T + np.eye(3)
    error = values + H @ (mean - z)
    gain = P @ H.T @ np.linalg.inv(S)
    assert off == pytest.approx(mean - z - gain @ error, rel=1e-4, abs=1e-9)
    assert whole(P_1, 6) == pytest.approx(P - gain @ H @ P, rel=1e-4, abs=1e-12)
    cost = min(error @ np.linalg.solve(S, error) / 2 + along**2 / 2, OUTLIER)
    expected = -cost - np.log(np.linalg.det(S)) / 2
    assert evidence[0] == pytest.approx(expected, rel=1e-4)


def test_a_finger_in_the_air_corrects_only_what_would_overlap():
    P, sigma = np.diag([4e-6, 4e-6, 4e-6, 1e-6, 1e-6, 1e-2]), np.array([3e-4, 0.05])
    overlap = corrections(CUBOID)[1]
    for x, told in ((0.032, False), (0.028, True)):
        given = at_side(x), np.array([RADIUS]), sigma
        state = BOX[:, None], np.zeros((6, 1)), upper(P)[:, None]
        off, P_1, evidence, gap = overlap(*state, *given)
        assert (gap[0, 0] < 0) == told
        changed = (off != 0).any(), (state[2] != P_1).any(), evidence[0] < 0
        assert changed == (told, told, told)
        if told:  # a smaller box, or one farther away
            assert off[0, 0] < 0
            assert off[3, 0] < 0


def test_columns_do_not_depend_on_how_many_there_are():
    """One at a time or many: the same digits, and results that stay what they are."""
    rng = np.random.default_rng(3)
    z = BOX[:, None] + rng.normal(size=(6, 21)) * 1e-3
    contact, p = geometry_of(CUBOID).contact, at_side(0.03)
    gap, normal = contact(z, p, RADIUS)
    each = [contact(z[:, k : k + 1], p, RADIUS) for k in range(21)]
    assert [float(one[0]) for one, _ in each] == gap.tolist()
    assert np.array_equal(np.hstack([one for _, one in each]), normal)


def test_columns_give_the_same_digits_without_a_compiler(monkeypatch):
    rng = np.random.default_rng(4)
    z = BOX[:, None] + rng.normal(size=(6, 5)) * 1e-3
    compiled = geometry_of(CUBOID).contact(z, at_side(0.03), RADIUS)
    monkeypatch.setattr(mapped, "compiled_earlier", lambda *given: None)
    monkeypatch.setattr(
        mapped, "start_compilation", lambda made, *_, **__: lambda: made
    )
    plain = geometry_of.__wrapped__(CUBOID).contact(z, at_side(0.03), RADIUS)
    assert all(map(np.array_equal, compiled, plain))


def test_threads_do_not_write_into_each_others_columns():
    rng = np.random.default_rng(5)
    states = [BOX[:, None] + rng.normal(size=(6, 200)) * 1e-3 for _ in range(8)]
    contact, p = geometry_of(CUBOID).contact, at_side(0.03)
    alone = [contact(z, p, RADIUS)[1] for z in states]
    with ThreadPoolExecutor(8) as pool:
        for _ in range(20):
            found = pool.map(lambda z: contact(z, p, RADIUS)[1], states)
            assert all(map(np.array_equal, found, alone))


def test_motions_between_actions_are_drawn_from_the_density_of_the_page():
    """Of a finger that died while it pushed, the box turned 8 noise scales, unseen."""
    S, rng = 20_000, np.random.default_rng(0)
    z = np.repeat(BOX[:, None], S, axis=1)
    tracks = new_tracks(z, np.zeros((6, 6, S)), 2, rng)
    after = between_actions(tracks, rng)
    assert (after.z == z).all()
    assert not after.motion.any()
    assert not after.P[:3].any()
    scales = np.array([GAP, GAP, GAP / ARM])[:, None]
    u = np.sqrt(after.P[range(3, 6), range(3, 6)]) / scales * rng.normal(size=(3, S))
    way = np.sqrt((u**2).sum(axis=0))
    # The density (1 + way^2)^-2 in three dimensions, up to the way w.
    for w in (0.5, 1.0, 3.0, 10.0):
        below = 2 / np.pi * (np.arctan(w) - w / (1 + w**2))
        assert (way < w).mean() == pytest.approx(below, abs=4 * 0.5 / np.sqrt(S))


def test_a_body_that_is_pushed_as_an_action_ends_stops_or_goes_one_step_on():
    S, rng = 3, np.random.default_rng(0)
    z = np.repeat(BOX[:, None], S, axis=1)
    motion = np.array([[1e-3, -2e-3, 0.02]] * S).T
    still = new_tracks(z, np.zeros((6, 6, S)), 2, rng)
    moving = new_tracks(z, np.zeros((6, 6, S)), 2, rng)
    moving = replace(moving, motion=motion)
    a, b = (between_actions(t, np.random.default_rng(1)) for t in (still, moving))
    ends = np.stack([z[3:], z[3:] + motion])  # of either, as likely as the other
    assert b.z[3:] == pytest.approx(ends.mean(axis=0))
    off = (ends - ends.mean(axis=0))[..., 0]
    assert b.P[3:, 3:, 0] - a.P[3:, 3:, 0] == pytest.approx(off.T @ off / 2)
    assert not b.motion.any()
