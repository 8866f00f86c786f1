"""Solves of a larger model compete with each other, not with those of a smaller one."""

from dataclasses import replace

import numpy as np
import pytest

from tactilenlp import solve_estimate
from tactilenlp.estimation import optima


@pytest.mark.slow
def test_each_model_begins_with_no_solves_of_another(recorded, monkeypatch):
    refined, begun = optima.refined, []

    def spied(job, kept, solved, *more):
        begun.append((job.reductions.rigid, len(solved)))
        return refined(job, kept, solved, *more)

    monkeypatch.setattr(optima, "refined", spied)
    data, scene, _ = recorded
    wrong = data.finger_radius + np.array([1e-3, 0.0])  # touches cost 200 nats more
    found = solve_estimate(replace(data, finger_radius=wrong), scene)
    assert found.compliance is not None
    assert {rigid for rigid, _ in begun} == {True, False}
    assert not any(count for _, count in begun)
