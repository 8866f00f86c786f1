"""From encoder counts and touches to measurements, and to the estimate."""

import numpy as np
import pytest
from bench_wires import NOON, again, streams
from scipy.interpolate import PchipInterpolator

from hardware.assemble import assemble
from hardware.motor_can import RESOLUTION


def test_positions_come_back_within_the_quantisation_of_the_encoders(recorded):
    data, _, _ = recorded
    back = again(data)
    off = np.abs(back.finger_position - data.finger_position).max()
    # A count of Q24 is 0.02 um at the tip.  Stamps of 1.7e9 s have digits of 0.24 us:
    # 0.15 um at 0.3 m/s.  Straight lines between 1 kHz samples: 0.5 um at 4 m/s^2.
    assert RESOLUTION / 2 * 2 * np.pi / 9 * 0.35 < 2e-8
    assert off < 0.7e-6
    assert np.array_equal(back.contact, data.contact)
    assert np.abs(back.normal - data.normal).max() < 5e-6
    assert np.array_equal(back.valid, data.valid)
    assert np.abs(back.time - data.time).max() < 1e-6


@pytest.mark.slow
def test_the_estimate_from_the_wires_is_that_from_the_simulator(recorded, estimate):
    from tactilenlp import solve_estimate

    data, scene, _ = recorded
    wired = solve_estimate(again(data.select(range(3))), scene)
    # All six faces within 0.1 mm, touched or not.  Corners are compared as a set: a
    # cuboid whose sides x and y are exchanged, and which is turned by 90 degrees, is
    # the same cuboid.
    there, here = (e.mesh().vertices for e in (wired, estimate))
    apart = np.linalg.norm(there[:, None] - here[None], axis=2)
    assert len(there) == len(here) == 8
    assert apart.min(axis=0).max() < 1e-4
    assert apart.min(axis=1).max() < 1e-4


def test_dropped_and_late_frames_lose_samples_but_invent_no_contact(recorded):
    data, _, _ = recorded
    for seed in range(3):
        rng = np.random.default_rng(seed)
        for action in range(6):
            one = data.select([action])
            fingers = [streams(one, k, rng, 0.05, 0.01) for k in range(2)]
            back = assemble(fingers, origin=NOON, complete=0.0)
            for k, wires in enumerate(fingers):
                check_that_contacts_were_felt(back, k, wires)
            assert not back.contact[~back.valid].any()
            assert back.valid[:, one.valid.any(axis=0)].mean() > 0.8


def check_that_contacts_were_felt(back, k, wires):
    """Every contact is a touch of the last 50 ms, with its normal."""
    stamps = wires.touch.time - NOON
    for n in np.flatnonzero(back.contact[:, k]):
        since = back.time[n] - stamps
        fresh = (since > -2e-6) & (since < 0.05 + 2e-6)
        newest = np.flatnonzero(fresh)[-1]
        assert wires.touch.values[newest, 0] == 1
        assert np.linalg.norm(back.normal[n, k]) == pytest.approx(1)


def test_positions_survive_dropped_frames_within_microns(recorded):
    data, _, _ = recorded
    one, rng = data.select([1]), np.random.default_rng(0)
    fingers = [streams(one, k, rng, 0.05) for k in range(2)]
    back = assemble(fingers, origin=NOON, complete=0.5)
    truth = PchipInterpolator(one.time, one.finger_position)(back.time)
    off = np.abs(back.finger_position - truth)[back.valid]
    assert off.max() < 5e-6
