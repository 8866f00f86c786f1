"""A solid cuboid by brute force: what the pages are compared with."""

import numpy as np

RHO = 0.01  # [m] of the fingertips


def solid_distance(half, q):
    """Return the exact signed distance (n,) of points (n, 3) from a cuboid."""
    d = np.abs(q) - half
    outside = np.linalg.norm(np.maximum(d, 0), axis=1)
    return outside + np.minimum(d.max(axis=1), 0)


def solid_normal(half, q):
    """Return the exact outward normal (n, 3) at the nearest surface points."""
    out = q - np.clip(q, -half, half)
    d = np.abs(q) - half
    face = np.sign(q) * (d == d.max(axis=1, keepdims=True))
    out = np.where((d.max(axis=1) > 0)[:, None], out, face)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def angle(a, b):
    """Return the angles (n,) [rad] between unit vectors (n, 3)."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=1) / 2, 0, 1))


def around(half, rng, distance, n=400):
    """Return points whose nearest surface points cover faces, edges and corners."""
    s = rng.uniform(-1, 1, (n, 3))
    ends = rng.integers(1, 4, n)  # how many coordinates lie at the end: 1 is a face
    order = np.argsort(rng.random((n, 3)), axis=1) < ends[:, None]
    s = np.where(order, np.sign(s), s)
    out = np.abs(rng.normal(size=(n, 3))) * order * np.sign(s)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return s * half + out * distance * rng.uniform(0.8, 1, (n, 1))
