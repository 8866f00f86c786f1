"""What an object may do between actions, while nothing is recorded."""

import numpy as np
import pytest
from programmes import programme, sums, true_values
from scipy.integrate import trapezoid

from formulations import between_actions, quasi_static, violation_implicit


def test_what_an_object_may_do_between_actions_is_a_density(two_actions):
    data, scene, truth = two_actions
    problem, window = programme(quasi_static, data, scene)
    values = true_values(problem, window, truth)
    link = window.gap.pose[0]
    r, price = np.geomspace(1e-6, 1.0, 200), []
    for way in r:  # [m] of x, y and a turn: spheres of 4 pi r^2
        x = values["x"].copy()
        x[0, link:] += way - (x[0, link] - x[0, window.gap.before[0]])
        price.append(sums(problem, values | {"x": x})["between actions"])
    mass = 4 * np.pi * np.exp(-np.array(price) + price[0]) * r**2
    near = r < 0.1
    assert trapezoid(mass[near], r[near]) > 0.98 * trapezoid(mass, r)


def test_an_object_that_is_still_pushed_stops_or_goes_another_step_on(two_actions):
    data, scene, truth = two_actions
    problem, window = programme(violation_implicit, data, scene)
    gap, x = window.gap, true_values(problem, window, truth)["x"]
    place, last, early = gap.pose[0], gap.before[0], gap.before_2[0]
    assert early == last - 1
    speed, jump = 0.1, 4e-3  # [m/s], [m]
    coast = speed**2 / (2 * scene.friction_ground * scene.gravity)
    assert coast > between_actions.GAP

    def price(speed, jump):
        moved = x.copy()
        moved[:, early] = moved[:, last] - [speed * gap.dt[0], 0, 0]
        moved[:, place] = moved[:, last] + [jump, 0, 0]
        values = {"theta": truth["side_lengths"], "x": moved}
        return sums(problem, values)["between actions"]

    def cauchy(way, more):
        """Return the price of a way [m] in a density that is wider by more [m]."""
        width = np.hypot(between_actions.GAP, more)
        norm = 3 * np.log(width / between_actions.GAP)
        return norm + 2 * np.log1p((way / width) ** 2)

    assert price(0, 0) == pytest.approx(0, abs=1e-12)
    assert price(0, jump) == pytest.approx(cauchy(jump, 0))
    step = speed * gap.dt[0]
    for jump in (-step, 0.0, coast, step, 1.2 * step):
        stops = cauchy(jump, coast)
        goes_on = cauchy(jump - step, between_actions.PUSHED_ON * step)
        either = -np.logaddexp(-stops, -goes_on) + np.log(2)
        assert price(speed, jump) == pytest.approx(either)
    assert price(speed, step) < price(speed, -step)
