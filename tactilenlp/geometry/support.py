"""Where the ground carries a body that is pushed, and how near that is to tipping.

With forces f_i on the body at points p_i, and the ground at height g, equilibrium is

    N = m g_0 - sum_i f_iz,    N c = m g_0 p_wm + (M_y, -M_x),
    M = sum_i (p_i - g e_z) x f_i

in the horizontal coordinates of the centre of pressure c and the centre of mass p_wm.
The ground presses only within the convex hull of the points on which the body stands: a
body that needs c outside of it tips over an edge (the zero moment point of walking
robots: Vukobratovic and Borovac, Int. J. Humanoid Robotics 1, 2004).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from formulations.pushing import LIGHTEST

from .faces import polygons
from .transforms import rotate_planar

STANDS = 1e-3  # [m] above its lowest point, a vertex of an estimated body carries it
AROUND = np.linspace(0, 2 * np.pi, 64, endpoint=False)  # [rad], 0.1 % of a polygon
OUTWARD = np.stack([np.cos(AROUND), np.sin(AROUND)])  # (2, 64)
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class Standing:
    """A body that stands on the ground, as far as it is known.

    vertices:   (V, 3) [m], from its origin, along the axes of the frame of positions
    position:   (3,) [m], of its origin
    centre:     (2,) [m], of mass, horizontally from its origin
    slopes:     (V, 2, k), of the vertices, horizontally, by k uncertain numbers
    covariance: (k, k), of these
    """

    vertices: np.ndarray
    position: np.ndarray
    centre: np.ndarray
    slopes: np.ndarray
    covariance: np.ndarray

    def margin(self, motion, wrench, weight) -> tuple[np.ndarray, np.ndarray]:
        """Return how far the centre of pressure is within the support polygon (n,) [m].

        It is negative where the body tips.  And its standard deviation (n,) [m], by
        what is not known of the polygon.  motion: (n, 3) [m, m, rad], planar
        displacements; wrench: (n, 6) [N, N m], force on the body and moment about the
        origin of positions; weight: m g_0 [N].
        """
        reach, sigma = self._polygon
        angle = AROUND + motion[:, 2:]
        ahead = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (n, 2, 64)
        pressed = self._pressed(motion, wrench, weight)
        room = reach - np.einsum("ni,nia->na", pressed, ahead)
        edge = room.argmin(axis=1)
        return room[np.arange(len(room)), edge], sigma[edge]

    @cached_property
    def _polygon(self) -> tuple[np.ndarray, np.ndarray]:
        """How far the support polygon reaches OUTWARD (64,) [m], and its deviation."""
        stands = np.flatnonzero(self.vertices[:, 2] < self._ground + STANDS)
        # It stands: the polygon has at least the point below the centre of mass.
        reach = np.vstack([self.vertices[stands, :2], self.centre]) @ OUTWARD
        slopes = np.vstack([self.slopes[stands], np.zeros((1, *self.slopes.shape[1:]))])
        J = np.einsum("ia,aik->ak", OUTWARD, slopes[reach.argmax(axis=0)])
        variance = np.einsum("ak,kl,al->a", J, self.covariance, J)
        return reach.max(axis=0), np.sqrt(np.maximum(variance, 0.0))

    @property
    def _ground(self) -> float:
        """The height of the ground [m] from the origin of the body."""
        return self.vertices[:, 2].min()

    def _pressed(self, motion, wrench, weight) -> np.ndarray:
        """Return the centre of pressure (n, 2) [m] from the origin of the body."""
        force, plane = wrench[:, :3], self.position[2] + self._ground
        moment = wrench[:, 3:] - np.cross([0.0, 0.0, plane], force)
        load = np.maximum(weight - force[:, 2], LIGHTEST * weight)
        origin = self.position[:2] + motion[:, :2]
        mass = np.stack(rotate_planar(motion[:, 2], *self.centre, origin.T), axis=1)
        carried = weight * mass + np.stack([moment[:, 1], -moment[:, 0]], axis=1)
        return carried / load[:, None] - origin


def settling(vertices, position) -> tuple[np.ndarray, np.ndarray]:
    """Return how a body that leans comes to lie flat: rotation (3, 3), position (3,).

    On the face that points down most, over its lowest vertex, ground at z = 0; for
    vertices (V, 3) [m] from its origin at `position` (3,) [m].
    """
    normals = np.array([n for _, n in polygons(vertices)])
    down = normals[normals[:, 2].argmin()]
    turn = Rotation.align_vectors(DOWN, down)[0].as_matrix()
    pivot = vertices[vertices[:, 2].argmin()]
    lying = position + pivot - turn @ pivot
    lying[2] = -(vertices @ turn.T)[:, 2].min()
    return turn, lying
