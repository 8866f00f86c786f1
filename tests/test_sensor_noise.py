"""The noise of sensors, as it is estimated from what they report."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import benchmark

from tactilenlp import solve_estimate
from tactilenlp.data.sensor_noise import precision_of

sensors = benchmark("foreign_sensors")


def turning(data, rate: float, step: float):
    """Return the data of level normals that turn by `rate` a sample, rounded [rad]."""
    azimuth = step * np.round(rate * np.arange(data.samples) / step)
    normal = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=-1)
    return replace(data, normal=normal[:, None] * data.contact[..., None])


@pytest.mark.parametrize("readings", [5, 20])
def test_normals_in_steps_have_the_noise_of_rounding(recorded, readings):
    """Readings that are the same have one error: so many count as one."""
    data, _, _ = recorded
    step = np.radians(10)
    found = precision_of(turning(data, step / readings, step)).normal
    rounding = 2 * np.sin(step / 2) / np.sqrt(12)
    assert found == pytest.approx(rounding * np.sqrt(readings), rel=0.25)
    # Steps below the turn of a sample are noise like any other.
    fine = precision_of(turning(data, step / 20, step / 100)).normal
    assert fine < step / 50


def test_the_step_of_components_is_no_smaller_one_that_happens_once(recorded):
    """Components rounded to a grid jump by less where they lie along the normal."""
    data, _, _ = recorded
    grid, turn = 1 / 16, np.radians(1.5) * np.arange(data.samples)
    normal = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
    normal = grid * np.round(normal / grid)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal[:, None] * data.contact[..., None]
    found = precision_of(replace(data, normal=normal)).normal
    assert grid / np.sqrt(12) < found < 3 * grid / np.sqrt(12)


def test_normals_of_a_body_that_moves_smoothly_are_in_no_steps(recorded):
    data, _, _ = recorded
    assert precision_of(data).normal < 1e-3
    fixed = replace(data, normal=data.contact[..., None] * np.array([1.0, 0, 0]))
    assert precision_of(fixed).normal == 0.0  # nothing tells of steps


@pytest.mark.slow
def test_rounded_normals_leave_an_estimate_right_or_honest(recorded, sensors):
    data, scene, truth = recorded
    estimate = solve_estimate(sensors.normals_in_steps(15.0, data, None), scene)
    error = np.sort(estimate.side_lengths) - np.sort(truth["side_lengths"])
    sigma = estimate.information.sigma("side_lengths")
    assert (np.abs(error) < 3 * sigma[np.argsort(estimate.side_lengths)]).all()
