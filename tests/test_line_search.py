"""The line search: how long a step is, and which point a filter takes."""

import numpy as np
import pytest

from tactilenlp.solvers.line_search import Filter, Point, Stuck, longest_step


def test_a_step_keeps_a_share_of_each_distance():
    distances = np.array([1.0, 2.0]), np.array([4.0])
    steps = np.array([3.0, -8.0]), np.array([-1.0])
    assert longest_step(distances, steps, 0.99) == pytest.approx(0.99 / 4)
    assert longest_step(distances, [abs(one) for one in steps], 0.99) == 1.0
    assert longest_step(distances, [-1e-310 * abs(s) for s in steps], 0.99) == 1.0
    assert longest_step([np.zeros(0)], [np.zeros(0)], 0.99) == 1.0


def point(w: float, f: float, g: float) -> Point:
    none = np.zeros(0)
    return Point(np.array([w, 0.0]), f, np.zeros(1), np.array([g]), none, none, none)


def test_a_filter_takes_less_violation_or_a_lower_objective():
    def line(f, g):
        return lambda w: point(w[0], f(w[0]), g(w[0]))

    begin, way = point(0.0, 1.0, 1.0), np.array([1.0, 0.0])
    filter = Filter(1.0)
    better = line(lambda x: 1 + x, lambda x: 1 - x)  # less violation, higher objective
    alpha, found = filter.first_accepted(begin, way, 1.0, 1.0, 0.0, better)
    assert (alpha, found.violation) == (1.0, 0.0)
    worse = line(lambda x: 1 + x, lambda x: 1 + x)
    with pytest.raises(Stuck):
        filter.first_accepted(begin, way, 1.0, 1.0, 0.0, worse)
    holes = line(lambda x: np.nan if x > 0.3 else 1 - x, lambda x: 1.0)
    alpha, _ = filter.first_accepted(begin, way, -1.0, 1.0, 0.0, holes)
    assert alpha == 0.25  # where there are no numbers, the step is halved
