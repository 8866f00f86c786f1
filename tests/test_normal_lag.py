"""Normals that are later than contacts: estimated, and moved back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactilenlp import Estimate, solve_estimate
from tactilenlp.data.contact_segments import consecutive_contacts
from tactilenlp.data.sensor_noise import (
    NORMAL_LAG,
    Precision,
    latency_cost,
    normal_rates,
    with_normals_earlier,
)
from tactilenlp.interface.request import read_request

LAG = 12e-3  # [s]


@pytest.fixture
def turning(recorded):
    """Return a recording whose normals turn at 2 rad/s about the vertical."""
    data, *_ = recorded
    angle = 2.0 * data.time[:, None] * np.ones(data.fingers)
    normal = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=2)
    return replace(data, normal=np.where(data.contact[..., None], normal, 0.0))


def inner_touches(data):
    """Tell which contacts (T, F) have one before and one after them."""
    pair, inner = consecutive_contacts(data), np.zeros_like(data.contact)
    inner[1:-1] = pair[1:] & pair[:-1]
    return inner


def test_normals_are_moved_by_how_fast_they_turn(turning):
    earlier = with_normals_earlier(turning, LAG)
    x, y, _ = np.moveaxis(earlier.normal, 2, 0)
    before_x, before_y, _ = np.moveaxis(turning.normal, 2, 0)
    turned = np.arctan2(before_x * y - before_y * x, before_x * x + before_y * y)
    inner = inner_touches(turning)
    assert inner.sum() > 20
    assert turned[inner] == pytest.approx(2.0 * LAG, rel=2e-3)
    assert not earlier.normal[~turning.contact].any()
    assert np.linalg.norm(earlier.normal[turning.contact], axis=1) == pytest.approx(1.0)
    assert with_normals_earlier(turning, 0.0) is turning


def test_a_single_touch_tells_no_rate(turning):
    contact = np.zeros_like(turning.contact)
    contact[3, 0] = True
    normal = np.where(contact[..., None], [1.0, 0.0, 0.0], 0.0)
    assert not normal_rates(replace(turning, contact=contact, normal=normal)).any()


def test_noise_is_not_averaged_by_a_lag(turning):
    rng = np.random.default_rng(0)
    up = np.array([0.0, 0.0, 1.0]) + 0.05 * rng.normal(size=turning.normal.shape)
    up /= np.linalg.norm(up, axis=2, keepdims=True)
    noisy = replace(turning, normal=np.where(turning.contact[..., None], up, 0.0))
    inner = inner_touches(turning)
    moved = with_normals_earlier(noisy, LAG).normal[inner]
    assert moved[:, :2].std() > up[inner][:, :2].std()  # else a lag looked likely


def test_a_lag_costs_its_prior_unless_latency_was_told(recorded):
    _, scene, _ = recorded
    late = Precision(0.0, 0.0, normal_lag=NORMAL_LAG)
    assert latency_cost(scene, late) == pytest.approx(0.5)
    assert latency_cost(replace(scene, latency=0.0), late) == 0.0


def test_a_job_goes_back_to_what_was_recorded(recorded):
    data, scene, _ = recorded
    job = read_request(data, scene, "cuboid")[0].job
    late = job.as_late_as(replace(job.precision, latency=5e-3, normal_lag=LAG))
    assert late.recorded is job.data
    assert not np.array_equal(late.data.normal, job.data.normal)
    prompt = late.as_late_as(job.precision)
    assert prompt.recorded is None
    assert np.array_equal(prompt.data.normal, job.data.normal)
    assert np.array_equal(prompt.data.finger_position, job.data.finger_position)


@pytest.mark.slow
def test_late_normals_are_estimated_and_moved_back(recorded, tmp_path):
    data, scene, _ = recorded
    true = 20e-3
    late = with_normals_earlier(data, -true)
    prompt, found = solve_estimate(data, scene), solve_estimate(late, scene)
    lag, error = found.sensors.normal_lag, found.sensors.normal_lag_error
    assert prompt.sensors.normal_lag == 0
    assert abs(lag - true) < 3 * error
    assert 1e-3 < error < NORMAL_LAG
    assert (
        f"Normals are {1e3 * lag:.0f} ± {1e3 * error:.0f} ms later" in found.summary()
    )
    assert found.side_lengths == pytest.approx(prompt.side_lengths, abs=0.2e-3)
    # Contacts are those of the solve: their normals are not the late ones.
    _, seen = found.contacts()
    R_wo = Rotation.from_quat(found.quaternion, scalar_first=True).as_matrix()
    of_body = np.einsum("tij,tfi->tfj", R_wo, found.measurements.normal)[late.contact]
    assert np.abs(seen[late.contact] - of_body).max() > 0.01
    found.save(tmp_path / "late.npz")
    again = Estimate.load(tmp_path / "late.npz")
    assert again.sensors == found.sensors
    request, _ = read_request(late, scene, "cuboid", start=again)
    assert request.job.precision.normal_lag == lag
