"""The page `paper` solved: it converges, or says so."""

import numpy as np
import pytest

from formulations import paper
from formulations.shape import CUBOID
from tactilenlp import solve_estimate
from tactilenlp.data.scene import Scene
from tactilenlp.data.sensor_noise import Precision
from tactilenlp.errors import NotConverged
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.reductions import Reductions, window_of_samples

SCENE = Scene()
W = SCENE.mass * 9.81 / 30  # [N s] the weight over a step
WEIGHT = {name: value for name, (value, _) in paper.WEIGHTS.items()}


@pytest.mark.slow
def test_two_actions_end_converged_or_in_the_typed_error(recorded):
    data, scene = recorded[0].select([0, 1]), recorded[1]
    try:
        estimate = solve_estimate(data, scene, formulation=paper)
    except NotConverged:
        estimate = solve_estimate(data, scene, formulation=paper, throw=False)
        assert not estimate.success
    else:
        assert estimate.success
        assert max(estimate.violations.values()) < 1e-6
    assert estimate.formulation == "paper"
    # The dynamics are a cost: 0.3 mm of 10.9 mm, g dt^2, is 0.03 weights a deviation.
    w = scene.mass * 9.81 * data.dt
    total = sum(impulse[:, 2] for impulse in estimate.impulses.values()) / w
    moved = np.abs(estimate.impulses["ground"]).any(axis=1)
    np.testing.assert_allclose(total[moved], 1.0, atol=0.1)


@pytest.mark.slow
def test_without_ground_or_gravity_the_page_has_neither(recorded):
    data, scene, _ = recorded
    loose = Scene(scene.mass, ground=None, gravity=0.0, friction_finger=None)
    window = window_of_samples(
        data, loose, CUBOID, Precision(0, 0), Reductions(planar=False)
    )
    problem = Problem()
    paper.build(problem, window, loose, CUBOID)
    assert not [name for name in problem.terms if name.startswith("ground d")]
    assert "finger friction" in problem.variables
