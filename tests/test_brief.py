"""What is printed of a result."""

from dataclasses import dataclass

import numpy as np

from tactilenlp.common.brief import COLUMNS, LINES, brief


@dataclass(frozen=True)
class Many:
    """A result of many fields."""

    sizes: np.ndarray
    path: np.ndarray
    cost: float
    costs: dict


def test_arrays_are_printed_by_shape_and_numbers_as_they_are():
    text = brief(Many(np.array([0.5, 0.25, 1]), np.zeros((9, 3)), 0.125, {"a": 1.0}))
    assert text == (
        "Many(sizes=[0.5  0.25 1.  ], path=array(9,3), cost=0.125, costs=1 entry)"
    )


def test_an_estimate_is_printed_in_eight_lines(estimate):
    lines = repr(estimate).splitlines()
    assert 1 < len(lines) <= LINES
    assert max(map(len, lines)) <= COLUMNS
    assert lines[0].startswith("Estimate(measurements=Measurements, ")
    assert "objective=" in repr(estimate)
