"""Lags of sensors by Newton steps, on an objective that is known in closed form."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from tactilenlp.common.deadline import NEVER, Deadline
from tactilenlp.data.sensor_noise import LATENCY, Precision
from tactilenlp.information.consider_parameters import ConsiderParameter
from tactilenlp.information.goodness_of_fit import Misfit
from tactilenlp.refinement import sensor_lags
from tactilenlp.refinement.sensor_lags import Lag, estimate_lags, lost_by_latency

LATE, CURVATURE = 0.03, 1e6  # [s] the true lag; [nats/s^2] of the objective
PROMPT = Precision(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Job:
    precision: Precision = PROMPT
    deadline: Deadline = NEVER

    def as_late_as(self, precision):
        return replace(self, precision=precision)

    def fixes(self, name):
        return name == "prompt"


@dataclass(frozen=True, eq=False)
class Solve:
    """A solve whose objective is CURVATURE (latency - late)^2 / 2."""

    job: Job
    late: float = LATE
    solution: ClassVar = SimpleNamespace(success=True)
    problem: ClassVar = SimpleNamespace(costs={"touch": None})

    @property
    def cost(self):
        return CURVATURE * (self.job.precision.latency - self.late) ** 2 / 2

    rank = cost

    @property
    def linearised(self):
        return self


def newton(at):
    """Return what the derivatives of the objective tell of a further lag."""
    mean = np.array([at.late - at.job.precision.latency])
    return ConsiderParameter(np.zeros((1, 1)), mean, np.array([[CURVATURE]]), odds=1.0)


@pytest.fixture
def _quadratic(monkeypatch):
    stand_ins = {
        "LAGS": {"sensors": Lag("latency", LATENCY, newton)},
        "warm_started": lambda job, past: replace(past, job=job),
        "misfit_of": lambda solved: Misfit(100.0, 0.0, 1.0),
        "close_to_best": lambda solves: [],
    }
    for name, value in stand_ins.items():
        monkeypatch.setattr(sensor_lags, name, value)


@pytest.mark.usefixtures("_quadratic")
def test_newton_steps_find_the_lag_of_a_quadratic_objective():
    (best,) = estimate_lags([Solve(Job())])
    assert best.job.precision.latency == pytest.approx(LATE)
    error = np.sqrt(newton(best).squared[0, 0])
    assert best.job.precision.latency_error == pytest.approx(error)


@pytest.mark.usefixtures("_quadratic")
def test_a_lag_that_gains_less_than_its_occam_factor_is_not_estimated():
    """2.5 ms gain 3.1 nats; needed are log(0.02 s * 1000 / s) = 3.0, and a spread."""
    prompt = [Solve(Job(), late=2.5e-3)]
    assert estimate_lags(prompt) is prompt


@pytest.mark.usefixtures("_quadratic")
def test_no_lag_is_estimated_after_the_deadline():
    late = [Solve(Job(deadline=Deadline.within(60.0).until(0.0)))]
    assert estimate_lags(late) is late
    assert late[0].job.deadline.omitted == ["latency"]


@pytest.mark.parametrize(
    ("latency", "verdict", "again"),
    [(LATE, "poor", True), (LATE, "good", False), (0.0, "poor", False)],
)
def test_a_body_is_searched_again_where_a_lag_was_found_and_the_fit_is_poor(
    latency, verdict, again
):
    search = SimpleNamespace(hypothesis=None)
    job = SimpleNamespace(precision=PROMPT, search=search)
    found = SimpleNamespace(precision=replace(PROMPT, latency=latency))
    best = SimpleNamespace(job=found, fit=SimpleNamespace(verdict=verdict))
    assert lost_by_latency(job, best) == again
