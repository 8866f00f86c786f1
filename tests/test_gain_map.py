"""Maps of the expected information gain."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from tactilenlp import choose_action, plot_gain
from tactilenlp.plotting import gain_map


def test_the_map_of_gains_marks_the_chosen_action(estimate, monkeypatch):
    monkeypatch.setattr(gain_map, "DIRECTIONS", (5, 3))
    choice = choose_action(estimate, budget=20)
    figure = plot_gain(estimate, choice)
    sphere = figure.axes[0]
    spots = [line for line in sphere.lines if line.get_marker() == "o"]
    declinations = [line.get_ydata()[0] for line in spots]
    assert declinations == pytest.approx(np.degrees(choice.action.angles[1::2]))
    drawn = np.concatenate([c.get_array().ravel() for c in sphere.collections])
    assert np.isfinite(drawn).all()
    assert (drawn >= 0).all()
    assert f"{choice.gain:.1f}" in sphere.get_title()
    assert "outside the workspace" in {text.get_text() for text in sphere.texts}


def test_the_map_is_drawn_into_one_axis_or_two(estimate, monkeypatch):
    monkeypatch.setattr(gain_map, "DIRECTIONS", (3, 2))
    choice = choose_action(estimate, budget=20)
    figure, axes = plt.subplots(1, 2)
    assert plot_gain(estimate, choice, axis=axes) is figure
    assert all(axis.has_data() for axis in axes)
    alone, axis = plt.subplots()
    assert plot_gain(estimate, choice, axis=axis) is alone
