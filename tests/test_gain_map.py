"""Maps of the expected information gain."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import ExpectedInformation, choose_action, plot_gain
from tactilenlp.errors import OptionError
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


def test_a_shape_of_ones_own_is_drawn_if_it_is_given(estimate, monkeypatch):
    monkeypatch.setattr(gain_map, "DIRECTIONS", (3, 2))
    choice, own = choose_action(estimate, budget=20), replace(CUBOID, name="own box")
    mine = replace(estimate, shape="own box")
    with pytest.raises(OptionError, match="unknown shape"):
        plot_gain(mine, choice)
    drawn = plot_gain(mine, choice, shape=own).axes[0].get_title()
    assert drawn == plot_gain(estimate, choice).axes[0].get_title()
    with pytest.raises(OptionError, match=r"shape.*expected cuboid.*got own box"):
        plot_gain(estimate, choice, shape=own)


def test_a_gain_of_another_measure_is_told_beside_that_of_the_map(
    estimate, monkeypatch
):
    monkeypatch.setattr(gain_map, "DIRECTIONS", (3, 2))
    choice = choose_action(estimate, budget=20, prior_only=True)
    gain = ExpectedInformation(estimate).gain(choice.action)
    assert choice.gain > 1.1 * gain  # measurements so far leave less to gain
    figure = plot_gain(estimate, choice)
    words = f"{choice.gain:.1f} nats in its search, {gain:.1f} nats on this map"
    assert figure.axes[0].get_title() == f"Chosen: {words}"
    (area, *_) = figure.axes[0].collections
    assert gain <= area.norm.vmax < choice.gain  # colours are those of the map alone
    ours = choose_action(estimate, budget=20)
    title = plot_gain(estimate, ours).axes[0].get_title()
    assert title == f"Chosen: {ours.gain:.1f} nats"
