"""Each action of a recording has a rate of its own."""

import numpy as np
import pytest

from tactilenlp import Measurements, Noise, Scene, Workspace, World, solve_estimate
from tactilenlp.data.contact_segments import intervals, rate_of, tracked_samples
from tactilenlp.data.mistakes import check_mistakes
from tactilenlp.errors import MeasurementError
from tactilenlp.problem.reductions import may_move, repeated_samples

RATES = (30.0, 300.0, 60.0)  # [Hz] of three actions


@pytest.fixture(scope="module")
def recording():
    """One finger that comes, touches for a tenth of a second, and stands still."""
    parts, begin = [], 0.0
    for action, rate in enumerate(RATES):
        t = np.arange(round(rate)) / rate
        p = np.zeros((len(t), 1, 3))
        p[:, 0, 0] = 0.1 * np.minimum(t, 0.5)
        felt = ((t > 0.39) & (t < 0.49))[:, None]
        normal = np.where(felt[..., None], [-1.0, 0, 0], 0.0)
        parts.append((begin + t, p, felt, normal, np.full(len(t), action)))
        begin += t[-1] + 1.0
    time, p, felt, normal, action = map(np.concatenate, zip(*parts, strict=True))
    return Measurements(
        time=time, finger_position=p, finger_radius=0.01, contact=felt, normal=normal,
        action=action,
    )  # fmt: skip


def test_the_interval_of_a_sample_is_that_of_its_action(recording):
    each = 1 / np.array(RATES)
    assert intervals(recording) == pytest.approx(each[recording.action])


def test_an_action_is_tracked_by_its_own_rate(recording):
    for action in range(len(RATES)):
        samples = np.flatnonzero(recording.action == action)
        tracked = np.intersect1d(tracked_samples(recording), samples)
        assert len(tracked) == 30
        assert tracked[-1] == samples[-1]


def test_no_sample_of_a_fast_action_repeats_the_one_before(recording):
    first = np.r_[True, np.diff(recording.action) > 0]
    kept = repeated_samples(recording, first)
    assert np.array_equal(kept, np.arange(recording.samples))
    fastest = np.linalg.norm(
        rate_of(recording, recording.finger_position)[:, 0], axis=1
    )
    assert fastest.max() == pytest.approx(0.1, rel=1e-6)


def test_a_body_may_slide_on_for_as_long_at_every_rate(recording):
    """0.1 m/s at mu g = 0.3 x 9.81 m/s^2: 34 ms."""
    first = np.r_[True, np.diff(recording.action) > 0]
    moving = may_move(recording, Scene(), first)
    for action, rate in enumerate(RATES):
        rows = recording.action == action
        time = recording.time[rows] - recording.time[rows][0]
        last = time[recording.contact[rows, 0]].max()
        settled = time[moving[rows]].max() - last
        assert 0.034 - 1e-9 <= settled <= 0.034 + 1 / rate + 1e-9


@pytest.mark.slow
def test_actions_of_two_rates_are_estimated_as_well_as_those_of_one():
    world = World((0.05, 0.035, 0.04), rate=120.0)
    space, rng = Workspace(), np.random.default_rng(3)
    whole = world.execute(space.random(rng).trajectory([0.0, 0.0, 0.02]))
    for _ in range(2):
        place = space.random(rng).trajectory(world.pose[:3])
        whole = whole.append(world.execute(place))
    slow = np.flatnonzero((whole.action < 2) & (np.arange(whole.samples) % 4 > 0))
    mixed = Measurements(**whole.arrays(np.setdiff1d(np.arange(whole.samples), slow)))
    one, two = (solve_estimate(data) for data in (whole, mixed))
    sigma = one.information.sigma("side_lengths")
    assert np.all(np.abs(one.side_lengths - two.side_lengths) < 2 * sigma + 1e-4)
    assert two.fit.verdict == "good"


def test_a_position_is_interpolated_where_nothing_was_measured(recording):
    """Within its action: the first and an inner sample of the second one are lost."""
    arrays, valid = recording.arrays(), recording.valid.copy()
    rows = np.flatnonzero(recording.action == 1)
    gone, p = rows[[0, 150]], recording.finger_position.copy()
    valid[gone, 0] = False
    p[gone, 0, 2] = np.nan  # of one coordinate: the others are not known either
    found = Measurements(**arrays | {"valid": valid, "finger_position": p})
    middle = (p[rows[149], 0] + p[rows[151], 0]) / 2
    assert found.finger_position[gone[1], 0] == pytest.approx(middle)
    assert found.finger_position[gone[0], 0] == pytest.approx(p[rows[1], 0])
    assert np.array_equal(found.finger_position[valid], p[valid])
    p[rows] = np.nan
    for lost in (np.ones_like(valid), valid & (recording.action != 1)[:, None]):
        with pytest.raises(MeasurementError, match="finger_position: not finite"):
            Measurements(**arrays | {"valid": lost, "finger_position": p})


def test_flips_at_a_high_rate_are_no_mistake():
    """A pair of flipped booleans is too short for a touch, at any rate."""
    noise = Noise(position=1e-3, normal=np.radians(5), flips=0.02, seed=11)
    world = World((0.05, 0.035, 0.04), rate=200, noise=noise)
    rng, space = np.random.default_rng(111), Workspace(duration=2.0)
    for _ in range(3):
        target = world.pose[:3]
        world.execute(space.random(rng, None, target).trajectory(target))
    check_mistakes(world.measurements, Scene())
