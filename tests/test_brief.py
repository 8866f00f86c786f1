"""What is printed of a result."""

import html
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tactilenlp import Estimate, Exploration, problem_of
from tactilenlp.common.brief import COLUMNS, LINES, brief, same_content
from tactilenlp.exploration.log import Step
from tactilenlp.output.summary import untouched_in_words


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


def test_a_notebook_shows_summary_and_fields(estimate):
    shown = estimate._repr_html_()
    first = html.escape(estimate.summary().splitlines()[0])
    assert shown.startswith(f"<p>{first}<br>")
    assert "<tr><th>theta</th><td>[" in shown
    assert len(shown) < 10_000


def test_every_noun_prints_briefly_and_shows_in_a_notebook(estimate, recorded):
    data, scene, _ = recorded
    step = Step(0, None, data, estimate, None, "sweep", {"act": 0.1})
    found = [
        *(estimate, estimate.information, estimate.information.modes, estimate.origin),
        *(estimate.supporting_planes(), data, scene, step, Exploration((step,))),
        problem_of(data.select([0]), scene),
    ]
    for thing in found:
        lines = repr(thing).splitlines()
        assert 1 <= len(lines) <= LINES
        assert sum(map(len, lines)) <= LINES * COLUMNS
        assert thing._repr_html_().startswith("<p>")


def test_a_saved_estimate_is_equal_to_the_estimate(estimate, tmp_path):
    estimate.save(tmp_path / "estimate.npz")
    again = Estimate.load(tmp_path / "estimate.npz")
    assert again == estimate
    assert hash(again) == hash(estimate)
    assert again != replace(estimate, objective=np.nextafter(estimate.objective, 9))
    theta = estimate.theta.copy()
    theta[0] = np.nextafter(theta[0], 1)
    assert again != replace(estimate, theta=theta)
    assert again != "an estimate"
    step = Step(0, None, estimate.measurements, estimate, None, "sweep", {"act": 0.1})
    Exploration((step,)).save(tmp_path / "exploration.npz")
    loaded = Exploration.load(tmp_path / "exploration.npz")
    assert loaded == Exploration((step,))
    assert loaded != Exploration(())


@pytest.mark.parametrize(
    ("a", "b", "same"),
    [
        (np.array([np.nan, 1]), np.array([np.nan, 1]), True),
        (np.array([0.0, 1]), np.array([np.nan, 1]), False),
        (np.zeros(3), np.zeros((3, 1)), False),
        (np.array([0, 1]), np.array([False, True]), False),
        ((1.0, float("nan")), [1.0, float("nan")], True),
        ({"a": np.ones(2)}, {"a": np.ones(2)}, True),
        ({"a": 1}, {"b": 1}, False),
        (np.zeros(2), (0.0, 0.0), False),
        ("nan", float("nan"), False),
    ],
)
def test_content_is_compared_exactly(a, b, same):
    assert same_content(a, b) is same
    assert same_content(b, a) is same


def test_the_summary_begins_with_the_article_of_the_shape(touched):
    assert touched.summary().startswith("A cuboid of ")
    other = replace(touched, shape="ellipsoid")
    assert other.summary().startswith("An ellipsoid of ")


def test_the_summary_tells_in_which_last_actions_nothing_was_touched(estimate):
    data, last = estimate.measurements, estimate.measurements.action[-1]

    def until(action) -> list[str]:
        felt = data.contact & (data.action <= action)[:, None]
        normal = np.where(felt[..., None], data.normal, 0.0)
        return list(untouched_in_words(replace(data, contact=felt, normal=normal)))

    assert until(last) == []
    (sentence,) = until(last - 1)
    assert f"in action {last}: the last pose is that after action" in sentence
    (sentence,) = until(last - 2)
    assert f"in actions {last - 1} to {last}: " in sentence
