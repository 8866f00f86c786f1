"""Contact of spherical fingers with many upright boxes at once: gap, normal, slopes.

A state z (6, ...) holds the side lengths a, b, h [m] of a box that lies flat on the
ground, and its planar pose x, y [m], yaw [rad]; all axes behind the first one are
independent boxes.  The geometry is that of formulations/shape.py with sharp edges, in
NumPy, since thousands of boxes are compared with each sample.
"""

from __future__ import annotations

import numpy as np

ON_SURFACE = 1e-9  # [m] a point this close to the surface has the nearest face's normal
SHARPEST = 1e-3  # [m] distance below which the normal of an edge turns no faster


def in_body(z, p_w):
    """Return the horizontal coordinates (2, ...) of a world point in the body frame."""
    c, s = np.cos(z[-1]), np.sin(z[-1])
    dx, dy = p_w[0] - z[-3], p_w[1] - z[-2]
    return np.stack([c * dx + s * dy, c * dy - s * dx])


def box_contact(z, p_w, radius):
    """Return gap (...) [m] and outward normal (3, ...), body frame, of a finger.

    p_w (3,) [m]: its centre, world frame.
    """
    gap, n, _, _ = _contact(z, in_body(z, p_w), p_w[2], radius)
    return gap, n


def box_contact_slopes(z, p_w, radius):
    """Return gap, normal in the world frame, and their slopes in z.

    gap (S,), normal (3, S), slopes of the gap (6, S), of the normal (3, 6, S).
    """
    c, s = np.cos(z[5]), np.sin(z[5])
    p_b = in_body(z, p_w)
    gap, n, signs, active = _contact(z, p_b, p_w[2], radius)
    along = np.zeros((3, *z.shape))  # of the point's distance to each pair of faces
    along[0, 3], along[0, 4], along[0, 5] = -c, -s, p_b[1]
    along[1, 3], along[1, 4], along[1, 5] = s, -c, -p_b[0]
    along[2, 2] = -0.5
    for axis in range(3):
        along[axis, axis] -= 0.5 * signs[axis]
    along *= active[:, None]
    gap_slopes = (n[:, None] * along).sum(axis=0)
    distance = np.maximum(gap + radius, SHARPEST)
    several = active.sum(axis=0) > 1  # only there does the normal turn on the body
    turning = np.where(several, 1 / distance, 0.0) * (along - n[:, None] * gap_slopes)
    normal = np.stack([c * n[0] - s * n[1], s * n[0] + c * n[1], n[2]])
    slopes = np.stack(
        [c * turning[0] - s * turning[1], s * turning[0] + c * turning[1], turning[2]]
    )
    slopes[0, 5] -= normal[1]
    slopes[1, 5] += normal[0]
    return gap, normal, gap_slopes, slopes


def _contact(z, p_b, height, radius):
    """Return gap, normal, signs of the point, and which axes it lies outside of."""
    point = np.stack([*p_b, height - z[2] / 2])
    signs = np.where(point >= 0, 1.0, -1.0)
    beyond = np.abs(point) - z[:3] / 2
    outside = np.maximum(beyond, 0.0)
    distance = np.sqrt((outside**2).sum(axis=0))
    inside = distance < ON_SURFACE
    deepest = beyond.max(axis=0)
    active = np.where(inside, beyond == deepest, beyond > 0)
    share = np.where(inside, 1.0, outside / np.maximum(distance, ON_SURFACE))
    return (
        np.where(inside, deepest, distance) - radius,
        active * share * signs,
        signs,
        active,
    )
