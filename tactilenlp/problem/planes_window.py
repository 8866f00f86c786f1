"""The window of the page `polytope_planes`: touches, planes, and pairs of these.

Of each pair the page adds a term: a contact point lies behind the planes of all other
touches, and outside the fingers that are free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.convex_hull import fingers_in_body
from .window import Rows, Window

FREE_REACH = 15e-3  # [m] free fingers further from a contact point are left out


@dataclass(frozen=True, eq=False)
class Pairs(Rows):
    """Touches and planes that they lie behind."""

    touch: np.ndarray
    plane: np.ndarray


@dataclass(frozen=True, eq=False)
class Outside(Rows):
    """Touches whose contact point is outside a free finger at p_wf; pose: its index."""

    touch: np.ndarray
    pose: np.ndarray
    p_wf: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanesWindow(Window):
    """A window, and which touch lies on which plane.

    plane: (touches,) of each touch; planes: how many; slip (n, 2): successive touches
    of a finger; link (m, 2): those of them that differ in their planes, one of each two
    planes.  The last pose is held.
    """

    plane: np.ndarray
    planes: int
    slip: np.ndarray
    link: np.ndarray
    behind: Pairs
    outside: Outside


def felt_points(touch, x, n) -> np.ndarray:
    """Return contact points (touches, 3) [m] in the body frame at poses x (3, T).

    n (touches, 3): normals in that frame.
    """
    return fingers_in_body(touch, x) - touch.radius[:, None] * n


def planes_window(window, faces) -> PlanesWindow:
    """Return the window with the pairs of touches, planes and free fingers.

    faces: search.plane_slam.Faces, the planes of its touches and poses so far.
    """
    plane, touch = faces.plane, window.touch
    order = np.lexsort((touch.sample, touch.finger))
    near = touch.sample[order[1:]] - touch.sample[order[:-1]] == 1
    near &= touch.finger[order[1:]] == touch.finger[order[:-1]]
    slip = np.stack([order[1:], order[:-1]], 1)[near]
    link = slip[plane[slip[:, 0]] != plane[slip[:, 1]]]
    _, once = np.unique(np.sort(plane[link], axis=1), axis=0, return_index=True)
    link = link[once]
    same = near & (plane[order[1:]] == plane[order[:-1]])
    ends = order[~(np.r_[False, same] & np.r_[same, False])]
    i, j = np.meshgrid(ends, np.arange(len(faces.b)), indexing="ij")
    other = plane[i] != j
    point = felt_points(touch, faces.x, faces.n[plane])
    free = window.free
    centre = fingers_in_body(free, faces.x)
    apart = np.linalg.norm(point[ends][:, None] - centre[None], axis=2)
    a, f = np.nonzero(apart < free.radius + FREE_REACH)
    return PlanesWindow(
        **vars(window.holding(faces.x, [-1])),
        plane=plane, planes=len(faces.b), slip=slip, link=link,
        behind=Pairs(i[other], j[other]),
        outside=Outside(ends[a], free.pose[f], free.p_wf[f], free.radius[f]),
    )  # fmt: skip


def of_new_action(window: PlanesWindow, x, planes: int) -> PlanesWindow:
    """Return what a new action adds to the pairs of a past with poses x (3, T)."""
    past, touch = x.shape[1], window.touch
    new, first = touch.sample >= past, window.pose[past]
    behind, outside = window.behind, window.outside
    return replace(
        window.holding(x, slice(first)),
        slip=window.slip[new[window.slip].any(axis=1)],
        link=window.link[(window.plane[window.link] >= planes).any(axis=1)],
        behind=behind.pick(new[behind.touch] | (behind.plane >= planes)),
        outside=outside.pick(new[outside.touch] | (outside.pose >= first)),
        **window.of_later_steps(past),
    )  # fmt: skip
