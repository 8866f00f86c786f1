"""The noise of sensors, as it is estimated from what they report."""

from dataclasses import replace

import numpy as np
import pytest

from tactilenlp import solve_estimate
from tactilenlp.data.sensor_noise import precision_of


def in_steps(data, step: float):
    """Return the data with azimuth and elevation of normals in whole steps [rad]."""
    x, y, z = np.moveaxis(data.normal, -1, 0)
    azimuth, up = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    a, e = (step * np.round(angle / step) for angle in (azimuth, up))
    normal = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1)
    # The same number again, of which no bit differs by rounding.
    return replace(data, normal=np.round(normal, 12) * data.contact[..., None])


@pytest.mark.parametrize(("degrees", "least"), [(5, 0.3), (15, 0.999)])
def test_normals_in_steps_have_the_noise_of_rounding(recorded, degrees, least):
    """Of normals that point up, a step of the azimuth is smaller: the least counts."""
    data, _, _ = recorded
    step = np.radians(degrees)
    rounding = 2 * np.sin(step / 2) / np.sqrt(12)
    found = precision_of(in_steps(data, step)).normal
    assert least * rounding < found < 1.001 * rounding


def test_normals_of_a_body_that_moves_smoothly_are_in_no_steps(recorded):
    data, _, _ = recorded
    assert precision_of(data).normal < 1e-3
    fixed = replace(data, normal=data.contact[..., None] * np.array([1.0, 0, 0]))
    assert precision_of(fixed).normal == 0.0  # nothing tells of steps


@pytest.mark.slow
def test_rounded_normals_leave_an_estimate_right_or_honest(recorded):
    data, scene, truth = recorded
    estimate = solve_estimate(in_steps(data, np.radians(15)), scene)
    error = np.sort(estimate.side_lengths) - np.sort(truth["side_lengths"])
    sigma = estimate.information.sigma("side_lengths")
    assert (np.abs(error) < 3 * sigma[np.argsort(estimate.side_lengths)]).all()
