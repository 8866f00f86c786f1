"""The potential of a flow on a disc."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason='needs the extra: pip install "tactilenlp[optical]"')

from hardware.errors import FrameError
from hardware.hodge import Hodge


def disc(n=41):
    off = np.indices((n, n)) - (n - 1) / 2
    return (off**2).sum(axis=0) <= (n / 2) ** 2


def field(make):
    y, x = np.indices((41, 41)) - 20.0
    return np.stack(make(x, y), axis=-1)


def bump(x, y, s=5.0):
    return np.exp(-(x**2 + y**2) / (2 * s * s))


@pytest.mark.parametrize(
    "make",
    [
        lambda x, y: (-y * bump(x, y), x * bump(x, y)),  # a swirl
        lambda x, y: (np.ones_like(x), 2 * np.ones_like(x)),  # a common motion
    ],
)
def test_a_flow_without_divergence_has_no_potential(make):
    hodge = Hodge(disc())
    spread = hodge.potential(field(lambda x, y: (x * bump(x, y), y * bump(x, y))))
    # The steps of the rim on the grid cut the swirl: 0.16 % remain.
    assert np.ptp(hodge.potential(field(make))) < 3e-3 * np.ptp(spread)


def test_the_potential_of_a_gradient_is_what_it_was_up_to_a_constant():
    h = 3.0
    y, x = h * (np.indices((41, 41)) - 20.0)
    psi = bump(x - 30, y + 21, 12.0)  # cut by the rim, which must not bend it
    flow = np.stack([np.gradient(psi, h, axis=1), np.gradient(psi, h, axis=0)], -1)
    mask = disc()
    sheared = flow + np.array([0.7, -0.3])
    found = Hodge(mask, h).potential(sheared)
    off = (found - psi)[mask]
    assert np.ptp(off) < 0.1  # central differences of a bump four nodes wide
    assert np.median(found[mask]) == pytest.approx(0.0, abs=1e-12)
    peak = np.unravel_index(np.where(mask, found, -1).argmax(), mask.shape)
    assert np.abs(np.subtract(peak, (13, 30))).max() <= 1


def test_a_mask_without_inside_is_refused():
    with pytest.raises(FrameError, match="three nodes wide"):
        Hodge(np.eye(5, dtype=bool))
    with pytest.raises(FrameError, match="wrong shape"):
        Hodge(disc()).potential(np.zeros((40, 41, 2)))
