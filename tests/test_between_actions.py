"""Between actions an object stays, or slides on as far as friction lets it."""

from types import SimpleNamespace

import numpy as np
import pytest

from formulations import quasi_static
from formulations.rigid_body import PLANAR
from formulations.shape import CUBOID
from tactilenlp.nlp import Problem
from tactilenlp.window import Steps

BRAKING, DT = 0.3 * 9.81, 1 / 30  # [m/s^2], [s]


def price(speed, way):
    """Return the nats of a way [m] along x after a last step at a speed [m/s]."""
    one = np.ones(1, int)
    gap = Steps(one, 2 * one, one, 0 * one, DT * np.ones(1))
    window = SimpleNamespace(motion=PLANAR, gap=gap, braking=BRAKING)
    problem = Problem()
    theta = problem.variable("theta", 3, guess=0.05, unit="m", scale=1e-3)
    x = problem.variable("x", 3, 3, guess=0.0, unit="m, m, rad", scale=PLANAR.scale)
    quasi_static.between_actions(problem, window, CUBOID, theta, x)
    path = np.zeros((3, 3))
    path[0] = 0, speed * DT, speed * DT + way
    (cost,) = problem.value("between actions", problem.pack({"x": path}),
                            problem.data()).ravel()  # fmt: skip
    return cost


def test_an_object_at_rest_is_expected_to_stay():
    ways = np.array([-2e-3, 0.0, 2e-3])
    costs = [price(0.0, way) for way in ways]
    assert costs == pytest.approx(np.log1p((ways / quasi_static.GAP) ** 2), abs=1e-9)


@pytest.mark.parametrize("speed", [0.1, -0.2])
def test_an_object_that_still_moves_slides_until_friction_stops_it(speed):
    stop = speed * abs(speed) / (2 * BRAKING)
    assert price(speed, stop) < 1e-3  # rounded where the object hardly moves
    assert price(speed, 0.0) > 1 < price(speed, 2 * stop)
