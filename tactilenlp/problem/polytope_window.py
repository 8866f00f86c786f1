"""Build the window of a polytope: which vertices each contact depends on.

The index lists follow from the vertices and poses at which a solve starts.  They are
constant during a solve and built again for the next one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, QhullError

from formulations.likelihood import steepness
from formulations.pushed_hull import LIFTED

from ..geometry.convex_hull import fingers_in_body, nearest_points, nearest_triangles
from ..geometry.convex_hull import triangles as triangles_of
from ..geometry.transforms import is_planar, matrices
from .window import Corners, Rests, Window

VERTICES_READ = 8  # vertices that a contact depends on
EQUAL_WEIGHT, SUM_WEIGHT = 1e-3, 1e3  # weights of equal shares, and of a sum of one
CLEAR_LENGTHS = 20.0  # [-] in which a free finger's cost falls by a factor of e
RIGID_SHARE = 1e-3  # [-] of the largest move of legs with a pose: less is no move
DEPTH_WEIGHT = 3.0  # [-] lengths along the surface that one length below it counts for


@dataclass(frozen=True, eq=False, kw_only=True)
class PolytopeWindow(Window):
    """A window, where the vertices start and which of them each contact reads.

    start (V, 3) [m]; near_touch, near_free, near_push (instances, VERTICES_READ):
    vertices; corner_vertex (corners,), rest_vertex (rests,): that of each ground
    contact and rest; legs (n,): those that carry the body where it lies; weight_share
    (corners,): of the weight, that each ground contact carries at rest; grounded (k,):
    on the ground at the last pose, the legs in planar motion; floor [m]: no vertex is
    lower at the last pose; triangles (2 V - 4, 3) of the hull, counterclockwise from
    outside; body (10,): volume, centroid and second moments; past (V, 3) [m],
    information (3 V, 3 V): of one action, vertices before it, None of all actions.  The
    last pose is held.
    """

    start: np.ndarray
    near_touch: np.ndarray
    near_free: np.ndarray
    near_push: np.ndarray
    legs: np.ndarray
    corner_vertex: np.ndarray
    weight_share: np.ndarray
    rest_vertex: np.ndarray
    grounded: np.ndarray
    floor: float
    triangles: np.ndarray
    body: np.ndarray
    past: np.ndarray | None = None
    information: np.ndarray | None = None

    def of_action(self, past, about) -> PolytopeWindow:
        """Return the window of what comes after the samples of a past.

        past: a Hypothesis, whose poses are held; about: information (3 V, 3 V) about
        its vertices.
        """
        samples = past.x.shape[1]
        touch, free = self.touch.since(samples), self.free.since(samples)
        first, push = self.step.since(samples).start, self.push.since(samples)
        stands = self.corner.step >= first
        corner = self.corner.pick(stands)
        return replace(
            self.holding(past.x, slice(self.pose[samples])),
            touch=self.touch.pick(touch), near_touch=self.near_touch[touch],
            free=self.free.pick(free), near_free=self.near_free[free],
            near_push=self.near_push[push],
            corner=replace(corner, step=corner.step - first),
            corner_vertex=self.corner_vertex[stands],
            weight_share=self.weight_share[stands],
            past=past.theta.reshape(-1, 3), information=about,
            **self.of_later_steps(samples),
        )  # fmt: skip

    def rigid_moves(self, rows, slopes) -> np.ndarray:
        """Return what moves of vertices that can lift do, as far as a pose has them.

        Four legs that move apart would bend the body, which all its poses share: what
        no pose of a step follows is left out.  Vertices in the air have rows of zeros.
        """
        out = np.zeros_like(rows)
        down = rows.any(axis=1)
        for step in np.unique(self.lift.step):
            legs = np.flatnonzero((self.lift.step == step) & down)
            if len(legs):
                ways, size, _ = np.linalg.svd(slopes[legs].toarray())
                ways = ways[:, : len(size)][:, size > RIGID_SHARE * size[0]]
                out[legs] = ways @ (ways.T @ rows[legs])
        return out

    def supports(self, theta) -> np.ndarray:
        """Return the vertices (n, 3) [m] that carry the body, from its centroid."""
        return self.start[self.legs] - self.body[1:4]

    def seen_by_touches(self, theta) -> np.ndarray:
        """Return the vertices (3 VERTICES_READ, touches) that each touch reads."""
        return theta.T[self.near_touch].reshape(len(self.touch), -1).T


def polytope_window(window, vertices, x, ground, resting) -> PolytopeWindow:
    """Return the window of a polytope that starts as `vertices` at poses x (u, T).

    ground: whether there is one; resting: the vertices (V, 3) as which it carries its
    weight.
    """
    triangles = triangles_of(vertices, 2 * len(vertices) - 4)
    stand = np.array(window.shape.corners, int)[:, 0]
    share = np.zeros(len(vertices))
    share[stand] = support_shares(resting[stand], hull_moments(resting, triangles)[1:4])
    lifts = ground and not is_planar(x)
    window = with_ground_contacts(window, stand, vertices, x) if lifts else window
    leg, rest = (part.signs[:, 0].astype(int) for part in (window.corner, window.rest))
    share = share[leg]
    if lifts:  # what is above the ground carries nothing
        at = window.step.sample[window.corner.step]
        share *= vertex_heights(vertices, x)[at, leg] < LIFTED
    return PolytopeWindow(
        **vars(window.holding(x, [-1])), start=vertices,
        near_touch=vertices_near(window.touch, vertices, x),
        near_free=vertices_near(window.free, vertices, x),
        near_push=vertices_near(window.push, vertices, x),
        legs=stand, corner_vertex=leg, weight_share=share, rest_vertex=rest,
        grounded=stand if ground and is_planar(x) else stand[:0],
        floor=(0.0 if is_planar(x) else -x[2, -1]) if ground else -np.inf,
        triangles=triangles, body=hull_moments(vertices, triangles),
    )  # fmt: skip


def with_ground_contacts(window, stand, vertices, x) -> Window:
    """Return the window with the ground under the vertices that are low at each pose.

    stand (n,): those on which the hull lies; others take over where they are lower by
    LIFTED at poses x (6, T).
    """
    z = vertex_heights(vertices, x)
    z[:, stand] -= LIFTED
    low = np.sort(np.argsort(z, axis=1, kind="stable")[:, : len(stand)], axis=1)

    def signs(samples):
        carry = low[samples].reshape(-1, 1)
        return np.hstack([carry, np.zeros((len(carry), 2))])

    corner = Corners(window.corner.step, signs(window.step.sample))
    first = window.last[window.rest.pose[:: len(stand)]]
    rest = Rests(window.rest.pose, signs(first))
    return replace(window, corner=corner, lift=corner, rest=rest)


def vertex_heights(vertices, x) -> np.ndarray:
    """Return how high (T, V) [m] each vertex is at free poses x (6, T)."""
    return matrices(x)[:, 2] @ vertices.T + x[2][:, None]


def without_clear(window, vertices, x):
    """Return the window less the free fingers that are certainly clear of a hull.

    At a gap of CLEAR_LENGTHS / alpha (eq:bool) a free sample costs nothing.
    """
    free = window.free
    centre = fingers_in_body(free, x)
    gap = (
        np.linalg.norm(centre - nearest_points(vertices, centre), axis=1) - free.radius
    )
    alpha = steepness(window.sigma_position)
    return replace(window, free=free.pick(gap < CLEAR_LENGTHS / alpha))


def vertices_near(samples, vertices, x) -> np.ndarray:
    """Return the vertices (samples, VERTICES_READ) that can be nearest to each finger.

    First those of the triangle that the contact point is on: a large face can have many
    vertices nearer than its corners.  Then along the hull's surface the nearest to that
    point; what lies deep below the plane of the contact comes last.
    """
    centre = fingers_in_body(samples, x)
    point, on = nearest_triangles(vertices, centre)
    n = centre - point
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
    to = vertices[None] - point[:, None]
    below = -np.einsum("svk,sk->sv", to, n)
    far = np.linalg.norm(to, axis=2) + DEPTH_WEIGHT * below
    np.put_along_axis(far, on, -1.0, axis=1)
    near = np.sort(np.argsort(far, axis=1, kind="stable")[:, :VERTICES_READ], axis=1)
    # A doubled vertex changes nothing, and functions of a term are those of any hull.
    return np.pad(near, ((0, 0), (0, VERTICES_READ - near.shape[1])), mode="edge")


def supporting_vertices(vertices, count: int) -> np.ndarray:
    """Return at least three and at most `count` vertices that carry the body.

    Of the lowest vertices, those that span the largest area are taken.
    """
    z = vertices[:, 2]
    low = np.nonzero(z <= max(LIFTED, np.sort(z)[2]))[0]
    try:
        around = low[ConvexHull(vertices[low, :2]).vertices]  # counterclockwise
    except QhullError:  # in a row: all of them, the page moves them apart
        around = low
    while len(around) > count:
        flat = vertices[around, :2]
        u, v = flat - np.roll(flat, 1, axis=0), np.roll(flat, -1, axis=0) - flat
        lost = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        around = np.delete(around, np.argmin(lost))
    return np.sort(around)


def support_shares(legs, centroid) -> np.ndarray:
    """Return the shares (n,) of the weight that legs (n, 3) carry at rest.

    They balance it about the centroid as far as legs that only push can, all alike
    where that leaves a choice.
    """
    n, arms = len(legs), (legs - centroid)[:, :2].T
    arms = arms / np.abs(arms).max()
    rows = np.vstack([arms, EQUAL_WEIGHT * np.eye(n), np.full(n, SUM_WEIGHT)])
    shares, _ = nnls(rows, np.r_[0, 0, np.full(n, EQUAL_WEIGHT / n), SUM_WEIGHT])
    return shares / shares.sum()


def hull_moments(vertices, triangles) -> np.ndarray:
    """Return volume [m^3], centroid [m] and second moments [m^2] (10,) of a hull."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volume = (a * np.cross(b, c)).sum(axis=1) / 6
    s = a + b + c
    S = sum(p[:, :, None] * p[:, None] for p in (s, a, b, c))
    S = (volume[:, None, None] * S).sum(axis=0) / 20
    first = (volume[:, None] * s).sum(axis=0) / 4
    second = S[[0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]]
    return np.r_[volume.sum(), np.r_[first, second] / volume.sum()]


def with_supports(shape, vertices):
    """Return the shape of so many vertices, whose corners are those that carry it."""
    carry = supporting_vertices(vertices, len(shape.corners))
    corners = tuple((int(j), 0, 0) for j in carry)
    return replace(shape, theta=vertices.size, counts=(), corners=corners)
