"""Noise has the spread that was asked for, and is repeatable."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter

from tactilenlp.data.measurements import Measurements
from tactilenlp.data.noise_model import Noise, add_noise
from tactilenlp.data.sensor_noise import (
    SMOOTHING_WINDOW,
    local_parabolas,
    precision_of,
    smooth_paths,
    smoothing_matrices,
)


@pytest.fixture
def recorded():
    """Ten actions of 200 samples: finger 0 touches half of the time, finger 1 never."""
    rng = np.random.default_rng(0)
    normal, contact = rng.normal(size=(2000, 2, 3)), np.zeros((2000, 2), bool)
    contact[::2, 0] = True
    normal *= contact[..., None] / np.linalg.norm(normal, axis=-1, keepdims=True)
    return Measurements(
        time=np.arange(2000) / 30,
        finger_position=rng.uniform(0.1, 0.2, (2000, 2, 3)),
        finger_radius=[0.01, 0.01],
        contact=contact,
        normal=normal,
        action=np.repeat(np.arange(10), 200),
    )


def test_zero_noise_leaves_the_measurements_unchanged(recorded):
    assert add_noise(recorded, Noise(seed=9)) == recorded


def test_noise_has_the_spread_that_was_asked_for(recorded):
    noise = Noise(position=1e-3, bias=3e-3, normal=0.1, flips=0.02, dropped=0.1, seed=1)
    noisy = add_noise(recorded, noise)
    error = noisy.finger_position - recorded.finger_position
    bias = error.mean(axis=0)
    # Tolerances: four standard deviations of the statistic over these draws.
    assert (error - bias).std() == pytest.approx(1e-3, rel=0.03)
    assert 1e-4 < bias.std() < 8e-3  # six draws of 3 mm
    assert (~noisy.valid).mean() == pytest.approx(0.1, abs=0.02)
    flipped = (noisy.contact != recorded.contact) & noisy.valid
    assert flipped.sum() / noisy.valid.sum() == pytest.approx(0.02, abs=0.01)
    kept = noisy.contact & recorded.contact
    cosine = (noisy.normal * recorded.normal).sum(axis=-1)[kept].clip(-1, 1)
    assert np.sqrt((np.arccos(cosine) ** 2).mean()) == pytest.approx(0.1, rel=0.1)
    invented = noisy.contact & ~recorded.contact
    assert np.linalg.norm(noisy.normal[invented], axis=1) == pytest.approx(1)
    assert not noisy.normal[~noisy.contact].any()


def test_noise_is_repeatable_and_one_kind_leaves_the_others_alone(recorded):
    noise = Noise(position=1e-3, bias=1e-3, normal=0.1, flips=0.1, dropped=0.1, seed=2)
    noisy = add_noise(recorded, noise)
    assert add_noise(recorded, noise) == noisy
    assert add_noise(recorded, replace(noise, seed=3)) != noisy
    fewer = add_noise(recorded, replace(noise, flips=0.0, normal=0.0))
    np.testing.assert_array_equal(fewer.finger_position, noisy.finger_position)
    np.testing.assert_array_equal(fewer.valid, noisy.valid)
    alone = add_noise(recorded.select([7]), noise)
    assert alone == noisy.select([7])


@pytest.mark.parametrize("samples", [5, 9, 10, 31])
def test_smoothing_is_the_filter_of_savitzky_and_golay(samples):
    window = min(SMOOTHING_WINDOW, samples - 1 + samples % 2)
    wanted = savgol_filter(np.eye(samples), window, 2, axis=0)
    np.testing.assert_allclose(
        local_parabolas(tuple(range(samples)), window), wanted, atol=1e-14
    )


def test_an_action_may_have_any_number(recorded):
    first = replace(recorded, action=recorded.action - 1)
    noise = Noise(position=1e-3, seed=3)
    again = add_noise(first, noise).finger_position[200:400]
    # The second action has the number 0 then, and the noise that goes with it.
    moved = add_noise(recorded, noise).finger_position[:200]
    difference = again - first.finger_position[200:400]
    assert difference == pytest.approx(moved - recorded.finger_position[:200])


def test_fingers_at_rest_tell_nothing_of_the_noise_of_positions(recorded):
    noisy = add_noise(recorded, Noise(position=1e-3, seed=1))
    rest = noisy.finger_position.copy()
    rest[:, 1] = rest[0, 1]
    one = replace(noisy, finger_position=rest)
    alone = np.delete(noisy.finger_position, 1, axis=1)
    assert precision_of(one).position > 0
    third = np.diff(alone[:, 0], n=3, axis=0)[noisy.action[3:] == noisy.action[:-3]]
    expected = np.median(np.abs(third)) / 0.6745 / 20**0.5
    assert precision_of(one).position == pytest.approx(expected, rel=1e-9)


def uneven(rng, samples=300):
    """Return data at uneven times, with pauses, of paths that bend, and the paths."""
    time = np.cumsum(rng.uniform(0.02, 0.05, samples))
    time[samples // 2 :] += 1.0
    path = 0.1 * np.stack([np.sin(time), np.cos(2 * time), 1 + 0 * time], axis=1)
    noisy = path + 1e-3 * rng.normal(size=path.shape)
    data = Measurements(
        time=time, finger_position=noisy[:, None], finger_radius=[0.01],
        contact=np.zeros((samples, 1), bool), normal=np.zeros((samples, 1, 3)),
        action=np.zeros(samples, int),
    )  # fmt: skip
    return data, path


def test_noise_is_estimated_and_smoothed_at_uneven_times():
    data, path = uneven(np.random.default_rng(4))
    precision = precision_of(data)
    assert precision.position == pytest.approx(1e-3, rel=0.1)
    off = smooth_paths(data, precision).finger_position[:, 0] - path
    assert np.abs(off).max() < 3.5e-3
    assert np.sqrt((off**2).mean()) < 0.6e-3


def test_a_pause_ends_a_run_of_smoothed_samples():
    data, _ = uneven(np.random.default_rng(4))
    runs = [rows for rows, _ in smoothing_matrices(data, precision_of(data))]
    assert [len(rows) for rows in runs] == [150, 150]
    np.testing.assert_array_equal(np.concatenate(runs), np.arange(300))
