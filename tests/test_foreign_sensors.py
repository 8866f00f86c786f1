"""What sensors lose or report wrongly in other worlds is what its name says."""

from dataclasses import replace

import numpy as np
import pytest

from tactilenlp import Measurements


def made_up(samples=400, fingers=2) -> Measurements:
    """Return measurements of contact all the time, in four actions."""
    time = np.arange(samples) / 30
    normal = np.tile([1.0, 0.0, 0.0], (samples, fingers, 1))
    return Measurements(
        time=time, finger_position=np.zeros((samples, fingers, 3)), finger_radius=0.01,
        contact=np.ones((samples, fingers)), normal=normal,
        action=np.arange(samples) * 4 // samples,
    )  # fmt: skip


def runs(valid) -> np.ndarray:
    """Return the lengths of all runs of missing samples."""
    edges = np.diff(np.r_[1, valid.astype(int), 1])
    return np.flatnonzero(edges == 1) - np.flatnonzero(edges == -1)


@pytest.mark.parametrize("name", ["at random", "per finger", "in bursts"])
def test_the_share_of_lost_samples_is_the_one_named(foreign, name):
    data = made_up()
    for strength, share in (("25 %", 0.25), ("50 %", 0.5)):
        lost = foreign.DEPARTURES[f"dropped {name}"][strength].measured(data, 0)
        # 800 samples in bursts of five: a standard deviation of 0.05.
        assert (~lost.valid).mean() == pytest.approx(share, abs=0.15)
        assert not lost.contact[~lost.valid].any()
        same = (lost.valid[:, 0] == lost.valid[:, 1]).all()
        assert same == (name == "at random")
        longest = max(runs(lost.valid[:, 0]))
        assert np.mean(runs(lost.valid[:, 0])) > (2.5 if name == "in bursts" else 0)
        assert longest >= 2


def test_wrong_reports_have_the_share_that_is_named_and_unit_normals(foreign):
    data = made_up()
    free = replace(data, contact=~data.contact, normal=0 * data.normal)
    for name, of in (("false touches", free), ("normals wrong", data)):
        for strength, made in foreign.DEPARTURES[name].items():
            share = float(strength.split()[0]) / 100
            told = made.measured(of, 0)
            hit = (told.normal != of.normal).any(axis=-1)
            assert hit.mean() == pytest.approx(share, abs=3 * (share / 800) ** 0.5)
            np.testing.assert_allclose(np.linalg.norm(told.normal[hit], axis=-1), 1.0)
            assert (told.contact == (of.contact | hit)).all()


def test_a_repeated_report_is_the_one_before_it_in_the_same_action(foreign):
    data, rng = made_up(), np.random.default_rng(0)
    places = 1e-3 * np.cumsum(rng.normal(size=data.finger_position.shape), axis=0)
    data = replace(data, finger_position=places)
    told = foreign.DEPARTURES["repeated"]["20 %"].measured(data, 0).finger_position
    old = (told[1:] == told[:-1]).all(axis=-1)
    assert 0.1 < old.mean() < 0.3
    begins = np.flatnonzero(np.diff(data.action))
    assert not old[begins].any()
    new = np.vstack([np.ones((1, data.fingers), bool), ~old])
    np.testing.assert_array_equal(told[new], places[new])


def test_a_gap_takes_half_of_one_action_and_a_dead_finger_stays_dead(foreign):
    data = made_up()
    gap, dead = (
        foreign.DEPARTURES["gap"][k].measured(data, 0)
        for k in ("half an action", "dead")
    )
    assert (~gap.valid).all(axis=1).sum() == 50
    assert len(np.unique(gap.action[~gap.valid[:, 0]])) == 1
    assert dead.valid[:, 0].all()
    assert (dead.valid[:, 1] == (np.arange(400) < 200)).all()
