"""Contact latency: a finger that just left still reports contact."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactilenlp import Measurements, Options, World
from tactilenlp.data.contact_segments import CONTACT_LATENCY, late_gap
from tactilenlp.data.sensor_noise import Precision, precise

SPEED = 0.12  # [m/s]


@pytest.fixture
def brushed():
    """Two actions of ten samples: a finger passes, felt from 3 to 5 and from 15 on."""
    felt = np.zeros((20, 1), bool)
    felt[3:6] = felt[15:] = True
    t = np.arange(20) / 30
    p = np.stack([SPEED * t, 0 * t, 0.05 + 0 * t], axis=1)[:, None]
    return Measurements(
        time=t, finger_position=p, finger_radius=[0.01], contact=felt,
        normal=felt[..., None] * [0.0, 0.0, 1.0], action=np.repeat([0, 1], 10),
    )  # fmt: skip


def test_only_a_finger_that_feels_nothing_a_sample_later_may_have_parted(brushed):
    way = late_gap(brushed)
    assert np.argwhere(way).tolist() == [[5, 0]]  # not at the end of an action
    assert way[5, 0] == pytest.approx(CONTACT_LATENCY * SPEED)
    lost = brushed.valid.copy()
    lost[6] = False  # nobody knows whether it left
    assert not late_gap(replace(brushed, valid=lost)).any()


def test_a_sample_that_comes_twice_is_no_leap(brushed):
    time = brushed.time.copy()
    time[6:10] -= time[6] - time[5] - 1e-9
    way = late_gap(replace(brushed, time=time))
    assert way[5, 0] == pytest.approx(SPEED / 30)


def test_the_gap_of_a_finger_that_slides_off_an_edge_is_within_that_way():
    gaps, ways = [], []
    for start in (-0.0530, -0.0525, -0.0520):  # phases of a sample
        world = World((0.04, 0.04, 0.04), mass=5.0, friction_finger=0.1)
        t = np.linspace(0, 1, 31)
        along = np.stack([start + 0.13 * t, -0.027 + 0 * t, 0.02 + 0 * t], axis=1)
        away = np.tile([0.2, 0.2, 0.1], (31, 1))
        path = np.stack([along, away], axis=1)
        world.execute(SimpleNamespace(time=t, finger_position=path))
        (row,) = np.nonzero(late_gap(world.measurements)[:, 0])[0]
        ways.append(late_gap(world.measurements)[row, 0])
        gaps.append(world.truth.distance[row, 0])
    assert max(gaps) > 0.03e-3  # it does happen
    assert np.all(np.abs(gaps) < 2 * np.array(ways))


def test_noise_asks_for_more_hypotheses_unless_a_user_says_how_many(brushed):
    exact, noisy = (precise(brushed, Precision(s, 0.0)) for s in (1e-5, 1e-3))
    assert (exact, noisy) == (True, False)
    few, many = (Options().widths(p) for p in (exact, noisy))
    assert few[0] < many[0]
    assert few[1] < many[1]
    asked = Options(hypotheses=7, starts=9)
    assert asked.widths(exact) == asked.widths(noisy) == (7, 9)
