"""A film shows every sample that is asked for, or says why it cannot be made."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from tactilenlp.errors import OptionError
from tactilenlp.plotting.animation import animate


@pytest.mark.slow
@pytest.mark.parametrize("view", ["scene", "top"])
def test_a_film_has_a_frame_for_every_sample_asked_for(touched, truth, tmp_path, view):
    from PIL import Image

    path = tmp_path / "film.gif"
    figure = animate(touched, path, view=view, truth=truth, every=20)
    assert isinstance(figure, Figure)
    (key,) = figure.legends  # of all frames one
    words = [text.get_text() for text in key.get_texts()]
    assert len({*words}) == len(words)
    assert {"truth", "face touched", "finger 0 and its contacts"} <= {*words}
    with Image.open(path) as film:
        assert film.n_frames == -(-touched.measurements.samples // 20)
        first = np.asarray(film.convert("RGB"), int)
        film.seek(film.n_frames - 1)
        assert (first != np.asarray(film.convert("RGB"), int)).sum() > 1000


@pytest.mark.parametrize(
    ("name", "change", "word"),
    [
        ("film.avi", {}, "gif"),
        ("film.gif", {"view": "below"}, "view"),
        ("film.gif", {"every": 0}, "every.*got 0"),
    ],
)
def test_a_film_that_cannot_be_made_is_refused(touched, tmp_path, name, change, word):
    with pytest.raises(OptionError, match=word):
        animate(touched, tmp_path / name, **change)
    assert not any(tmp_path.iterdir())


def test_without_ffmpeg_an_mp4_is_refused_with_a_way_out(touched, tmp_path):
    from matplotlib.animation import FFMpegWriter

    if FFMpegWriter.isAvailable():
        animate(touched, tmp_path / "film.mp4", every=20)
        assert (tmp_path / "film.mp4").stat().st_size > 1000
    else:
        with pytest.raises(OptionError, match="ffmpeg"):
            animate(touched, tmp_path / "film.mp4")


def test_a_film_is_drawn_into_an_axis_that_is_given(touched, tmp_path):
    figure, axis = plt.subplots()
    some = {"view": "top", "every": np.int64(40)}  # as a whole number of any kind
    film = animate(touched, tmp_path / "film.gif", **some, axis=axis)
    assert film is figure
    assert not figure.legends  # room for it is the caller's
    assert axis.has_data()
