"""Noise has the spread that was asked for, and is repeatable."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter

from tactilenlp.data.measurements import Measurements
from tactilenlp.data.noise_model import Noise, add_noise
from tactilenlp.data.sensor_noise import SMOOTHING_WINDOW, local_parabolas


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


def test_no_noise_changes_nothing(recorded):
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
    np.testing.assert_allclose(local_parabolas(samples, window), wanted, atol=1e-14)


def test_an_action_may_have_any_number(recorded):
    first = replace(recorded, action=recorded.action - 1)
    noise = Noise(position=1e-3, seed=3)
    again = add_noise(first, noise).finger_position[200:400]
    # The second action has the number 0 then, and the noise that goes with it.
    moved = add_noise(recorded, noise).finger_position[:200]
    difference = again - first.finger_position[200:400]
    assert difference == pytest.approx(moved - recorded.finger_position[:200])
