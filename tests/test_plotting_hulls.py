"""Pictures of a polytope show its faces, their bands and its truth."""

import numpy as np
import pytest
from programmes import octahedron
from test_plotting import BAND, MM, PLOTS, labelled

from tactilenlp import solve_estimate
from tactilenlp.plotting.faces import faces_at
from tactilenlp.plotting.scene import plot_top


@pytest.fixture(scope="module")
def hull():
    """A polytope after two actions: least motion is enough for a picture."""
    data, scene, _ = octahedron(2)
    how = {"shape": "polytope", "formulation": "quasi_static", "throw": False}
    return solve_estimate(data, scene, **how)


@pytest.mark.slow
@pytest.mark.parametrize("plot", PLOTS)
def test_a_polytope_is_drawn_as_well(plot, hull):
    figure = plot(hull)  # warnings are errors in all tests
    figure.canvas.draw()
    ink = np.asarray(figure.canvas.buffer_rgba())[..., :3].min(axis=2) < 250
    assert ink.mean() > 0.005
    for sample in (0, -1):
        faces, band = faces_at(hull, sample)
        corners = np.concatenate([*(face.corners for face in faces), *band])
        assert np.isfinite(corners).all()


def test_the_band_of_a_polytope_lies_about_its_outline(hull):
    axis = plot_top(hull).axes[0]
    (band,) = labelled(axis, BAND)
    reach = np.ptp(hull.mesh().vertices[:, :2], axis=0) * MM
    assert (np.ptp(band.get_xy(), axis=0) > reach).all()
    assert labelled(axis, "face touched")
    assert labelled(axis, "face not touched")  # two actions do not meet them all


def test_the_truth_of_a_polytope_are_its_vertices(hull):
    truth = {"position": hull.position, "quaternion": hull.quaternion}
    axis = plot_top(hull, truth=truth | {"vertices": hull.vertices}).axes[0]
    (line,) = labelled(axis, "truth")
    reach = np.ptp(hull.mesh().vertices[:, :2], axis=0) * MM
    assert np.ptp(line.get_xydata(), axis=0) == pytest.approx(reach)
