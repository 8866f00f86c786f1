r"""How far off an estimate may be where a finger slides: it may have stuck instead.

A finger that moves along a face slides on it or takes the body along.  No sensor tells
which; the physics of a solve holds to one of them with a curvature that is only that of
a rounded |v|.  Had a finger f stuck in action a, the body would have come by its slip
u in that action, and all poses before would lie by -u from where they are: a move e of
the poses against which the physics' Hessian H pulls by H e.  Hence

    K^{-1} ( sum_{a, f}  STUCK  H e e' H ) K^{-1},

nothing where touches alone hold the poses: a move that physics does not resist.
"""

from __future__ import annotations

import numpy as np

from .body_frame import planar, points
from .curvature import Curvature
from .rotations import matrices

STUCK = 0.1  # [-] of the fingers that seem to slide did not


def dragging(curvature: Curvature, pulls, window, action) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns if fingers stuck, SI.

    pulls: see Curvature.response_of; action (T,): of every sample.
    """
    problem, push = curvature.problem, window.push
    names = [n for n, term in problem.costs.items() if term.role == "physics"]
    H = curvature.hessian(names)
    x, slip = problem.variables["x"], slips(curvature, window)
    own, moved = action[push.sample], []
    for a, f in np.unique(np.stack([own, push.finger]), axis=1).T:
        rows = np.flatnonzero((own == a) & (push.finger == f))
        later = push.sample[rows] > window.last[:, None]  # (poses, rows)
        move = np.zeros((x.columns, x.rows))
        move[:, : slip.shape[1]] = -(later @ slip[rows])
        e = np.zeros(problem.size)
        e[x.span] = move.ravel()
        moved.append(pulls.T @ (H @ e))
    moved = np.array(moved).reshape(-1, pulls.shape[1])
    return STUCK * moved.T @ moved


def slips(curvature: Curvature, window) -> np.ndarray:
    """Return how far [m] each pushing finger slid over the body.

    (pushes, 2) over the ground, in planar motion; else (pushes, 3).
    """
    x, push = curvature.problem.unpack(curvature.x)["x"], window.push
    step = push.step
    now, before = (x[:, k[step]] for k in (window.step.pose, window.step.before))
    if not planar(x):
        met = points(before, slice(None), push.p_wf_1)
        return push.p_wf - now[:3].T - np.einsum("nij,nj->ni", matrices(now), met)
    arm = (push.p_wf_1[:, :2] - before[:2].T).T
    c, s = np.cos(now[2] - before[2]), np.sin(now[2] - before[2])
    carried = now[:2] + np.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
    return push.p_wf[:, :2] - carried.T
