"""The radius of one finger that was told wrong: what sigma and the summary say."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import moved_by

from formulations.names import LATE_TOUCHES, RADIUS_OF, SOFT_FINGERTIPS
from tactilenlp import (
    Measurements,
    Scene,
    example_recording,
    solve_estimate,
)
from tactilenlp.data.sensor_noise import Precision
from tactilenlp.information.consider_parameters import Considered
from tactilenlp.information.linearisation import Linearisation
from tactilenlp.nlp.kkt import kkt_system_of
from tactilenlp.output.summary import doubts_in_words

STEP = 1e-5  # [m]
WRONG = 0.3e-3  # [m]


def test_the_error_by_a_radius_is_how_the_optimum_moves_with_it(programme):
    kkt = kkt_system_of(programme.problem, programme.solution)
    at = Linearisation(kkt, programme.job, programme.window)
    radius, chosen = at.consider_parameters[f"{RADIUS_OF}1"], programme.tangent.chosen
    told = -kkt.sensitivity(chosen)[0].T @ radius.slope[:, 0]

    def thicker(step):
        parts = {
            name: replace(rows, radius=rows.radius + step * (rows.finger == 1))
            for name in ("touch", "free")
            for rows in [getattr(programme.window, name)]
        }
        return replace(programme.window, **parts)

    moved = moved_by(programme, thicker, STEP)
    assert told == pytest.approx(moved, abs=0.05 * np.abs(moved).max())


def test_told_radii_are_believed_where_the_touches_fit_one_body(estimate):
    radii = [v for n, v in estimate.information.considered.items() if RADIUS_OF in n]
    assert len(radii) == estimate.measurements.fingers
    for off, sigma, probability in radii:
        assert abs(off) < 2 * sigma
        assert probability < 0.05
    assert "than was told" not in estimate.summary()


@pytest.mark.slow
def test_a_radius_told_wrong_is_found_where_it_fits_no_body(tmp_path):
    path = example_recording()
    # Sides are as uncertain as fingertips that may be soft: here they are rigid.
    data, scene = Measurements.load(path), Scene.load(path, compliance=0.0)
    right = solve_estimate(data, scene)
    wrong = data.finger_radius - np.array([WRONG, 0.0])
    found = solve_estimate(replace(data, finger_radius=wrong), scene)
    off, sigma, probability = found.information.considered[f"{RADIUS_OF}0"]
    assert probability > 0.9
    assert off == pytest.approx(WRONG, abs=3 * sigma)
    assert "the radius of finger 0 is 0.19 ± 0.04 mm larger" in found.summary()
    sides = np.abs(found.side_lengths - right.side_lengths)
    assert (sides < 2 * found.information.sigma("side_lengths")).all()
    assert (sides > 2 * right.information.sigma("side_lengths")).all()
    file = tmp_path / "estimate.npz"
    found.save(file)
    again = type(found).load(file).information.considered
    for name, told in found.information.considered.items():
        np.testing.assert_array_equal(again[name], told)


def test_what_is_considered_has_names_and_survives_a_file(estimate, tmp_path):
    known = estimate.information.considered
    for told in known.values():
        assert told == (told.mean, told.sigma, told.probability)
        assert told.sigma > 0
        assert 0 <= told.probability <= 1
    estimate.save(tmp_path / "estimate.npz")
    with np.load(tmp_path / "estimate.npz") as file:  # an array each, as before
        told = file[f"information/considered/{LATE_TOUCHES}"]
    assert known[LATE_TOUCHES] == tuple(told)
    again = type(estimate).load(tmp_path / "estimate.npz").information.considered
    assert again == known
    assert {type(told) for told in again.values()} == {Considered}


def test_the_summary_tells_what_is_not_as_it_was_taken():
    considered = {
        "rounded edges": (1.2e-3, 1e-4, 0.95), "late touches": (5e-3, 1e-3, 0.99),
        "late normals": (12e-3, 2e-3, 0.99), f"{RADIUS_OF}0": (2e-4, 5e-5, 0.95),
        f"{RADIUS_OF}1": (-3e-4, 5e-5, 0.96), f"{RADIUS_OF}2": (9e-4, 5e-5, 0.8),
        SOFT_FINGERTIPS: (4e-4, 1e-4, 0.97),
    }  # fmt: skip
    considered = {name: Considered(*value) for name, value in considered.items()}
    told = SimpleNamespace(considered=considered)
    estimate = SimpleNamespace(information=told, sensors=Precision(0.0, 0.0))
    edges, late, soft, radii = doubts_in_words(estimate)
    assert edges.startswith("The edges are rounded by 1.2 ± 0.1 mm.")
    assert late.startswith("Normals are 12 ± 2 ms later than contacts.")
    assert "finger 0 is 0.20 ± 0.05 mm larger or the radius of finger 1" in radii
    assert "finger 2" not in radii
    estimate.sensors = Precision(0.0, 0.0, normal_lag=12e-3)
    assert soft.startswith(
        "Fingertips yield by 0.4 ± 0.1 mm under the object's weight."
    )
    assert doubts_in_words(estimate) == [
        edges,
        soft,
        radii,
    ]  # it has a sentence of its own
