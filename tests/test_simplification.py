"""Convex hulls with fewer vertices and fewer faces keep what touches need."""

import numpy as np

from tactilenlp.geometry.convex_hull import vertices_behind
from tactilenlp.geometry.simplification import (
    holds_origin,
    with_fewer_faces,
    without_touch,
)

CUBE = 0.02 * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T


def test_vertices_go_without_which_touches_stay_where_they_are():
    """Eight touched corners of a cube stay, of many points on its faces none."""
    rng = np.random.default_rng(5)
    on_faces = rng.uniform(-0.8, 0.8, (40, 3))
    axis = rng.integers(3, size=40)
    on_faces[np.arange(40), axis] = np.where(rng.random(40) < 0.5, -1.01, 1.01)
    fingers = CUBE * (1 + 5e-3 / 0.02)  # beyond the corners, along the diagonals
    left = without_touch(np.vstack([CUBE, 0.02 * on_faces]), fingers, 8)
    assert len(left) == 8
    assert np.linalg.norm(left[:, None] - CUBE, axis=2).min(axis=0).max() < 1e-12


def test_faces_that_cut_off_little_go_first():
    """An octahedron whose corners and edges are cut off has eight faces again."""
    octahedron = 0.03 * np.vstack([np.eye(3), -np.eye(3)])
    face = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T / np.sqrt(3)
    edge = np.array([[1, 1, 0], [1, 0, 1], [0, 1, -1]]) / np.sqrt(2)
    normals = np.vstack([face, edge, np.eye(3), -np.eye(3)])
    offsets = np.r_[np.full(8, 0.03 / 3**0.5), np.full(3, 0.0208), np.full(6, 0.0285)]
    cut = vertices_behind(np.c_[normals, offsets])
    assert len(cut) > 12
    *_, body = with_fewer_faces(cut, [12, 8])
    assert len(body) == 6
    apart = np.linalg.norm(body[:, None] - octahedron, axis=2)
    assert apart.min(axis=1).max() < 1e-9


def test_faces_that_close_no_body_end_the_list():
    assert len(with_fewer_faces(CUBE, [6, 5, 4])) == 1


def test_planes_that_hardly_meet_close_no_body():
    """Rounding once put a corner 6e13 m away: the origin 1e-15 inside of a facet."""
    facets = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])
    for depth in (0.0, 1e-15, 1e-3):
        assert not holds_origin(20 * facets - [0, 0, depth])
    assert holds_origin(20 * np.vstack([facets, [0, 0, -1.0]]))
