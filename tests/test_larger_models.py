"""Larger models: what they gain, told without a solve; with what they compete."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formulations.shape import CUBOID
from tactilenlp import Session, solve_estimate
from tactilenlp.estimation import optima
from tactilenlp.interface.request import read_request
from tactilenlp.local.levels import FREED_MU
from tactilenlp.local.local_solve import solved_from, warm_started
from tactilenlp.refinement.nested_models import NUISANCES, score, wald

TURNED = 0.01  # [rad] of the normals of one finger


def test_statistics_tell_what_turned_sensors_gain(touched):
    """Rao's from the smaller model, Wald's from the larger one: a quadratic matter."""
    data, scene = touched.measurements, touched.scene
    turned = Rotation.from_rotvec([0, 0, TURNED]).apply(data.normal[:, 0].copy())
    data = replace(data, normal=np.stack([turned, data.normal[:, 1]], axis=1))
    given = data, scene, CUBOID, "violation_implicit", None, None, None
    job = read_request(*given, Session())[0].job
    solved, unknown = solved_from(job, touched.origin), NUISANCES["aligned"].unknown
    larger = job.with_reductions(aligned=False)
    free = warm_started(larger, solved, FREED_MU)
    gain = solved.solution.objective - free.solution.objective
    assert gain > 0.1
    assert score(larger, solved, unknown) == pytest.approx(gain, rel=0.05)
    assert wald(free, unknown) == pytest.approx(gain, rel=0.05)


def test_a_compliance_that_rigid_fingertips_leave_may_be_zero(touched):
    given = touched.measurements, touched.scene, CUBOID, "violation_implicit"
    job = read_request(*given, None, None, None, Session())[0].job
    soft = job.with_reductions(rigid=False)
    free = warm_started(soft, solved_from(job, touched.origin), FREED_MU)
    assert free.solution.values["compliance"][0, 0] < 1e-5  # of 5e-3 m in its prior
    assert wald(free, "compliance") < 0.01


@pytest.mark.slow
def test_each_model_begins_with_no_solves_of_another(recorded, monkeypatch):
    solve, begun = optima.solve_from_hypotheses, []

    def spied(job, kept, solves, *more):
        begun.append((job.reductions.rigid, len(solves.best_first())))
        return solve(job, kept, solves, *more)

    monkeypatch.setattr(optima, "solve_from_hypotheses", spied)
    data, scene, _ = recorded
    wrong = data.finger_radius + np.array([1e-3, 0.0])  # touches cost 200 nats more
    found = solve_estimate(replace(data, finger_radius=wrong), scene)
    assert found.compliance is not None
    assert {rigid for rigid, _ in begun} == {True, False}
    assert not any(count for _, count in begun)
