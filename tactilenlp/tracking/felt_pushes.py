"""Predict quasi-static pushing of a body of unknown shape from measured contacts.

Quasi-static pushing asks of a body for the point and the normal of each contact, for
its centre of mass and for the width of its support (pushing.py).  The first two are
measured; the others differ between the bodies that are moved side by side.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from ..nlp.term_functions import MappedFunction
from .mapped import map_columns, of_columns
from .pushing import Move, felt_push_motion
from .tracks import PRESS

HALF = 0.5  # [-] of a step during which a touch that begins pushes


def pushed_paths(data, samples, z, onset, friction) -> np.ndarray:
    """Return paths (S, 3, samples) [m, m, rad] of bodies through samples of an action.

    The first sample may be the last one of the action before: in between a body rests.
    z (4, S): half the width of the support [m], and the pose of the centre of mass at
    the first sample; onset (S,) [-]: of the way of a finger between the two samples
    where a touch begins, the part during which it touches; friction: ground, fingers.
    """
    foot, pose, motion = z[:1], z[1:], np.zeros_like(z[1:])
    paths, pushed = np.empty((*pose.T.shape, len(samples))), _Pushed(data, friction)
    paths[:, :, 0] = pose.T
    for k, t in enumerate(samples[1:], 1):
        motion = pushed(t, np.vstack([foot, pose]), motion, onset)
        pose = pose + motion
        paths[:, :, k] = pose.T
    return paths


def pushed_steps(data, x, foot, friction) -> np.ndarray:
    """Return how a body on a path x (3, T) is pushed in each step (3, T) [m, m, rad].

    Its centre of mass is its origin.  foot [m], friction: as of `pushed_paths`.
    """
    steps, onset, pushed = np.zeros(x.shape), np.array([HALF]), _Pushed(data, friction)
    z = np.vstack([np.full(x.shape[1], foot), x])
    for t in np.flatnonzero(pushed.active[: x.shape[1]].any(axis=1)):
        steps[:, [t]] = pushed(t, z[:, [t - 1]], steps[:, [t - 1]], onset)
    return steps


class _Pushed:
    """The motion of bodies in one step of a recording, by the touches that it has.

    active (T, F): which fingers push in the step to a sample.
    """

    def __init__(self, data, friction):
        self._data, self._friction = data, np.array(friction)
        self._touched = data.contact & data.valid
        within = np.diff(data.action, prepend=np.nan) == 0  # no step between actions
        self.active = self._touched & within[:, None]

    def __call__(self, t, z, before, onset) -> np.ndarray:
        """Return the motion (3, S) of bodies z (4, S) in the step to sample t.

        before (3, S): that of the step before; no motion where nothing is felt.
        """
        active = np.flatnonzero(self.active[t])
        if not len(active):
            return np.zeros_like(before)
        p, radius = self._data.finger_position, self._data.finger_radius
        ways = np.concatenate([[*p[t - 1, f], *p[t, f], radius[f]] for f in active])
        shares = np.where(self._touched[t - 1, active, None], 1.0, onset)
        normals = self._data.normal[t, active].ravel()
        push = _push(len(active))
        return push(z, before, ways, normals, shares, self._friction)[0]


@cache
def _push(fingers: int) -> MappedFunction:
    """Return the motion of one body by so many fingers, for many bodies."""
    z, before = ca.SX.sym("z", 4), ca.SX.sym("before", 3)
    share = ca.SX.sym("share", fingers)
    ways, normals = ca.SX.sym("ways", 7, fingers), ca.SX.sym("n", 3, fingers)
    friction = ca.SX.sym("mu", 2)
    moves = [Move(w[:3], w[3:6], w[6], PRESS[0]) for w in ca.horzsplit(ways)]
    n, shares = ca.horzsplit(normals), ca.vertsplit(share)
    motion = felt_push_motion(z, moves, n, shares, before, ca.vertsplit(friction))
    arguments = z, before, ca.vec(ways), ca.vec(normals), share, friction
    whole = ca.Function("felt", arguments, [motion])

    def derive():
        return [of_columns("felt", arguments, [motion])]

    return map_columns(("felt",), whole, derive)[0]
