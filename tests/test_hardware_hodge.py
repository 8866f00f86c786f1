"""A flow on a disc and its three parts."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason='needs the extra: pip install "tactilenlp[optical]"')

from hardware.errors import (
    FrameError,
)
from hardware.hodge import Hodge


def disc(n=41):
    off = np.indices((n, n)) - (n - 1) / 2
    return (off**2).sum(axis=0) <= (n / 2) ** 2


def test_the_three_parts_add_up_and_are_orthogonal():
    hodge = Hodge(disc(), spacing=3.0)
    flow = np.random.default_rng(0).normal(size=(41, 41, 2))
    parts = hodge.decompose(flow)
    edges = []  # the mean along each edge between two nodes of the disc
    for axis, across in ((1, 0), (0, 1)):
        part, inside = (
            np.moveaxis(flow[..., across], axis, 0),
            np.moveaxis(disc(), axis, 0),
        )
        both = inside[1:] & inside[:-1]
        edges.append(((part[1:] + part[:-1]) / 2)[both])
    edge = np.concatenate(edges)
    # energies add up only if the parts are orthogonal
    assert sum(parts.energy.values()) == pytest.approx(edge @ edge, rel=1e-10)
    assert list(parts.energy) == ["irrotational", "solenoidal", "harmonic"]
    assert min(parts.energy.values()) > 0


def field(make):
    y, x = np.indices((41, 41)) - 20.0
    return np.stack(make(x, y), axis=-1)


def bump(x, y, s=5.0):
    return np.exp(-(x**2 + y**2) / (2 * s * s))


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("irrotational", lambda x, y: (x * bump(x, y), y * bump(x, y))),
        ("solenoidal", lambda x, y: (-y * bump(x, y), x * bump(x, y))),
        ("harmonic", lambda x, y: (np.ones_like(x), 2 * np.ones_like(x))),
        ("harmonic", lambda x, y: (x, -y)),  # a pure shear neither spreads nor swirls
    ],
)
def test_a_pure_flow_lands_in_its_own_part(name, make):
    flow = field(make)
    parts = Hodge(disc()).decompose(flow)
    total = sum(parts.energy.values())
    assert parts.energy[name] > 0.999 * total
    # the parts are shown at nodes; edges are means of two nodes, hence a blur
    inside = Hodge(disc(31)).mask
    off = np.abs(getattr(parts, name) - flow)[5:-5, 5:-5][inside]
    assert off.max() < 0.06 * np.abs(flow).max()


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
        Hodge(disc()).decompose(np.zeros((40, 41, 2)))
