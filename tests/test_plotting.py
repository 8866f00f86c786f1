"""Pictures show what the estimate says, in millimetres, and nothing that is NaN."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from trimesh.creation import icosphere

from tactilenlp import Ground, TrueBody
from tactilenlp.errors import OptionError
from tactilenlp.geometry.faces import face_sigma, polygons
from tactilenlp.plotting.charts import (
    plot_cones,
    plot_costs,
    plot_impulses,
    plot_progress,
)
from tactilenlp.plotting.scene import (
    plot_estimate,
    plot_information,
    plot_scene,
    plot_top,
)

MM = 1e3  # [mm / m]
NUMBERS = (plot_impulses, plot_costs, plot_cones, plot_progress)
PLOTS = (plot_scene, plot_top, plot_estimate, plot_information, *NUMBERS)
SOLID = (plot_scene, plot_information)
BAND = "±1σ of each face"


def drawn(figure):
    """Return all the numbers that are on the paper."""
    figure.canvas.draw()
    for artist in figure.findobj():
        for name in ("get_xydata", "get_path", "get_paths", "get_offsets"):
            found = getattr(artist, name, lambda: [])()
            for part in found if isinstance(found, list | tuple) else [found]:
                yield np.asarray(getattr(part, "vertices", part), float)


def labelled(axis, label):
    """Return the artists of an axis that carry a label."""
    return [artist for artist in axis.get_children() if artist.get_label() == label]


def sides(estimate, sample, vertices):
    """Return how long points (n, 2) [mm] reach along body x and y (3,)."""
    along = np.asarray(vertices) @ estimate.rotation(sample)[:2]
    return np.ptp(along, axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("plot", PLOTS)
def test_a_figure_is_made_without_warnings_and_without_nan(plot, touched):
    figure = plot(touched)  # warnings are errors in all tests
    assert isinstance(figure, Figure)
    numbers = list(drawn(figure))
    assert numbers
    assert all(np.isfinite(part).all() for part in numbers)


@pytest.mark.parametrize("plot", PLOTS)
def test_every_axis_has_a_unit(plot, touched):
    for axis in plot(touched).axes:
        if axis.get_label() == "<colorbar>":
            assert axis.get_ylabel().endswith("[mm]")
            continue
        names = "xyz" if axis.name == "3d" else "xy"
        labels = {name: getattr(axis, f"get_{name}label")() for name in names}
        if plot is plot_costs:
            assert not labels.pop("y")  # names of terms
        if plot is plot_impulses:
            labels["x"] = axis.figure.axes[-1].get_xlabel()  # written once, below
        assert all("[" in label and "]" in label for label in labels.values()), labels


def test_lengths_are_in_millimetres_and_equally_scaled(touched):
    (top,) = plot_top(touched).axes
    assert top.get_aspect() == 1
    assert (top.get_xlabel(), top.get_ylabel()) == ("x [mm]", "y [mm]")
    (scene,) = plot_scene(touched).axes
    limits = scene.get_xlim(), scene.get_ylim(), scene.get_zlim()
    sizes = np.ptp(limits, axis=1)
    box = scene._box_aspect  # matplotlib has no public way to ask
    np.testing.assert_allclose(box / box[0], sizes / sizes[0])


@pytest.mark.parametrize("plot", [plot_scene, plot_top, plot_information, *NUMBERS])
def test_a_given_axis_is_drawn_into_and_no_other(plot, touched):
    figure = plt.figure()
    style = {"projection": "3d"} if plot in SOLID else {}
    axis, other = (figure.add_subplot(1, 2, k, **style) for k in (1, 2))
    assert plot(touched, axis=axis) is figure
    assert plt.get_fignums() == [figure.number]
    assert axis.has_data()
    assert not other.has_data()
    figure.canvas.draw()


def test_the_truth_may_be_a_true_body_of_any_class(touched):
    mesh = icosphere(radius=0.02)
    body = TrueBody(mesh, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    (line,) = labelled(plot_top(touched, truth=body).axes[0], "truth")
    np.testing.assert_allclose(np.ptp(line.get_xydata(), axis=0), 40.0, atol=0.1)


@pytest.mark.parametrize("sample", [0, 17, -1])
def test_the_truth_is_drawn_where_it_is(sample, touched, truth):
    axis = plot_top(touched, sample, truth).axes[0]
    (line,) = labelled(axis, "truth")
    corners = line.get_xydata()
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    np.testing.assert_allclose(centre, truth["position"][sample, :2] * MM, atol=1e-6)
    w, _, _, z = truth["quaternion"][sample]
    yaw = 2 * np.arctan2(z, w)
    along = corners @ [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    # The true object lies flat to better than a millirad: 0.05 mm over 50 mm.
    expected = truth["side_lengths"][:2] * MM
    np.testing.assert_allclose(np.ptp(along, axis=0), expected, atol=0.05)


def test_a_truth_may_be_an_object_or_one_pose(touched, truth):
    one = {key: value[-1] for key, value in truth.items()}
    one["side_lengths"] = truth["side_lengths"]
    lines = [
        labelled(plot_top(touched, truth=given).axes[0], "truth")[0].get_xydata()
        for given in (truth, one, SimpleNamespace(**truth))
    ]
    np.testing.assert_array_equal(lines[0], lines[1])
    np.testing.assert_array_equal(lines[0], lines[2])


def test_a_figure_of_everything_shows_first_and_last_sample(touched, truth):
    figure = plot_estimate(touched, truth)
    titles = [axis.get_title() for axis in figure.axes]
    assert titles[0].startswith("First sample: 0.3 s, action 0 (band")
    assert titles[1].startswith("Last sample: 3.1 s, action 1")
    side = f"{touched.side_lengths[0] * MM:.2f} ± "
    assert side in figure.get_suptitle()
    (key,) = figure.legends
    words = [text.get_text() for text in key.get_texts()]
    assert len(set(words)) == len(words)
    assert {"face touched", "face not touched", BAND, "truth"} < set(words)


def test_the_band_of_a_size_that_was_not_felt_is_one_sigma_of_it(touched):
    # Neither face of a side was touched: each moves by half of what the size is wrong.
    (side,) = np.nonzero(~touched.faces[:2].any(axis=1))[0]
    (band,) = labelled(plot_top(touched, sample=0).axes[0], BAND)
    wide = sides(touched, 0, band.get_xy())[side]
    sigma = touched.information.sigma("side_lengths")[side] * MM
    assert wide == pytest.approx(touched.side_lengths[side] * MM + sigma, rel=1e-6)


def test_the_band_at_the_last_sample_includes_the_error_of_the_pose(touched):
    # Errors of a side and of the position that keep a touched face in place cancel.
    (band,) = labelled(plot_top(touched).axes[0], BAND)
    wide = np.array(sides(touched, -1, band.get_xy()))[:2]
    sigma = touched.information.sigma("side_lengths") * MM
    held = touched.faces[:2].any(axis=1)
    size = touched.side_lengths[:2] * MM
    assert (wide > size + sigma[:2])[~held].all()
    assert (wide < size + 6 * sigma[:2])[held].all()


def test_nothing_known_is_drawn_as_a_band_as_wide_as_the_picture(touched):
    blank = replace(touched.information, covariance_matrix=np.diag([1e12] * 6))
    figure = plot_top(replace(touched, information=blank))
    assert all(np.isfinite(part).all() for part in drawn(figure))


def test_contacts_lie_on_the_surface(touched):
    axis = plot_top(touched).axes[0]
    R_wo, p_wo = touched.rotation(), touched.position[-1]
    for dots in axis.collections:
        points = np.asarray(dots.get_offsets()) / MM
        p_ow = (points - p_wo[:2]) @ R_wo[:2, :2]
        # Half a millimetre: residuals of the fit, which clean data keep far smaller.
        assert (abs(p_ow) <= touched.side_lengths[:2] / 2 + 5e-4).all()


@pytest.mark.slow
def test_fingers_are_drawn_where_they_were_not_where_they_say(touched, tmp_path):
    off = np.array([[1.5, -1.0, 0.5], [-2.0, 1.0, -0.5]]) * 1e-3
    data = touched.measurements
    said = replace(data, finger_position=data.finger_position - off)
    information = replace(touched.information, offsets=1e-6 * np.eye(6))
    same = replace(
        touched, measurements=said, finger_offset=off, information=information
    )
    assert np.allclose(same.seen_positions, data.finger_position, rtol=0, atol=1e-12)
    for plot in (plot_top, plot_scene, plot_impulses):
        for one, other in zip(drawn(plot(touched)), drawn(plot(same)), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6)
    for name, estimate in (("one.html", touched), ("other.html", same)):
        estimate.report(tmp_path / name)
    pages = [
        (tmp_path / name).read_text("utf-8") for name in ("one.html", "other.html")
    ]
    fingers = [page.split('"finger":')[1].split('"grid":')[0] for page in pages]
    assert fingers[0] == fingers[1]


def test_a_scene_without_ground_has_no_ground_and_a_tilted_one_is_tilted(touched):
    bare = plot_scene(replace(touched, scene=replace(touched.scene, ground=None)))
    tilted = Ground(normal=(0.0, 0.6, 0.8))
    tilted = plot_scene(replace(touched, scene=replace(touched.scene, ground=tilted)))
    assert len(bare.axes[0].collections) < len(tilted.axes[0].collections)
    assert bare.axes[0].get_zlim()[0] < 0


def test_a_well_known_face_is_red_and_says_how_well(touched):
    axis = plot_information(touched).axes[0]
    words = {text.get_text() for text in axis.texts}
    seen = [s for s in face_sigma(touched) if f"{s * MM:.2g}" in words]
    assert len(seen) + ("unknown" in words) >= 2
    assert len(polygons(touched.vertices)) == 6


def test_the_labels_of_faces_are_apart(touched):
    """Also the one of a face that is seen at a small angle."""
    figure = plot_information(touched)
    figure.canvas.draw()
    labels = [text.get_window_extent() for text in figure.axes[0].texts]
    assert len(labels) == 3
    for i, label in enumerate(labels):
        assert not any(label.overlaps(other) for other in labels[:i])


@pytest.mark.parametrize("plot", [plot_top, plot_estimate])
def test_a_fingertip_beside_the_object_is_drawn_whole_or_not_at_all(plot, touched):
    axes = [axis for axis in plot(touched).axes if not hasattr(axis, "zaxis")]
    for axis in axes:
        (x0, x1), (y0, y1) = axis.get_xlim(), axis.get_ylim()
        for tip in axis.patches:
            if not isinstance(tip, plt.Circle):
                continue
            (x, y), r = tip.center, tip.radius
            whole = x0 < x - r and x + r < x1 and y0 < y - r and y + r < y1
            absent = x + r < x0 or x - r > x1 or y + r < y0 or y - r > y1
            assert whole or absent


def test_an_axis_of_somebody_else_gets_our_letters_and_lines(touched):
    figure = plt.figure()  # not in our style
    axis = figure.add_subplot(projection="3d")
    plot_information(touched, axis)  # not by name either
    assert axis.xaxis.label.get_size() == axis.zaxis.label.get_size() == 8
    flat = figure.add_subplot()
    plot_top(touched, axis=flat)
    assert not flat.spines["top"].get_visible()


def test_four_axes_of_ones_own_are_drawn_into(touched):
    figure = plt.figure()
    axes = [figure.add_subplot(2, 2, k) for k in (1, 2)]
    axes += [figure.add_subplot(2, 2, k, projection="3d") for k in (3, 4)]
    assert plot_estimate(touched, axis=axes) is figure
    assert all(axis.has_data() for axis in axes)
    with pytest.raises(OptionError, match="expected 4 matplotlib Axes, got 1"):
        plot_estimate(touched, axis=axes[0])
    with pytest.raises(OptionError, match="expected 1 or 2 matplotlib Axes"):
        plot_impulses(touched, axis=axes)
    with pytest.raises(
        OptionError, match="no axes: expected matplotlib Axes, got a str"
    ):
        plot_top(touched, axis="x")
