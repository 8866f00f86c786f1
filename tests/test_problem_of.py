"""From measurements and a page to the programme, in one call."""

from dataclasses import replace

import pytest

from formulations import quasi_static
from tactilenlp import problem_of
from tactilenlp.errors import NoContactError, OptionError


def test_the_programme_of_a_page_is_the_one_that_was_solved(recorded, estimate):
    scene = recorded[1]
    problem = problem_of(estimate.measurements, scene, at=estimate)
    x = problem.pack(estimate.unknowns)
    costs = {
        name: problem.value(name, x, problem.data()).sum() for name in problem.costs
    }
    assert sum(costs.values()) == pytest.approx(estimate.objective, abs=1e-6)
    assert {k: v for k, v in costs.items() if abs(v) > 1e-9} == pytest.approx(
        {k: v for k, v in estimate.costs.items() if abs(v) > 1e-9}, abs=1e-6
    )


def test_an_estimate_of_other_measurements_is_refused(recorded, estimate):
    data, scene, _ = recorded
    with pytest.raises(OptionError, match="other measurements"):
        problem_of(data.select([0]), scene, at=estimate)


def test_it_describes_and_checks_itself(recorded, interpreted):
    data, scene, _ = recorded
    problem = problem_of(data.select([0]), scene, quasi_static)
    assert "theta" in str(problem.describe())
    assert problem.check().assembled < 1e-5


def test_limits_of_rows_stand_in_the_description(recorded, interpreted):
    data, scene, _ = recorded
    lines = problem_of(data.select([0]), scene).describe().splitlines()
    (finger,) = [line for line in lines if line.startswith("  finger  ")]
    assert "bounds 0 .. inf, -inf .. inf, -inf .. inf, scale" in finger
    (cone,) = [line for line in lines if line.startswith("  finger cone  ")]
    assert cone.endswith("within 0 .. inf")


def test_a_hull_needs_an_estimate_to_be_built_at(recorded):
    data, scene, _ = recorded
    with pytest.raises(OptionError, match="at"):
        problem_of(data, scene, shape="polytope")


def test_what_cannot_be_solved_is_refused_alike(recorded):
    data, scene, _ = recorded
    free = replace(data, contact=0 * data.contact, normal=0 * data.normal)
    with pytest.raises(NoContactError):
        problem_of(free, scene)
