"""Lay out a search for an object that floats: in the plane in which it was touched.

Fingers that push a floating object touch it around a plane, and it moves mostly in that
plane.  So the planar beam searches there as if the object slid, without friction, on a
ground half a typical size below the touches; what it finds starts a solve in which the
object moves freely.  The plane is that of the first action with touches, so that more
actions leave it where it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .hypothesis import Kinds
from .scene import Ground
from .tipping import continuous, lifted, matrices

LENGTH = 0.02  # [m] of spread across the plane that counts as much as a normal across
UPRIGHT = 1e-3  # [-] preference for the world's z where touches leave the plane open


def plane_of_touch(data, size: float, guess=None) -> Ground:
    """Return the plane to search on: half of `size` [m] below the first touches.

    It contains their normals and points as well as can be; a user's guess (a Guess)
    lies with its z along the world's.
    """
    felt = data.contact & data.valid
    first = data.action[felt.any(axis=1)][0]
    t, f = np.nonzero(felt & (data.action == first)[:, None])
    n = data.normal[t, f]
    p = data.finger_position[t, f] - data.finger_radius[f, None] * n
    if guess is not None:
        up = np.array([0.0, 0.0, 1.0])
        position = np.asarray(guess.position, float)
        height = position[2] if len(position) == 3 else p[:, 2].mean()
        return Ground(height=height - np.asarray(guess.side_lengths)[2] / 2)
    apart = (p - p.mean(axis=0)) / LENGTH
    across = (n.T @ n + apart.T @ apart) / len(n)
    across[2, 2] -= UPRIGHT
    up = np.linalg.eigh(across)[1][:, 0]
    up *= np.copysign(1.0, up[np.argmax(np.abs(up))])
    return Ground(height=float(p.mean(axis=0) @ up) - size / 2, normal=tuple(up))


def laid_out(job, ground: Ground):
    """Return the job as the planar beam takes it: on the plane, nothing brakes."""
    scene = replace(job.scene, ground=ground, friction_ground=0.0)
    data = job.data.transformed(ground.rotation, ground.translation)
    return replace(job, data=data, scene=scene, kinds=Kinds())


def floated(h, ground: Ground):
    """Return the planar hypothesis as free poses in the world."""
    x = lifted(h.theta, h.x)
    p = ground.from_ground(x[:3].T)
    R = ground.rotation.T @ matrices(x)
    offset = None if h.offset is None else ground.rotation.T @ h.offset
    return replace(h, x=np.vstack([p.T, continuous(R).T]), offset=offset)
