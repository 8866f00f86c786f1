"""Classes of shapes compared by their evidence."""

import numpy as np
import pytest

from tactilenlp import Estimate, solve_estimate
from tactilenlp.errors import NoContactError, OptionError
from tactilenlp.information.mixture import log_evidence


def line(degree, x, y, sigma, spread):
    """Return objective, covariance and prior information of a fitted polynomial."""
    J = np.vander(x, degree + 1)
    prior = np.eye(degree + 1) / spread**2
    C = np.linalg.inv(J.T @ J / sigma**2 + prior)
    z = C @ J.T @ y / sigma**2
    off = (y - J @ z) / sigma
    return (off @ off + z @ prior @ z) / 2, C, prior


def test_evidence_is_that_of_linear_least_squares():
    rng = np.random.default_rng(4)
    x, sigma, spread = np.linspace(-1, 1, 20), 0.1, 2.0
    y = 0.7 - 0.3 * x + sigma * rng.normal(size=x.size)
    told, exact = [], []
    for degree in (0, 1, 3):
        told.append(log_evidence(*line(degree, x, y, sigma, spread)))
        J = np.vander(x, degree + 1)
        S = sigma**2 * np.eye(x.size) + spread**2 * J @ J.T
        exact.append(-(y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2)
    assert np.diff(told) == pytest.approx(np.diff(exact), abs=1e-6)
    assert np.argmax(told) == 1


def test_an_unknown_that_nothing_tells_costs_nothing():
    one = log_evidence(1.0, np.diag([0.01]), np.eye(1))
    two = log_evidence(1.0, np.diag([0.01, 1.0]), np.eye(2))
    assert two == pytest.approx(one)


def test_classes_are_named_before_any_solve(recorded):
    data, scene, _ = recorded
    with pytest.raises(OptionError, match=r"unknown shape.*got sphere"):
        solve_estimate(data, scene, shape=["cuboid", "sphere"])
    with pytest.raises(OptionError, match="no class"):
        solve_estimate(data, scene, shape=[])
    nothing = data.select([0])
    with pytest.raises(NoContactError):
        solve_estimate(without_contact(nothing), scene, shape=["cuboid", "polytope"])


def without_contact(data):
    """Return measurements in which no finger feels anything."""
    from dataclasses import replace

    none = np.zeros_like(data.contact)
    return replace(data, contact=none, normal=np.zeros_like(data.normal))


@pytest.mark.slow
def test_a_box_is_a_box_rather_than_a_hull(recorded, tmp_path):
    data, scene, _ = recorded
    estimate = solve_estimate(data, scene, shape=["polytope", "cuboid"])
    assert estimate.shape == "cuboid"
    best, other = estimate.classes
    assert (best.shape, other.shape) == ("cuboid", "polytope")
    assert best.probability > 0.95
    assert best.probability + other.probability == pytest.approx(1)
    assert "Of the classes compared, cuboid" in estimate.summary()
    estimate.save(tmp_path / "box.npz")
    assert Estimate.load(tmp_path / "box.npz").classes == estimate.classes
