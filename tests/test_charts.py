"""Charts of an estimate show its objective, impulses and errors."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from tactilenlp.errors import OptionError
from tactilenlp.plotting.charts import (
    plot_cones,
    plot_costs,
    plot_errors,
    plot_impulses,
    plot_progress,
)

MM = 1e3  # [mm / m]


def labelled(axis, label):
    """Return the artists of an axis that carry a label."""
    return [artist for artist in axis.get_children() if artist.get_label() == label]


def errors_alone(estimate, axis):
    return plot_errors([estimate], axis=axis)


@pytest.mark.parametrize("plot", [plot_costs, plot_cones, plot_progress, errors_alone])
def test_a_chart_of_one_axis_takes_it_alone_or_in_a_list_and_no_other_number(
    touched, plot
):
    axes = plt.figure().subplots(1, 2)
    assert plot(touched, axis=[axes[0]]) is axes[0].figure
    for wrong in (axes, [*axes], "x"):
        with pytest.raises(OptionError, match="matplotlib Axes"):
            plot(touched, axis=wrong)


def test_each_finger_gets_the_axis_given_for_it(touched):
    axes = plt.figure().subplots(touched.measurements.fingers)
    plot_impulses(touched, axis=axes)
    words = [axis.get_ylabel() for axis in axes]
    assert words == [f"finger {k} [mN s]" for k in range(len(axes))]


def test_parts_of_an_impulse_add_up_to_it(touched):
    data = touched.measurements
    figure = plot_impulses(touched)
    shown = data.contact.any(axis=1)
    for finger, axis in enumerate(figure.axes):
        normal = np.array([bar.get_height() for bar in axis.patches])
        (dots,) = labelled(axis, "tangential")
        total = np.linalg.norm(touched.impulses[f"finger {finger}"][shown], axis=1) * MM
        np.testing.assert_allclose(np.hypot(normal, dots.get_ydata()), total, atol=1e-9)
        assert (normal >= -1e-6).all()  # a finger pushes, it does not pull


def test_an_unknown_friction_is_read_from_the_estimate(touched):
    scene = replace(touched.scene, friction_finger=None)
    unknowns = touched.unknowns | {"finger friction": np.array([[0.37]])}
    axis = plot_impulses(replace(touched, scene=scene, unknowns=unknowns)).axes[0]
    assert labelled(axis, "friction cone: 0.37 × normal")


def test_costs_add_up_to_the_objective(touched):
    bars = plot_costs(touched).axes[0].patches
    total = sum(bar.get_width() for bar in bars)
    assert total == pytest.approx(touched.objective, rel=1e-9)


def test_no_cost_of_a_body_that_slides_is_negative(touched):
    assert min(touched.costs.values()) > -1e-6
    assert touched.costs["ground dissipation"] < 1  # nats, 96 corner samples: it holds


def test_impulses_lie_in_their_cone_and_none_is_lost(touched):
    (axis,) = plot_cones(touched).axes
    points = [np.asarray(dots.get_offsets()) for dots in axis.collections[:2]]
    normal, tangential = np.concatenate(points).T
    mu = touched.scene.friction_finger
    # The cone's apex is rounded over 0.003 weights of 0.5 kg in 1/30 s.
    assert (tangential <= mu * normal + 0.003 * 0.5 * 9.81 / 30 * MM).all()
    data = touched.measurements
    shown = data.contact.any(axis=1)
    pushes = [touched.impulses[f"finger {k}"][shown] for k in range(data.fingers)]
    largest = np.linalg.norm(np.concatenate(pushes), axis=1).max() * MM
    assert np.hypot(normal, tangential).max() == pytest.approx(largest)


def test_progress_ends_at_the_solution_and_has_every_iteration(touched):
    progress = touched.progress
    # IPOPT also says where it starts: one line more than iterations, in each level.
    levels = len(touched.iterations_by_level)
    assert len(progress["level"]) == touched.iterations + levels
    assert progress["objective"][-1] == pytest.approx(touched.objective, abs=1e-3)
    assert progress["dual"][-1] < 1e-4
    assert (progress["barrier"] > 0).all()
    with pytest.raises(OptionError, match="no iteration"):
        plot_progress(replace(touched, progress={}))


def test_errors_and_sigma_shrink_with_actions(touched, estimate, truth):
    (axis,) = plot_errors([touched, estimate], truth).axes
    lines = {line.get_label(): line.get_xydata() for line in axis.lines}
    np.testing.assert_array_equal(lines["side x: predicted ±1σ"][:, 0], [2, 3])
    sigma = estimate.information.sigma("side_lengths") * MM
    for k, name in enumerate("xyz"):
        predicted = lines[f"side {name}: predicted ±1σ"]
        assert predicted[1, 1] == pytest.approx(sigma[k])
        assert predicted[1, 1] < 1.05 * predicted[0, 1]
        assert (lines[f"side {name}: error"][:, 1] < 4 * predicted[:, 1]).all()
    assert len(plot_errors([touched]).axes[0].lines) == 3
    with pytest.raises(OptionError, match="nothing to draw"):
        plot_errors([])


@pytest.mark.parametrize("plot", [plot_impulses, plot_cones])
def test_no_cone_is_drawn_where_friction_is_not_known(plot, touched):
    scene = replace(touched.scene, friction_finger=None)
    unknowns = {k: v for k, v in touched.unknowns.items() if k != "finger friction"}
    axis = plot(replace(touched, scene=scene, unknowns=unknowns)).axes[0]
    words = [text.get_text() for text in axis.get_legend().get_texts()]
    assert not any("cone" in word for word in words)
