"""Where the ground carries a body that is pushed, and how near that is to tipping.

With forces f_i on the body at points p_i, and the ground at height g, equilibrium is

    N = m g_0 - sum_i f_iz,    N c = m g_0 p_wo + (M_y, -M_x),
    M = sum_i (p_i - g e_z) x f_i

in the horizontal coordinates of the centre of pressure c.  The ground presses only
within the convex hull of the points on which the body stands: a body that needs c
outside of it tips over an edge (the zero moment point of walking robots: Vukobratovic
and Borovac, Int. J. Humanoid Robotics 1, 2004).
"""

from __future__ import annotations

import numpy as np

from formulations.pushing import LIGHTEST

STANDS = 1e-3  # [m] above its lowest point, a vertex of an estimated body carries it
AROUND = np.linspace(0, 2 * np.pi, 64, endpoint=False)  # [rad], 0.1 % of a polygon
OUTWARD = np.stack([np.cos(AROUND), np.sin(AROUND)])  # (2, 64)


def tipping_margin(vertices, position, motion, wrench, weight) -> np.ndarray:
    """Return how far (n,) [m] the centre of pressure is within the support polygon.

    It is negative where the body tips.  vertices: (V, 3) [m] before the motion, in the
    frame of positions; position: (3,) [m], its centre of mass; motion: (n, 3)
    [m, m, rad], planar displacements since then; wrench: (n, 6) [N, N m], force on the
    body and moment about the origin; weight: m g_0 [N].
    """
    ground = vertices[:, 2].min()
    stands = vertices[vertices[:, 2] < ground + STANDS, :2] - position[:2]
    force, moment = wrench[:, :3], wrench[:, 3:]
    moment = moment - np.cross([0.0, 0.0, ground], force)
    load = np.maximum(weight - force[:, 2], LIGHTEST * weight)
    centre = position[:2] + motion[:, :2]
    carried = weight * centre + np.stack([moment[:, 1], -moment[:, 0]], axis=1)
    apart = carried / load[:, None] - centre  # of the centre of pressure, world's axes
    angle = AROUND + motion[:, 2:]
    ahead = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (n, 2, 64)
    reached = np.einsum("ni,nia->na", apart, ahead)
    return ((stands @ OUTWARD).max(axis=0) - reached).min(axis=1)
