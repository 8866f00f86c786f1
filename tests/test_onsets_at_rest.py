"""A touch begins where a finger moves: what noise leaves of that, and what not."""

import numpy as np
import pytest

from tactilenlp.data.plausibility import AT_REST, onsets_at_rest
from tactilenlp.data.touch_events import Record

SAMPLES, BEGINS = 40, 20


def approach(speed: float, noise: float, seed: int = 0, stops: int = SAMPLES) -> Record:
    """Return a touch by a finger at a speed [m/s], at rest from sample `stops` on."""
    rng, time = np.random.default_rng(seed), np.arange(SAMPLES) / 30
    moved = speed * np.minimum(time, stops / 30)
    position = noise * rng.normal(size=(SAMPLES, 1, 3)) + np.array([0.0, 0.0, 0.05])
    position[:, 0, 0] += moved
    felt = (np.arange(SAMPLES) >= BEGINS)[:, None]
    return Record(
        position=position, felt=felt, valid=np.ones_like(felt),
        normal=np.where(felt[..., None], [-1.0, 0.0, 0.0], 0.0),
        radius=np.array([0.01]), action=np.zeros(SAMPLES, int), time=time,
        sigma_position=noise, sigma_normal=0.05, up=np.array([0.0, 0.0, 1.0]),
    )  # fmt: skip


def test_a_touch_of_a_finger_that_stopped_before_costs_a_departure():
    precise = approach(0.05, 5e-5, stops=BEGINS - 6)
    assert onsets_at_rest(precise) == pytest.approx(np.log(AT_REST), abs=0.1)
    moving = approach(0.05, 5e-5)
    assert onsets_at_rest(moving) == pytest.approx(0.0, abs=1e-6)


def test_of_a_slow_finger_noise_does_not_tell_rest_from_motion():
    """Two millimetres in four samples, positions a millimetre off."""
    costs = [onsets_at_rest(approach(0.015, 1e-3, seed)) for seed in range(200)]
    assert np.mean(costs) > -0.6
    assert np.quantile(costs, 0.05) > np.log(AT_REST) / 2
