"""Contacts and normals that are reported late: what sigma says of it."""

from dataclasses import replace

import numpy as np
import pytest
from programmes import moved_by

from tactilenlp.data.sensor_noise import LATENCY
from tactilenlp.information.linearisation import Linearisation
from tactilenlp.information.measurement_noise import fingers_earlier
from tactilenlp.nlp.kkt import kkt_system_of

LATE = 1e-4  # [s]


@pytest.fixture(scope="module")
def lag(programme):
    kkt = kkt_system_of(programme.problem, programme.solution)
    at = Linearisation(kkt, programme.job, programme.window)
    return kkt, at.consider_parameters["late touches"]


def test_the_error_by_a_lag_is_how_the_optimum_moves_with_it(programme, lag):
    kkt, late = lag
    pulls, _ = kkt.sensitivity(programme.tangent.chosen)
    told = -pulls.T @ late.slope[:, 0]

    def lagging(lag):
        return fingers_earlier(programme.window, programme.job.data, lag)

    moved = moved_by(programme, lagging, LATE)
    assert told == pytest.approx(moved, abs=0.05 * np.abs(moved).max())


def test_a_lag_moves_the_body_on_by_its_velocity(programme, lag):
    kkt, late = lag
    window, problem = programme.window, programme.problem
    at = Linearisation(kkt, programme.job, window)
    v, _, ahead = at.motions.T
    assert not ahead.any()
    v = v[problem.variables["x"].span].reshape(-1, 3)
    x = programme.solution.values["x"]
    step = window.step
    for k in (0, len(step) // 2):
        way = x[:, step.pose[k]] - x[:, step.before[k]]
        assert v[step.pose[k]] == pytest.approx(way / step.dt[k])
    assert not v[np.setdiff1d(np.arange(window.poses), step.pose)].any()
    pulls = np.zeros((problem.size, 1))
    assert late.covariance(pulls, np.ones((1, 1))) == pytest.approx(late.squared)
    still = replace(late, slope=np.zeros((problem.size, 1)))
    assert still.covariance(pulls + 1.0) == pytest.approx(0.0)


def test_sensors_in_time_are_told_from_late_ones_within_a_few_milliseconds(lag):
    assert np.sqrt(lag[1].squared) < LATENCY / 3
